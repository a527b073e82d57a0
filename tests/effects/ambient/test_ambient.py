"""Ambient visibility: closed forms, a closed box, and depth images beside rays."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from torchrender.effects.ambient import horizon
from torchrender.effects.ambient.edge_on import sees_edge_on
from torchrender.effects.ambient.horizon import horizon_ambient
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.ambient.traced import traced_ambient
from torchrender.effects.ambient.visibility import AmbientVisibility
from torchrender.errors import InputError, OptionError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, quad

FINE = AmbientOptions(slices=4, steps=32, spacing=1)


def sheet(corner: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...]) -> Mesh:
    return quad(torch.tensor(corner), torch.tensor(u), torch.tensor(v))


def camera(eye: tuple[float, ...], target: tuple[float, ...], size: int = 48, **other: float) -> Cameras:
    return Cameras.look_at(torch.tensor(eye), torch.tensor(target), fov_deg=50, width=size, height=size, **other)


def both(
    scene: Scene, view: Cameras, options: AmbientOptions = FINE, reach: float = 1.0
) -> tuple[AmbientVisibility, AmbientVisibility, Tensor]:
    seen = rasterize(scene, view)
    rays = traced_ambient(RayCaster(scene.geometry), seen, rays=128, reach=reach)
    return horizon_ambient(scene.geometry, seen, options, reach=reach), rays, seen.covered


def test_nothing_hides_the_sky_from_a_plain() -> None:
    scene = Scene(meshes=(sheet((-50.0, 0.0, 50.0), (100.0, 0.0, 0.0), (0.0, 0.0, -100.0)),))
    for found in both(scene, camera((0.0, 2.0, 3.0), (0.0, 0.0, 0.0)))[:2]:
        assert float(found.sky.min()) > 0.95 and float(found.sky.mean()) > 0.97
        assert float(found.bent_normal[..., 1].min()) > 0.99


@pytest.mark.parametrize("spacing", [1, 4])
def test_few_rays_do_not_turn_the_light_of_what_nothing_hides(spacing: int) -> None:
    """A ball alone: the sky comes from around its normal, however its eight rays lie."""
    scene = Scene(meshes=(Mesh.sphere(1.0),))
    seen = rasterize(scene, camera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0)))
    found = traced_ambient(RayCaster(scene.geometry), seen, rays=8, reach=1.0, spacing=spacing)
    clear = seen.covered & (found.sky > 1.0 - 1e-5)
    assert float(clear.sum()) > 0.8 * float(seen.covered.sum())
    assert float((found.bent_normal - seen.normal)[clear].norm(dim=-1).max()) < 0.02


@pytest.mark.parametrize("slices", [1, 2, 4])
def test_few_slices_do_not_turn_the_light_of_what_nothing_hides(slices: int) -> None:
    """A ball alone, whose slices all look to two sides of each point: their mean is not that of all directions."""
    scene = Scene(meshes=(Mesh.sphere(1.0),))
    seen = rasterize(scene, camera((0.0, 1.0, 4.0), (0.0, 0.0, 0.0)))
    options = AmbientOptions(slices=slices, steps=12, spacing=1)
    found = horizon_ambient(scene.geometry, seen, options, reach=1.0)
    clear = seen.covered & (found.sky > 1.0 - 1e-5)
    assert float(clear.sum()) > 0.5 * float(seen.covered.sum())
    assert float((found.bent_normal - seen.normal)[clear].norm(dim=-1).max()) < 0.01


@pytest.mark.parametrize("slices", [1, 2])
def test_slices_turn_the_light_to_where_the_sky_is_open(slices: int) -> None:
    """Beside a wall and under a table: nearer to where rays say than the normal is."""
    floor = sheet((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    wall = sheet((-1.5, 0.0, -6.0), (0.0, 0.0, 12.0), (0.0, 4.0, 0.0))
    top = replace(box(torch.tensor([1.6, 0.1, 1.0])))
    top = replace(top, vertices=top.vertices + torch.tensor([0.0, 0.8, 0.0]))
    scene = Scene(meshes=(floor, wall, top))
    view = camera((1.5, 1.8, 3.0), (-0.5, 0.3, 0.0), 64)
    found, rays, covered = both(scene, view, AmbientOptions(slices=slices, steps=16, spacing=3), reach=2.0)
    hidden = covered & (rays.sky < 0.8) & (rays.sky > 0.2)
    apart = (found.bent_normal - rays.bent_normal)[hidden].norm(dim=-1).mean()
    unturned = (rasterize(scene, view).normal - rays.bent_normal)[hidden].norm(dim=-1).mean()
    assert float(apart) < 0.6 * float(unturned)


@pytest.mark.parametrize("around", [48, 96])
def test_no_sky_gets_into_a_closed_box(around: int) -> None:
    scene = Scene(meshes=(box(torch.tensor([4.0, 3.0, 5.0])),))
    options = AmbientOptions(around=around)
    # Pixels take the mean over fifteen pixels to a side, so the picture is several times as wide.
    found, rays, covered = both(scene, camera((0.5, 0.1, 1.5), (0.0, -0.1, -3.0), size=96), options)
    assert bool(covered.all())
    assert float(rays.sky.max()) == 0.0
    assert float(found.sky.max()) < 0.03
    assert float((found.near - rays.near).abs().mean()) < 0.05


def test_at_the_foot_of_a_high_wall_half_the_sky_is_left() -> None:
    """Of the floor's: the wall hides one half; light comes from the other one."""
    floor = sheet((-60.0, 0.0, 60.0), (120.0, 0.0, 0.0), (0.0, 0.0, -120.0))
    wall = sheet((0.0, 0.0, -60.0), (0.0, 0.0, 120.0), (0.0, 120.0, 0.0))
    scene = Scene(meshes=(floor, wall))
    found, rays, _ = both(scene, camera((3.0, 1.5, 0.0), (0.3, 0.0, 0.0)), reach=0.5)
    seen = rasterize(scene, camera((3.0, 1.5, 0.0), (0.3, 0.0, 0.0)))
    foot = seen.covered & (seen.position[..., 0] < 0.6) & (seen.position[..., 1].abs() < 1e-6)
    for one in (found, rays):
        assert float(one.sky[foot].mean()) == pytest.approx(0.5, abs=0.03)
        assert float(one.bent_normal[..., 0][foot].mean()) > 0.3
    away = seen.covered & (seen.position[..., 0] > 1.0)
    assert float(found.near[away].min()) > 0.95


def test_depth_images_agree_with_rays_behind_a_corner_and_under_a_table() -> None:
    floor = sheet((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    top = replace(box(torch.tensor([1.6, 0.1, 1.0])))
    top = replace(top, vertices=top.vertices + torch.tensor([0.0, 0.8, 0.0]))
    scene = Scene(meshes=(floor, top))
    found, rays, covered = both(scene, camera((0.5, 1.8, 3.0), (0.0, 0.3, 0.0), 64), reach=2.0)
    assert float((found.sky - rays.sky).abs()[covered].mean()) < 0.05
    under = (rays.sky < 0.75) & covered
    assert bool(under.any()) and float((found.sky - rays.sky)[under].abs().mean()) < 0.15


class Counting:
    """A ray caster that counts its rays; those that only ask for what is near, after others, do not count."""

    def __init__(self, caster: RayCaster) -> None:
        self.caster, self.count = caster, 0

    def occluded(self, origins: Tensor, directions: Tensor, *, t_max: float = math.inf) -> Tensor:
        self.count += len(origins) if t_max == math.inf else 0
        return self.caster.occluded(origins, directions, t_max=t_max)


def test_what_is_near_hides_within_reach() -> None:
    """Under a roof of known height: rays whose way to it is longer than the reach are free."""
    floor = sheet((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    roof = sheet((-400.0, 1.0, 400.0), (800.0, 0.0, 0.0), (0.0, 0.0, -800.0))
    seen = rasterize(Scene(meshes=(floor,)), camera((0.5, 3.8, 1.0), (0.0, 0.0, 0.0), 16))
    caster = RayCaster(Scene(meshes=(floor, roof)).geometry)
    for reach, free in ((0.5, 1.0), (2.0, 0.25), (1e3, 0.0), (math.inf, 0.0)):  # share of sin^2 beyond 1 / reach
        found = traced_ambient(caster, seen, rays=256, reach=reach)
        assert float((found.near - free).abs()[seen.covered].max()) < 0.02
        assert float(found.sky[seen.covered].max()) < 0.01
        short = traced_ambient(caster, seen, rays=256, reach=reach, far=False)
        assert torch.equal(short.near, found.near) and torch.equal(short.sky, found.near)
    outside = traced_ambient(RayCaster(Scene(meshes=(floor,)).geometry), seen, rays=16, reach=math.inf)
    assert float(outside.near[seen.covered].min()) == 1.0


def test_few_points_cast_rays_and_the_others_follow_them() -> None:
    """Under a table: a sixteenth of the rays of eight a pixel, and nearer to the truth than these, without noise."""
    floor = sheet((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    top = box(torch.tensor([1.6, 0.1, 1.0]))
    scene = Scene(meshes=(floor, replace(top, vertices=top.vertices + torch.tensor([0.0, 0.8, 0.0]))))
    views = Cameras.cat([camera((0.5, 1.8, 3.0), (0.0, 0.3, 0.0), 64), camera((-2.0, 1.0, 1.0), (0.0, 0.3, 0.0), 64)])
    seen, caster = rasterize(scene, views), Counting(RayCaster(scene.geometry))
    made, counts = {}, []
    for name, rays, spacing in (("exact", 128, 1), ("each", 8, 1), ("few", 8, 4)):
        caster.count = 0
        made[name] = traced_ambient(caster, seen, rays=rays, reach=2.0, spacing=spacing)
        counts.append(caster.count)
    assert 14 * counts[2] < counts[1] < 18 * counts[2]
    each, few = ((made[name].sky - made["exact"].sky).abs()[seen.covered].mean() for name in ("each", "few"))
    assert float(few) < min(0.04, float(each))
    assert bool((made["few"].sky[~seen.covered] == 1).all())
    torch.testing.assert_close(made["few"].bent_normal.norm(dim=-1), seen.covered.float(), atol=1e-5, rtol=0)
    one = traced_ambient(RayCaster(scene.geometry), rasterize(scene, views[0]), rays=8, reach=2.0, spacing=4)
    torch.testing.assert_close(one.near[0], made["few"].near[0])


def test_pixels_that_share_their_rays_have_less_noise() -> None:
    """In the shade of a table, where this light is all there is."""
    floor = sheet((-6.0, 0.0, 6.0), (12.0, 0.0, 0.0), (0.0, 0.0, -12.0))
    top = box(torch.tensor([1.6, 0.1, 1.0]))
    scene = Scene(meshes=(floor, replace(top, vertices=top.vertices + torch.tensor([0.0, 0.8, 0.0]))))
    seen, caster = rasterize(scene, camera((0.5, 1.8, 3.0), (0.0, 0.3, 0.0), 96)), RayCaster(scene.geometry)
    exact = traced_ambient(caster, seen, rays=256, reach=2.0)
    apart = {}
    for share in (False, True):
        found = traced_ambient(caster, seen, rays=4, reach=2.0, share=share)
        assert bool((found.sky[~seen.covered] == 1).all())
        apart[share] = float((found.sky - exact.sky).square()[seen.covered].mean()) ** 0.5
    assert apart[True] < 0.5 * apart[False]


def test_a_batch_is_its_single_pictures() -> None:
    scene = Scene(meshes=(box(torch.tensor([4.0, 3.0, 5.0])),))
    views = Cameras.cat([camera((0.5, 0.1, 1.5), (0.0, -0.1, -3.0)), camera((-0.5, 0.4, 0.0), (2.0, 0.0, 1.0))])
    whole = horizon_ambient(scene.geometry, rasterize(scene, views), AmbientOptions(), reach=1.0)
    for k in range(2):
        alone = horizon_ambient(scene.geometry, rasterize(scene, views[k]), AmbientOptions(), reach=1.0)
        torch.testing.assert_close(whole.near[k : k + 1], alone.near)
        torch.testing.assert_close(whole.bent_normal[k : k + 1], alone.bent_normal)


def test_empty_pixels_see_everything_and_empty_batches_nothing() -> None:
    scene = Scene(meshes=(box(torch.tensor([1.0, 1.0, 1.0])),))
    found, rays, covered = both(scene, camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    for one in (found, rays):
        assert bool((one.sky[~covered] == 1).all()) and bool((one.bent_normal[~covered] == 0).all())
    none = camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))[[]]
    assert horizon_ambient(scene.geometry, rasterize(scene, none), FINE, reach=1.0).sky.shape == (0, 48, 48)


def test_where_nothing_is_seen_nothing_around_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """One picture of two looks at the sky; of two that do none draws anything."""
    scene = Scene(meshes=(box(torch.ones(3)),))
    there, up = camera((3.0, 2.0, 3.0), (0.0, 0.0, 0.0)), camera((3.0, 2.0, 3.0), (3.1, 9.0, 3.0))
    drawn = []
    real = horizon.rasterize_visibility
    monkeypatch.setattr(horizon, "rasterize_visibility", lambda *a, **k: drawn.append(1) or real(*a, **k))
    seen = rasterize(scene, Cameras.cat([there, up]))
    found = horizon_ambient(scene.geometry, seen, AmbientOptions(), reach=1.0)
    of_one, alone = len(drawn), horizon_ambient(scene.geometry, rasterize(scene, there), AmbientOptions(), reach=1.0)
    assert len(drawn) == 2 * of_one and torch.equal(found.sky[:1], alone.sky) and bool((found.sky[1] == 1).all())
    empty = horizon_ambient(scene.geometry, rasterize(scene, Cameras.cat([up, up])), AmbientOptions(), reach=1.0)
    assert len(drawn) == 2 * of_one > 0
    assert empty.sky.shape == empty.near.shape == (2, 48, 48) and bool((empty.near == 1).all())
    assert empty.bent_normal.shape == (2, 48, 48, 3) and not bool(empty.bent_normal.any())


def test_bad_input_is_named() -> None:
    scene = Scene(meshes=(box(torch.tensor([1.0, 1.0, 1.0])),))
    view = camera((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), 8)
    seen = rasterize(scene, replace(view, orthographic=True, far=torch.tensor(100.0, dtype=torch.float64)))
    with pytest.raises(InputError, match="gbuffer"):
        horizon_ambient(scene.geometry, seen, FINE, reach=1.0)
    with pytest.raises(OptionError, match="rays"):
        traced_ambient(RayCaster(scene.geometry), seen, rays=0, reach=1.0)
    for name in ("slices", "steps", "spacing", "ray_spacing", "rays"):
        with pytest.raises(OptionError, match=name):
            AmbientOptions(**{name: 0})
    with pytest.raises(OptionError, match="reach"):
        AmbientOptions(reach=-1.0)


def test_walls_seen_edge_on_are_told_from_others() -> None:
    """An eye in a wall's plane has no picture of it, wherever it looks; a little aside it has."""
    wall = quad(torch.tensor([-1.0, 0.0, -3.0]), torch.tensor([4.0, 0.0, 0.0]), torch.tensor([0.0, 3.0, 0.0]))
    floor = quad(torch.tensor([-4.0, 0.0, 4.0]), torch.tensor([8.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, -8.0]))
    geometry = Scene(meshes=(wall, floor)).geometry

    def eye(x: float, z: float) -> Cameras:
        return Cameras.look_at([x, 1.0, z], [0.0, 0.5, 1.0], width=32, height=24)

    inside, aside = eye(-5.0, -3.0), eye(-5.0, -2.9)
    assert sees_edge_on(geometry, inside).tolist() == [True]
    assert sees_edge_on(geometry, Cameras.cat([aside, inside])).tolist() == [False, True]
    assert sees_edge_on(geometry, aside).tolist() == [False] and not len(sees_edge_on(geometry, inside[:0]))
    assert sees_edge_on(Scene(meshes=(floor,)).geometry, inside).tolist() == [False]


def test_rays_below_the_surface_see_nothing() -> None:
    """A shading normal 60 degrees aside turns a part of its hemisphere below: (1 + cos) / 2 of the sky is left."""
    floor = quad(torch.tensor([-9.0, 0.0, 9.0]), torch.tensor([18.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, -18.0]))
    aside = torch.tensor([math.sin(math.pi / 3), math.cos(math.pi / 3), 0.0]).expand(len(floor.vertices), 3)
    scene = Scene(meshes=(replace(floor, normals=aside),))
    seen = rasterize(scene, Cameras.look_at([0.0, 4.0, 0.1], [0.0, 0.0, 0.0], width=12, height=12, fov_deg=30.0))
    elsewhere = Scene(meshes=(replace(floor, vertices=floor.vertices + torch.tensor([0.0, 99.0, 999.0])),))
    for hides in (scene, elsewhere):  # itself, or nothing
        found = traced_ambient(RayCaster(hides), seen, rays=256, reach=1.0)
        assert bool(seen.covered.all()) and float(found.sky.mean()) == pytest.approx(0.75, abs=0.01)
        assert float(found.near.mean()) == pytest.approx(0.75, abs=0.01)
