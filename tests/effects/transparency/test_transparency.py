"""Panes before each other: closed forms, their order, many of them, and layers peeled beside layers found by rays."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.buffers import RayHits
from torchrender.effects.transparency import pane_shadow as shadows_of_panes
from torchrender.effects.transparency.layers import deepest_layers, transparency
from torchrender.effects.transparency.pane_shadow import pane_shadow, pane_shadows
from torchrender.effects.transparency.passing import passing_light
from torchrender.errors import OptionError
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, quad, sphere


def pane(z: float, material: int, size: float = 4.0) -> Mesh:
    corner = torch.tensor([-size / 2, -size / 2, z])
    return replace(quad(corner, torch.tensor([size, 0.0, 0.0]), torch.tensor([0.0, size, 0.0])), material=material)


def glowing(color: tuple[float, ...], opacity: float, **other: object) -> Material:
    return Material(unlit=True, diffuse=torch.tensor(color), opacity=opacity, blend=True, **other)


def view(size: int = 16, **other: float) -> Cameras:
    return Cameras.look_at(torch.tensor([0.0, 0.0, 5.0]), torch.zeros(3), fov_deg=30, width=size, height=size, **other)


def white(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
    del origins, directions, width
    return torch.ones(len(hits.t), 3)


def centre(scene: Scene, **options: object) -> Tensor:
    picture = render(scene, view(), options=RenderOptions(background=torch.tensor([0.0, 0.0, 1.0]), **options))
    return picture.radiance[0, 8, 8]


RED, GREEN = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


@pytest.mark.parametrize("way", ["peeled", "traced"])
def test_two_panes_cover_as_their_alphas_say_whatever_their_order_in_the_scene(way: str) -> None:
    near, far = glowing(RED, 0.25), glowing(GREEN, 0.5)
    wanted = torch.tensor([0.25, 0.75 * 0.5, 0.75 * 0.5])
    for meshes in ((pane(1.0, 0), pane(0.0, 1)), (pane(0.0, 1), pane(1.0, 0))):
        scene = Scene(meshes=meshes, materials=(near, far))
        torch.testing.assert_close(centre(scene, transparency=way), wanted, atol=1e-5, rtol=0)


def test_solids_hide_panes_behind_them_and_show_through_those_before() -> None:
    materials = (glowing(RED, 0.5), Material(unlit=True, diffuse=torch.tensor(GREEN)))
    before = Scene(meshes=(pane(1.0, 0), pane(0.0, 1)), materials=materials)
    torch.testing.assert_close(centre(before), torch.tensor([0.5, 0.5, 0.0]))
    behind = Scene(meshes=(pane(-1.0, 0), pane(0.0, 1)), materials=materials)
    torch.testing.assert_close(centre(behind), torch.tensor([0.0, 1.0, 0.0]))


def test_alpha_zero_everywhere_changes_nothing() -> None:
    solid = Material(unlit=True, diffuse=torch.tensor(GREEN))
    bare = Scene(meshes=(pane(0.0, 0, 1.0),), materials=(solid,))
    covered = Scene(meshes=(pane(0.0, 0, 1.0), pane(1.0, 1)), materials=(solid, glowing(RED, 0.0)))
    assert torch.equal(render(bare, view()).radiance, render(covered, view()).radiance)
    only = Scene(meshes=(pane(1.0, 0),), materials=(glowing(RED, 0.0),))
    torch.testing.assert_close(centre(only), torch.tensor([0.0, 0.0, 1.0]))


@pytest.mark.parametrize("way", ["peeled", "traced"])
def test_sixty_four_layers(way: str) -> None:
    opacity = 0.05
    meshes = tuple(pane(-0.05 * n, 0) for n in range(64))
    scene = Scene(meshes=meshes, materials=(glowing(RED, opacity),))
    left = (1 - opacity) ** 64
    torch.testing.assert_close(centre(scene, transparency=way), torch.tensor([1 - left, 0.0, left]), atol=1e-5, rtol=0)
    plan = render(scene, view()).plan
    assert plan is not None and "64 layers" in plan.row("transparency").reason
    few = centre(scene, transparency=way, transparent_layers=8)
    kept = (1 - opacity) ** 8
    torch.testing.assert_close(few, torch.tensor([1 - kept, 0.0, kept]), atol=1e-5, rtol=0)


def test_vertex_and_texture_alpha_multiply_the_materials() -> None:
    texture = torch.ones(2, 2, 4)
    texture[..., 3] = 0.5
    mesh = replace(pane(0.0, 0), alpha=torch.full((4,), 0.5))
    scene = Scene(meshes=(mesh,), materials=(glowing(RED, 0.8, diffuse_texture=texture),))
    torch.testing.assert_close(centre(scene), torch.tensor([0.2, 0.0, 0.8]), atol=1e-5, rtol=0)


def test_a_thin_wall_lets_its_colour_pass_but_for_what_it_mirrors() -> None:
    glass = Material(metallic=0.0, roughness=0.0, transmission=1.0, diffuse=torch.tensor([1.0, 0.5, 0.25]))
    scene = Scene(meshes=(pane(0.0, 0),), materials=(glass,))
    seen = transparency(scene, rasterize(scene, view()), white)
    expected = (1 - 0.04) * torch.tensor([1.0, 0.5, 0.25])
    torch.testing.assert_close(seen.passing[0, 8, 8], expected, atol=2e-3, rtol=0)
    assert int(seen.layers.max()) == 1


def test_half_covered_glass_shows_half_of_what_lies_behind_and_metal_none() -> None:
    """What passes is linear in the alpha of a pane; what of it is metal lets nothing pass where it covers."""

    def passing(opacity: float, metallic: float) -> Tensor:
        glass = Material(
            metallic=metallic, roughness=0.3, transmission=0.8, diffuse=torch.tensor([0.9, 0.5, 0.2]),
            opacity=opacity, blend=True,
        )  # fmt: skip
        scene = Scene(meshes=(pane(0.0, 0),), materials=(glass,))
        start, down = (
            torch.tensor([[0.1, 0.2, 3.0]], dtype=torch.float64),
            torch.tensor([[0.0, 0.0, -1.0]], dtype=torch.float64),
        )
        hits = RayCaster(scene.geometry.panes).first_hit(start, down)
        return passing_light(scene, start, down, hits)[1][0]

    whole = passing(1.0, 0.0)
    assert float(whole.min()) > 0.05
    for opacity in (0.0, 0.25, 0.6):
        torch.testing.assert_close(passing(opacity, 0.0), 1.0 - opacity + opacity * whole)
        torch.testing.assert_close(passing(opacity, 1.0), torch.full((3,), 1.0 - opacity))


@pytest.mark.parametrize(("count", "opacity", "said"), [(70, 0.02, True), (64, 0.02, False), (70, 0.5, False)])
def test_layers_that_are_left_out_are_said(count: int, opacity: float, said: bool) -> None:
    """Unless nothing shines through those before them."""
    panes = tuple(pane(-0.01 * k, 0) for k in range(count))
    scene = Scene(meshes=panes, materials=(glowing(RED, opacity),), ambient=torch.full((3,), 0.1))
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        render(scene, view(8))
    told = [str(w.message) for w in found if "see-through surfaces before each other" in str(w.message)]
    assert bool(told) == said
    if said:
        render(scene, view(8), options=RenderOptions(transparent_layers=128))


@pytest.mark.parametrize("orthographic", [False, True])
def test_peeled_layers_are_those_that_rays_find(orthographic: bool) -> None:
    balls = tuple(
        replace(b, vertices=b.vertices + torch.tensor([0.3 * k - 0.5, 0.2 * k, -0.4 * k]), material=k % 2)
        for k, b in enumerate([sphere(0.6, segments=24)] * 4)
    )
    ground = pane(-1.5, 2)
    scene = Scene(
        meshes=(*balls, ground),
        materials=(glowing(RED, 0.3), glowing(GREEN, 0.6), Material()),
    )
    cameras = view(40)
    if orthographic:
        k = torch.tensor([[[12.0, 0, 20], [0, 12.0, 20], [0, 0, 1]]], dtype=torch.float64)
        cameras = replace(cameras, intrinsics=k, orthographic=True, far=torch.tensor(50.0, dtype=torch.float64))
    seen = rasterize(scene, cameras)
    peeled, traced = (transparency(scene, seen, white, traced=way) for way in (False, True))
    same = (peeled.passing - traced.passing).abs().amax(dim=-1) < 1e-4
    assert float(same.float().mean()) > 0.995  # the rasteriser snaps outlines to a fraction of a pixel
    assert int(peeled.layers.max()) >= 4
    torch.testing.assert_close(peeled.passing + peeled.radiance, torch.ones_like(peeled.passing))
    assert deepest_layers(scene, cameras) >= int(peeled.layers.max())


def test_panes_take_their_part_of_the_light() -> None:
    materials = (Material(), glowing(RED, 0.25), glowing(RED, 0.5))
    floor, one, two = pane(0.0, 0), pane(1.0, 1, 1.0), pane(1.5, 2, 1.0)
    light = DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0]))
    scene = Scene(meshes=(floor, one, two), materials=materials, lights=(light,))
    seen = rasterize(scene, view(33))
    share = pane_shadow(scene, RayCaster(scene.geometry.panes), light, seen)[0]
    assert float(share[16, 16]) == pytest.approx(0.375, abs=1e-5)
    assert float(share[16, 2]) == 1.0


def test_what_panes_let_pass_is_found_once_for_all_surfaces_and_lights(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many rays and hits go together, the shares are the same."""
    materials = (Material(), glowing(RED, 0.25), glowing(RED, 0.5))
    meshes = (pane(0.0, 0), pane(1.0, 1, 1.0), pane(1.5, 2, 1.5))
    lights = (
        DirectionalLight(direction=torch.tensor([0.3, 0.0, -1.0])),
        PointLight(position=torch.tensor([0.0, 0.5, 1.2]), intensity=torch.ones(3)),
        DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0])),
    )
    scene = Scene(meshes=meshes, materials=materials, lights=lights)
    seen, panes, asked = rasterize(scene, view(17)), RayCaster(scene.geometry.panes), []

    def counting(*given: Any) -> Any:
        asked.append(len(given[1]))
        return passing_light(*given)

    monkeypatch.setattr(shadows_of_panes, "passing_light", counting)
    together = pane_shadows(scene, panes, lights, seen)
    assert len(asked) == 1
    assert len(together.unique()) >= 4  # none, either and both of the panes
    monkeypatch.setattr(shadows_of_panes, "RAYS", 1)
    monkeypatch.setattr(shadows_of_panes, "TOGETHER", 1)
    torch.testing.assert_close(together, pane_shadows(scene, panes, lights, seen), rtol=1e-6, atol=1e-6)
    assert len(asked) == 1 + 2 + 1 + 2  # each layer of each light
    alone = [pane_shadow(scene, panes, light, seen) for light in lights]
    torch.testing.assert_close(together, torch.stack(alone, dim=1), rtol=1e-6, atol=1e-6)
    assert pane_shadows(scene, panes, (), seen).shape == (1, 0, 17, 17)


def test_a_light_inside_glass_gets_out_in_part() -> None:
    materials = (Material(), glowing(RED, 0.5))
    glass = replace(box(torch.tensor([0.5, 0.5, 0.5])), material=1)
    light = PointLight(position=torch.zeros(3), intensity=torch.full((3,), 4.0))
    lit = Scene(meshes=(pane(-1.0, 0),), materials=materials, lights=(light,))
    behind = replace(lit, meshes=(pane(-1.0, 0), glass))
    off = RenderOptions(transparency="off", background=torch.zeros(3))
    bare, half = (render(s, view(), options=off).radiance[0, 8, 2] for s in (lit, behind))
    assert float(bare.max()) > 0.05
    torch.testing.assert_close(half, 0.5 * bare, rtol=1e-3, atol=1e-6)


def test_rays_and_shadow_maps_pass_panes() -> None:
    scene = Scene(meshes=(pane(0.0, 0),), materials=(glowing(RED, 0.9),))
    assert not bool(rasterize(scene, view()).covered.any())
    hit = RayCaster(scene.geometry).first_hit(torch.tensor([[0.1, 0.0, 5.0]]), torch.tensor([[0.0, 0.0, -1.0]]))
    assert not bool(hit.hit.any())


def test_vertex_alpha_below_the_cut_off_is_a_hole() -> None:
    solid = Material(unlit=True, diffuse=torch.tensor(RED), alpha_cutoff=0.5)
    for alpha, wanted in ((0.4, (0.0, 0.0, 1.0)), (0.6, RED)):
        mesh = replace(pane(0.0, 0), alpha=torch.full((4,), alpha))
        torch.testing.assert_close(centre(Scene(meshes=(mesh,), materials=(solid,))), torch.tensor(wanted))
    faint = replace(solid, opacity=0.3)
    torch.testing.assert_close(centre(Scene(meshes=(pane(0.0, 0),), materials=(faint,))), torch.tensor([0.0, 0.0, 1.0]))


def test_nothing_to_see_through_is_said() -> None:
    plan = render(Scene(meshes=(pane(0.0, 0),), materials=(Material(),)), view()).plan
    assert plan is not None and plan.row("transparency").reason == "nothing shows what lies behind"
    away = Scene(meshes=(pane(9.0, 0),), materials=(glowing(RED, 0.5),))
    plan = render(away, view()).plan
    assert plan is not None and "in view" in plan.row("transparency").reason


def test_bad_options_are_named() -> None:
    with pytest.raises(OptionError, match="transparent_layers"):
        RenderOptions(transparent_layers=0)
    with pytest.raises(OptionError, match="transparency"):
        RenderOptions(transparency="sorted")
    scene = Scene(meshes=(pane(0.0, 0),), materials=(glowing(RED, 0.5),))
    with pytest.raises(OptionError, match="layers"):
        transparency(scene, rasterize(scene, view()), white, layers=0)


# ---------------------------------------------------------- the sky in a picture


def test_no_sky_shines_into_a_closed_box() -> None:
    room = box(torch.tensor([4.0, 3.0, 5.0]))
    scene = Scene(meshes=(room,), environment=Environment.constant(torch.ones(3)))
    inside = Cameras.look_at(
        torch.tensor([0.5, 0.1, 1.5]), torch.tensor([0.0, -0.1, -3.0]), fov_deg=60, width=64, height=64
    )
    lit = render(scene, inside)
    assert float(lit.radiance.max()) < 0.02
    open_ = render(scene, inside, options=RenderOptions(ambient_visibility="off"))
    assert float(open_.radiance.min()) == pytest.approx(0.8, abs=1e-3)
    traced = render(scene, inside, options=RenderOptions(ambient_visibility="traced"))
    assert float(traced.radiance.max()) == 0.0


def test_ambient_visibility_does_not_run_without_ambient_light() -> None:
    room = box(torch.tensor([4.0, 3.0, 5.0]))
    scene = Scene(meshes=(room,), lights=(PointLight(position=torch.zeros(3)),))
    plan = render(scene, view()).plan
    assert plan is not None and plan.row("ambient_visibility").reason == "no ambient light"


def test_the_sun_of_a_sky_casts_a_shadow() -> None:
    sky = torch.full((64, 128, 3), 0.2)
    sky[8, 40] = 20000.0
    ground = quad(torch.tensor([-3.0, 0.0, 3.0]), torch.tensor([6.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, -6.0]))
    block = box(torch.tensor([0.8, 0.8, 0.8]))
    block = replace(block, vertices=block.vertices + torch.tensor([0.0, 0.8, 0.0]))
    scene = Scene(meshes=(ground, block), environment=Environment(radiance=sky))
    above = Cameras.look_at(torch.tensor([0.0, 6.0, 4.0]), torch.zeros(3), fov_deg=50, width=96, height=96)
    picture = render(scene, above).radiance[0].mean(dim=-1)
    seen = rasterize(scene, above)
    floor = seen.object_id[0] == 0
    bright = float(picture[floor].quantile(0.9))
    dark = (picture < 0.3 * bright) & floor
    assert 0.01 < float(dark.float().sum() / floor.float().sum()) < 0.2


@pytest.mark.parametrize("way", [False, True], ids=["peeled", "traced"])
def test_layers_are_shaded_as_wide_as_a_pixel_is_there(way: bool) -> None:
    """Farther panes are seen through wider rays: textures on them are read coarser."""
    widths = []

    def shader(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
        widths.append(width)
        return white(origins, directions, width, hits)

    scene = Scene(meshes=(pane(2.0, 0), pane(-3.0, 0)), materials=(glowing(RED, 0.5),))
    camera = view()
    found = transparency(scene, rasterize(scene, camera), shader, traced=way)
    one = float(camera.footprint(torch.ones(1, 1, dtype=torch.float64)))
    (width,) = widths  # so few hits are shaded together
    wanted = [torch.full((int((found.layers > n).sum()),), depth * one) for n, depth in enumerate((3.0, 8.0))]
    torch.testing.assert_close(width.double(), torch.cat(wanted).double(), rtol=1e-5, atol=0)


@pytest.mark.parametrize("orthographic", (False, True))
@pytest.mark.parametrize("glow", (0.0, 1.0))
@pytest.mark.parametrize("height", (0.5, 1.5, 1.9, 2.5))
def test_each_pane_is_fogged_as_far_as_it_is_away(height: float, glow: float, orthographic: bool) -> None:
    """A half opaque pane that sends blue light, over a white floor, below, in and above a fog of one unit.

    ``(o p + (1 - o) (w t_behind + e (1 - t_behind))) t_before + e (1 - t_before)`` with the fog's transmittances t.
    """
    floor = Material(diffuse=torch.zeros(3), emission=torch.ones(3))
    blue = Material(diffuse=torch.zeros(3), opacity=0.5, blend=True, emission=torch.tensor([0.0, 0.0, 1.0]))
    fog = tr.Medium(low=[-1, 1, -1], high=[1, 2, 1], absorption=1.0, scattering=0.0, emission=glow)
    meshes = (tr.Mesh.plane(4), tr.Mesh.plane(1.5, [0, height, 0], material=1))
    scene = Scene(meshes=meshes, materials=(floor, blue), media=(fog,))
    camera = Cameras.look_at([0.001, 3, 0], [0, 0, 0], width=17, height=17, fov_deg=20, up=[0, 0, -1])
    if orthographic:
        lens = torch.tensor([[[10.0, 0.0, 8.5], [0.0, 10.0, 8.5], [0.0, 0.0, 1.0]]], dtype=torch.float64)
        near, far = torch.tensor([0.01]).double(), torch.tensor([100.0]).double()
        camera = Cameras(camera.camera_from_world, lens, 17, 17, near, far, orthographic=True)
    before = math.exp(-max(0.0, 2.0 - max(height, 1.0)))
    behind = math.exp(-1.0) / before
    through = 0.5 * (behind + glow * (1.0 - behind))
    wanted = torch.tensor([through, through, through + 0.5]) * before + glow * (1.0 - before)
    found = tr.render(scene, camera).radiance[0, 8, 8]
    assert torch.allclose(found, wanted, atol=2e-3), (found, wanted)
