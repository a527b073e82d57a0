"""Reports on shadow maps: known densities, measured contact displacement, counted errors, ray-cast truth."""

from __future__ import annotations

import math

import pytest
import torch

from shadow_scenes import box, flat_image, floor, on_plane, quad
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map, shadow_factor
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.errors import InputError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.shadow_maps.everywhere import box_on_ground
from torchrender.report.shadow_maps.quality import (
    aliasing_ratio,
    contact_displacement,
    faces,
    naive_shading,
    shadow_errors,
)
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene
from torchrender.shade import shade

DOWN = DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0]))


def test_errors_are_counted_by_kind():
    reference = torch.tensor([[[1.0, 1.0, 0.0, 0.0, 1.0]]])
    found = torch.tensor([[[0.0, 0.75, 1.0, 0.25, 0.0]]])
    counted = torch.tensor([[[True, True, True, True, False]]])
    errors = shadow_errors(found, reference, counted)
    assert (errors.false_shadow, errors.false_light, errors.mean_error) == (0.25, 0.25, 0.625)
    assert shadow_errors(found, reference, ~counted & False).mean_error == 0
    with pytest.raises(InputError, match="counted"):
        shadow_errors(found, reference, counted[0])


def test_only_what_a_light_shines_on_is_counted():
    """Cone and range of a lamp one unit above a floor, the back of a rectangle, a sun from below."""
    scene = Scene(meshes=(floor(2.0),))
    gbuffer = rasterize(scene, flat_image(60, 48))
    above, down = torch.tensor([0.0, 1.0, 0.0]), torch.tensor([0.0, -1.0, 0.0])
    away = gbuffer.position[..., (0, 2)].norm(dim=-1)
    covered = gbuffer.covered
    spot = faces(SpotLight(position=above, direction=down, inner_deg=10.0, outer_deg=30.0), gbuffer)
    near = faces(PointLight(position=above, range=1.25), gbuffer)
    assert bool((spot == (away < math.tan(math.radians(30.0))))[covered].all()) and bool(spot[covered].any())
    assert bool((near == (away < 0.75))[covered].all()) and bool(near[covered].any())
    turned = RectLight(corner=above, edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, -1.0]))
    assert float(turned.normal[1]) > 0 and not bool(faces(turned, gbuffer)[covered].any())
    assert not bool(faces(DirectionalLight(direction=-down), gbuffer)[covered].any())


def test_a_small_box_keeps_its_shadow_far_from_the_origin():
    row = box_on_ground(10_000.0, 5_000_000.1, 48)
    assert row["default kept"] > 0.98 and row["traced kept"] > 0.99
    assert row["default false"] < 0.003 and row["traced false"] < 0.003


def test_naive_shading_blackens_shadows_that_ambient_light_reaches():
    scene = Scene(meshes=(floor(2.0),), lights=(DOWN,), ambient=torch.full((3,), 0.5))
    gbuffer = rasterize(scene, flat_image(8, 6))
    dark, lit = torch.zeros(1, 1, 6, 8), torch.ones(1, 1, 6, 8)
    assert float(naive_shading(scene, gbuffer, dark)[gbuffer.covered].max()) == 0
    assert float(shade(scene, gbuffer, dark)[gbuffer.covered].min()) > 0
    torch.testing.assert_close(naive_shading(scene, gbuffer, lit), shade(scene, gbuffer, lit))


def test_aliasing_ratio_of_a_floor_seen_and_lit_from_above():
    scene = Scene(meshes=(floor(2.0),))
    view = flat_image(100, 80)
    gbuffer = rasterize(scene, view)
    for size in (128, 256):
        cast = render_shadow_map(scene, DOWN, ShadowOptions(size=size))
        ratio = aliasing_ratio(gbuffer, cast)
        pixels_per_unit = float(view.intrinsics[0, 0, 0]) / 12.0
        wanted = (pixels_per_unit / float(cast.cameras.intrinsics[0, 0, 0])) ** 2
        assert torch.allclose(ratio[gbuffer.covered], torch.tensor(wanted).float(), rtol=1e-3)
        assert bool((ratio[~gbuffer.covered] == 0).all())


def test_aliasing_ratio_of_a_cube_grows_with_the_distance_from_the_light():
    scene = Scene(meshes=(floor(3.0),))
    light = PointLight(position=torch.tensor([0.0, 0.5, 0.0]))
    gbuffer = rasterize(scene, flat_image(100, 80))
    ratio = aliasing_ratio(gbuffer, render_shadow_map(scene, light, ShadowOptions(size=128)))
    distance = gbuffer.position.norm(dim=-1)
    covered = gbuffer.covered
    assert bool(torch.isfinite(ratio).all()) and bool((ratio[covered] > 0).all())
    assert float(ratio[covered & (distance > 2)].min()) > float(ratio[covered & (distance < 0.3)].max())


def test_contact_displacement_bounds_what_is_measured():
    wall = quad((0.0, 0.0, -2.0), (0.0, 0.0, 4.0), (0.0, 2.0, 0.0))
    scene = Scene(meshes=(floor(2.0), wall))
    sun = DirectionalLight(direction=torch.tensor([1.0, -1.0, 0.0]))
    gbuffer = rasterize(scene, flat_image(100, 80))
    x = torch.linspace(1e-4, 0.6, 3000)
    points = on_plane(torch.stack([x, torch.zeros_like(x), torch.full_like(x, 0.3)], 1), torch.tensor([0.0, 1, 0]))
    for b0 in (1.0, 5.0):
        options = ShadowOptions(size=512, bias="constant", constant_bias=b0, filter="none")
        cast = render_shadow_map(scene, sun, options)
        lit = shadow_factor(*points, sun, cast, options)[0, 0] > 0
        strip = float(x[lit].max()) if bool(lit.any()) else 0.0
        said = float(contact_displacement(gbuffer, sun, cast, options)[gbuffer.object_id == 0].max())
        texel = 1.0 / float(cast.cameras.intrinsics[0, (0, 1), (0, 1)].min())
        assert said == pytest.approx(b0 * texel * math.sin(math.radians(45)), rel=1e-3)
        texel = math.sqrt(2) / float(cast.cameras.intrinsics[0, (0, 1), (0, 1)].min())
        assert abs(strip - said) < 1.5 * texel


def test_ray_cast_truth_of_a_known_penumbra():
    """A plate covers half of a square light as seen from the point below the plate's edge."""
    scene = Scene(meshes=(floor(2.0), quad((-2.0, 1.0, 2.0), (2.0, 0, 0), (0, 0, -4.0))))
    light = RectLight(
        corner=torch.tensor([-0.5, 2.0, -0.5]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0])
    )
    gbuffer = rasterize(scene, flat_image(60, 48))
    truth = traced_visibility(RayCaster(scene.geometry), light, gbuffer, samples=8)
    # On the floor the plate's edge x = 0 hides light positions left of -x: visible share 1/2 + x.
    floor_pixels = (gbuffer.object_id == 0) & (gbuffer.position[..., 0] < 0.4)
    x = gbuffer.position[..., 0][floor_pixels]
    assert float((truth[floor_pixels] - (0.5 + x).clamp(0, 1)).abs().max()) < 1 / 8
    assert bool((truth[~gbuffer.covered] == 1).all())


def test_ray_cast_truth_is_dark_behind_surfaces():
    scene = Scene(meshes=(box((-1, 0, -1), (1, 1, 1)),))
    up = DirectionalLight(direction=torch.tensor([0.0, 1.0, 0.0]))
    gbuffer = rasterize(scene, flat_image(40, 32))
    assert float(traced_visibility(RayCaster(scene.geometry), up, gbuffer)[gbuffer.covered].max()) == 0
    assert float(traced_visibility(RayCaster(scene.geometry), DOWN, gbuffer)[gbuffer.covered].min()) == 1
