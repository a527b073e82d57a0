"""Soft shadows where numbers get difficult: lights without area, in geometry, behind receivers, in their planes."""

from __future__ import annotations

import pytest
import torch

from shadow_scenes import box, flat_image, floor, quad
from torchrender.effects.shadows.light_samples import corner_grid, light_grid
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions, soft_shadow
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene

VISIBILITIES = ("ray", "shadow_map")


def light(corner, u, v) -> RectLight:
    return RectLight(corner=torch.tensor(corner), edge_u=torch.tensor(u), edge_v=torch.tensor(v))


def blocked_floor() -> Scene:
    return Scene(meshes=(floor(), box((-1.0, 1.0, -1.0), (1.0, 1.2, 1.0))))


@pytest.mark.parametrize("visibility", VISIBILITIES)
def test_point_light_gives_a_hard_shadow_and_says_so(visibility: str) -> None:
    scene = blocked_floor()
    buffer = rasterize(scene, flat_image())
    options = SoftShadowOptions(visibility=visibility)
    result = soft_shadow(scene.geometry, light((0.0, 4.0, 0.0), (0.0,) * 3, (0.0,) * 3), buffer, options)
    assert result.sample_count == (1,) and "hard shadow" in result.notes[0]
    on_floor = buffer.covered & (buffer.position[..., 1] < 0.5)
    reach = buffer.position[..., [0, 2]].abs().amax(-1)
    # The box's lower face at height 1 throws the larger shadow from its upper face at 1.2: half width 4 / 2.8.
    dark, bright = on_floor & (reach < 4 / 2.8 - 0.05), on_floor & (reach > 4 / 2.8 + 0.05)
    assert bool((result.lit[:, 0][dark] == 0).all()) and bool((result.lit[:, 0][bright] == 1).all())


@pytest.mark.parametrize(("u", "v"), [((2.0, 0.0, 0.0), (0.0, 0.0, 0.0)), ((2.0, 0.0, 0.0), (-1.0, 0.0, 0.0))])
def test_line_light(u, v) -> None:
    scene = blocked_floor()
    result = soft_shadow(scene.geometry, light((-1.0, 4.0, 0.0), u, v), rasterize(scene, flat_image()))
    assert result.sample_count == (16,) and "line" in result.notes[0]
    assert int((result.lit == 0).sum()) > 0 and bool(((result.lit > 0) & (result.lit < 16)).any())


@pytest.mark.parametrize("visibility", VISIBILITIES)
@pytest.mark.parametrize("height", [1.1, 0.0, 1e-6, -3.0])
def test_light_inside_touching_and_behind(visibility: str, height: float) -> None:
    scene = blocked_floor()
    buffer = rasterize(scene, flat_image(60, 48))
    options = SoftShadowOptions(visibility=visibility, light_samples=4, map_size=128)
    result = soft_shadow(scene.geometry, light((-0.5, height, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), buffer, options)
    assert bool(torch.isfinite(result.visibility).all())
    assert int(result.lit.min()) >= 0 and int(result.lit.max()) <= 16
    seen = result.lit[:, 0][buffer.covered]
    # Inside the box, in the floor's plane or below it: no floor point in view sees the light.
    assert bool((seen == 0).all()) or height == 1e-6


def test_one_sample() -> None:
    scene = blocked_floor()
    result = soft_shadow(
        scene.geometry,
        light((-1.0, 4.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0)),
        rasterize(scene, flat_image()),
        SoftShadowOptions(light_samples=1),
    )
    assert set(result.lit.unique().tolist()) == {0, 1} and not result.notes


def test_receivers_outside_the_maps_are_lit_and_counted() -> None:
    scene = Scene(meshes=(floor(), box((-1.0, 1.0, -1.0), (1.0, 1.2, 1.0))))
    buffer = rasterize(scene, flat_image())
    small = torch.tensor([[-0.5, 1.0, -0.5], [0.5, 1.2, 0.5]], dtype=torch.float64)
    overhead = light((-0.5, 4.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    result = soft_shadow(
        scene.geometry, overhead, buffer, SoftShadowOptions(light_samples=4, engine="packets"), bounds=small
    )
    assert result.outside[0] > 0
    far = buffer.covered & (buffer.position[..., [0, 2]].abs().amax(-1) > 3.0)
    assert bool((result.lit[:, 0][far] == 16).all())


@pytest.mark.parametrize("shift", [0.0, 1e4])
def test_far_from_the_origin(shift: float) -> None:
    half = quad((-2.0 + shift, 1.0, 2.0), (2.0, 0.0, 0.0), (0.0, 0.0, -4.0))
    ground = quad((-2.0 + shift, 0.0, 2.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0))
    camera = Cameras.look_at((shift, 8.0, 0.0), (shift, 0.0, -1e-3), width=40, height=40, fov_deg=25.0)
    buffer = rasterize(Scene(meshes=(ground,)), camera)
    lamp = light((shift - 0.5, 3.0, -0.5), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    result = soft_shadow(Scene(meshes=(ground, half)).geometry, lamp, buffer)
    x = buffer.position[0, 20, :, 0] - shift
    expected = ((0.5 + 2.0 * x) / 1.0).clamp(0.0, 1.0)
    assert float((result.visibility[0, 0, 20] - expected).abs().max()) <= 1 / 16 + 0.01


def test_light_cameras_see_the_box_and_no_more() -> None:
    bounds = torch.tensor([[-1.0, 0.0, -2.0], [1.0, 1.0, 2.0]], dtype=torch.float64)
    lamp = light((-1.0, 5.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0))
    corners = bounds[0] + torch.cartesian_prod(*[torch.tensor([0.0, 1.0])] * 3).double() * (bounds[1] - bounds[0])
    for grid in (light_grid(lamp, bounds, per_side=3, size=256), corner_grid(lamp, bounds, size=256)):
        for s in range(len(grid.samples)):
            camera = grid.cameras(s)
            assert len(camera) == 1
            pixel, depth = camera.project(corners)
            assert bool((depth > 0).all())
            assert float((pixel - 128).abs().max()) == pytest.approx(128, abs=0.01)
            middle, _ = camera.project(bounds.mean(0)[None])
            assert torch.allclose(middle, torch.full((1, 1, 2), 128.0, dtype=torch.float64), atol=1e-6)


def test_a_light_inside_the_box_takes_cubes_that_cover_everything() -> None:
    bounds = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]], dtype=torch.float64)
    grid = light_grid(light((0.0, 0.0, 0.0), (0.2, 0.0, 0.0), (0.0, 0.2, 0.0)), bounds, per_side=2, size=64)
    directions = torch.nn.functional.normalize(torch.randn(500, 3, dtype=torch.float64, generator=torch.manual_seed(0)))
    camera = grid.cameras(1)
    assert len(camera) == 6
    pixel, depth = camera.project(grid.samples[1] + directions)
    inside = (depth > 0) & (pixel >= 0).all(-1) & (pixel <= 64).all(-1)
    assert bool(inside.any(0).all())
    assert torch.allclose(torch.linalg.det(camera.rotation), torch.ones(6, dtype=torch.float64))
