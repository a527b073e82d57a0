"""Cameras of lights that follow the view: they hold what is seen, as finely as they can, and stand still."""

from __future__ import annotations

import math

import pytest
import torch

from shadow_scenes import box, floor
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.view_cameras import MOST_CASCADES, same_views, view_cameras
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene

SUN = DirectionalLight(direction=torch.tensor([0.4, -1.0, 0.3]))
LIGHTS = {
    "sun": SUN,
    "spot": SpotLight(position=torch.tensor([0.0, 60.0, 0.0]), direction=torch.tensor([0.0, -1, 0.2]), outer_deg=50.0),
    "point": PointLight(position=torch.tensor([3.0, 5.0, 60.0])),
    "rect": RectLight(
        corner=torch.tensor([0.0, 30.0, 0.0]), edge_u=torch.tensor([4.0, 0, 0]), edge_v=torch.tensor([0, 0, 4.0])
    ),
}  # fmt: skip
STREET = Scene(meshes=(floor(100.0), *(box((x, 0, z), (x + 4, 9, z + 4)) for x in (-9, 5) for z in (60, 30, 0, -60))))
OPTIONS = ShadowOptions(size=(200, 256))


def walker(x: float = 0.0, turn: float = 0.0, size: int = 96) -> Cameras:
    eye = torch.tensor([x, 2.0, 80.0])
    ahead = eye + torch.tensor([math.sin(turn), 0.0, -math.cos(turn)])
    return Cameras.look_at(eye, ahead, width=size, height=size * 3 // 4, near=0.5)


def receives(light, seen) -> torch.Tensor:
    """(B,H,W) bool: pixels whose surface faces the light, inside its cone."""
    if isinstance(light, DirectionalLight):
        return seen.covered & ((seen.geometric_normal @ -light.direction) > 0)
    place = light.centre if isinstance(light, RectLight) else light.position
    toward = torch.nn.functional.normalize(place.double() - seen.position, dim=-1)
    found = seen.covered & ((toward * seen.geometric_normal).sum(-1) > 0)
    if isinstance(light, SpotLight):
        found &= (toward @ -light.direction.double()) >= math.cos(math.radians(light.outer_deg))
    return found & ((toward @ -light.normal.double()) > 0) if isinstance(light, RectLight) else found


@pytest.mark.parametrize("name", LIGHTS)
def test_every_receiver_lies_in_a_view_with_room_for_filters(name):
    light, seen = LIGHTS[name], rasterize(STREET, walker())
    cameras, starts = view_cameras(STREET, light, seen, OPTIONS)
    points = seen.position[receives(light, seen)]
    assert starts == (0, len(cameras)) and len(points) > 500
    uv, z = cameras.project(points)
    size, border = torch.tensor([256.0, 200.0]), OPTIONS.border
    inside = ((uv >= border - 1e-6) & (uv <= size - border + 1e-6)).all(-1)
    assert bool((inside & (z > cameras.near[:, None]) & (z < cameras.far[:, None])).any(0).all())


def test_casters_outside_the_view_are_in_the_depth_range():
    seen = rasterize(STREET, walker())
    cameras, _ = view_cameras(STREET, SUN, seen, OPTIONS)
    z = cameras.transform(STREET.geometry.vertices)[..., 2]
    assert bool((z > cameras.near[:, None]).all())


def test_views_of_a_light_that_reaches_nothing_are_none():
    away = SpotLight(position=torch.tensor([0.0, 50.0, 0.0]), direction=torch.tensor([0.0, 1.0, 0.0]), outer_deg=20.0)
    cameras, starts = view_cameras(STREET, away, rasterize(STREET, walker()), OPTIONS)
    assert len(cameras) == 0 and starts == (0, 0)


def test_a_point_light_gets_only_faces_in_which_something_is_seen():
    behind = PointLight(position=torch.tensor([0.0, 5.0, 95.0]))
    cameras, _ = view_cameras(STREET, behind, rasterize(STREET, walker()), OPTIONS)
    assert 1 <= len(cameras) < 6


def test_near_slices_are_finer_and_their_number_is_as_asked():
    seen = rasterize(STREET, walker())
    for count in (1, 2, 3, 5):
        cameras, _ = view_cameras(STREET, SUN, seen, ShadowOptions(size=256, cascades=count))
        focal = cameras.intrinsics[:, 0, 0]
        assert len(cameras) == count and bool((focal.diff() <= 0).all())
    assert float(focal[0]) > 4 * float(focal[-1])


def test_as_many_slices_as_make_texels_small_beside_pixels():
    """One where the picture is coarse beside the map; more down a street; never more than the most."""
    down = Cameras.look_at((0.0, 150.0, 0.0), (0.0, 0.0, -1.0), width=96, height=72)
    small = view_cameras(STREET, SUN, rasterize(STREET, down), ShadowOptions(size=512))[0]
    assert len(small) == 1
    far = view_cameras(STREET, SUN, rasterize(STREET, walker(size=400)), ShadowOptions(size=64))[0]
    assert 2 <= len(far) <= MOST_CASCADES


def test_texels_stand_still_while_the_view_moves_and_turns():
    first, _ = view_cameras(STREET, SUN, rasterize(STREET, walker()), ShadowOptions(size=256, cascades=3))
    fixed, moved_at_all = torch.tensor([[3.0, 0.0, 5.0]]), 0
    for view in (walker(0.37), walker(1.9), walker(turn=0.01), walker(5.0, 0.2)):
        moved, _ = view_cameras(STREET, SUN, rasterize(STREET, view), ShadowOptions(size=256, cascades=3))
        for a, b in zip(range(len(first)), range(len(moved)), strict=True):
            if torch.equal(first.intrinsics[a, (0, 1), (0, 1)], moved.intrinsics[b, (0, 1), (0, 1)]):
                shift = moved[b].project(fixed)[0] - first[a].project(fixed)[0]
                assert float((shift - shift.round()).abs().max()) < 1e-6
                moved_at_all += 1
    assert moved_at_all >= 6


def test_a_small_step_changes_nothing():
    """Windows move in steps: a map of the last picture then serves again, texel by texel."""
    first, _ = view_cameras(STREET, SUN, rasterize(STREET, walker()), OPTIONS)
    again, _ = view_cameras(STREET, SUN, rasterize(STREET, walker(1e-4)), OPTIONS)
    assert same_views(first, again)
    other, _ = view_cameras(STREET, SUN, rasterize(STREET, walker(20.0)), OPTIONS)
    assert not same_views(first, other)


def test_pictures_of_a_batch_have_the_views_that_they_have_alone():
    views = [walker(), walker(15.0, 0.3)]
    both, starts = view_cameras(STREET, SUN, rasterize(STREET, Cameras.cat(views)), OPTIONS)
    for b, view in enumerate(views):
        alone, _ = view_cameras(STREET, SUN, rasterize(STREET, view), OPTIONS)
        assert same_views(both[slice(starts[b], starts[b + 1])], alone)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("offset", [0.0, 3e6])
def test_depths_are_small_beside_float32_at_any_scale_and_place(scale, offset):
    """A depth of the map is at most a few hundred thousand texels: float32 then holds it to a small part of one."""
    move = torch.tensor([offset, -offset, offset / 2], dtype=torch.float64) * scale
    street = Scene(meshes=tuple(
        type(m)(vertices=m.vertices.double() * scale + move, faces=m.faces, name=m.name) for m in STREET.meshes
    ))  # fmt: skip
    eye = torch.tensor([0.0, 2.0, 80.0], dtype=torch.float64) * scale + move
    view = Cameras.look_at(eye, eye + torch.tensor([0.0, -0.2, -1.0]) * scale, width=96, height=72, near=0.01 * scale)
    seen = rasterize(street, view)
    cameras, _ = view_cameras(street, SUN, seen, OPTIONS)
    z = cameras.transform(seen.position[seen.covered])[..., 2].abs().amax(1)
    texels = z * cameras.intrinsics[:, 0, 0]
    assert float(texels.max()) < 2**18
