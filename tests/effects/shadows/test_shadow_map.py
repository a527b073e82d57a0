"""Shadow maps: the acceptance list of the method, on analytic planes and against ray casting."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from shadow_scenes import box, edge_distance, flat_image, floor, on_plane, plane_map, quad
from torchrender.buffers import ShadowMap
from torchrender.effects.shadows import shadow_map as module
from torchrender.effects.shadows.exact_edges import folded
from torchrender.effects.shadows.light_cameras import light_cameras
from torchrender.effects.shadows.shadow_map import (
    FILTERS,
    ShadowOptions,
    light_visibility,
    lights_visibility,
    render_shadow_map,
    shadow_factor,
)
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.errors import InputError, OptionError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.shadow_maps.quality import shadow_errors
from torchrender.scene.camera import Cameras, pinhole_matrix
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.shade import shade

SUN = DirectionalLight(direction=torch.tensor([0.5, -1.0, 0.2]))
SPOT = SpotLight(position=torch.tensor([-3.0, 5.0, 1.0]), direction=torch.tensor([3.0, -5.0, -1.0]), outer_deg=50.0)
POINT = PointLight(position=torch.tensor([0.8, 2.6, 1.0]))
RECT = RectLight(
    corner=torch.tensor([-3.0, 4.0, 1.0]), edge_u=torch.tensor([0.0, 0, -0.8]), edge_v=torch.tensor([0.8, 0, 0])
)
LIGHTS = {"sun": SUN, "spot": SPOT, "point": POINT, "rect": RECT}
VIEW = {"width": 200, "height": 160}


@pytest.fixture(scope="module")
def boxes() -> Scene:
    """A box that stands on the floor and a slab that hovers."""
    standing, hovering = box((-0.5, 0.0, -0.5), (0.5, 1.2, 0.5)), box((1.2, 0.6, -1.5), (2.2, 0.8, 1.1), "slab")
    return Scene(meshes=(floor(3.0), standing, hovering), lights=tuple(LIGHTS.values()))


@pytest.fixture(scope="module")
def seen(boxes):
    camera = Cameras.look_at((2.5, 4.0, 5.5), (0.2, 0.3, 0.0), fov_deg=45.0, **VIEW)
    return rasterize(boxes, camera)


def wrong(found, reference, gbuffer, pixels):
    """Pixels on the wrong side farther than that from shadow edges of the reference and from creases."""
    normals = gbuffer.geometric_normal.abs() > 0.5
    edges = [edge_distance(reference > 0.5), *(edge_distance(normals[..., axis]) for axis in range(3))]
    return ((found > 0.5) != (reference > 0.5)) & (torch.stack(edges).amin(0) > pixels)


def in_cone(light, gbuffer):
    """Covered pixels, for a spot only those inside its cone: its map ends there."""
    if not isinstance(light, SpotLight):
        return gbuffer.covered
    return gbuffer.covered & (-(towards(light, gbuffer) * light.direction).sum(-1) > math.cos(math.radians(50.0)))


def steep_light(light, gbuffer):
    """Pixels on which the light falls at more than 12 degrees, or from behind."""
    return (towards(light, gbuffer) * gbuffer.geometric_normal).sum(-1).abs() > 0.2


def towards(light, gbuffer):
    if isinstance(light, DirectionalLight):
        return -light.direction.expand_as(gbuffer.position)
    place = light.centre if isinstance(light, RectLight) else light.position
    return torch.nn.functional.normalize(place - gbuffer.position, dim=-1)


# ---------------------------------------------------------------- against rays


@pytest.mark.parametrize("size", [(600, 512), (512, 500), (512, 600), 512])
@pytest.mark.parametrize("name", LIGHTS)
def test_equals_rays_away_from_edges_at_any_size(boxes, seen, name, size):
    light = LIGHTS[name]
    reference = traced_visibility(RayCaster(boxes.geometry), light, seen)
    found = light_visibility(boxes, light, seen, ShadowOptions(size=size))
    assert 0.1 < float(reference[seen.covered].mean()) < 0.9
    counted = in_cone(light, seen)
    # A texel of these maps covers less than two pixels of this picture, where the light does not graze.
    assert int((wrong(found, reference, seen, 1.5 * 2.0) & counted & steep_light(light, seen)).sum()) == 0
    errors = shadow_errors(found, reference, counted)
    assert errors.false_shadow + errors.false_light < 0.01


def test_edge_error_is_at_most_a_texel_and_a_half_and_halves_with_twice_the_texels():
    """Shadow of a turned plate on the floor: distance of wrong points from the true edge, in texels."""
    plate = quad((-1.03, 1.5, 0.31), (1.37, 0.0, -0.61), (0.61, 0.0, 1.37), "plate")
    scene = Scene(meshes=(floor(3.0), plate))
    sun = DirectionalLight(direction=torch.tensor([0.37, -1.0, 0.21]))
    corners = plate.vertices + 1.5 * sun.direction.double() / -sun.direction[1].double()
    generator = torch.Generator().manual_seed(1)
    points = torch.rand(400_000, 3, generator=generator, dtype=torch.float64) * 5 - 2.5
    points[:, 1] = 0.0
    distance = torch.full((len(points),), math.inf, dtype=torch.float64)
    inside = torch.ones(len(points), dtype=torch.bool)
    flat = corners[:, [0, 2]] - corners[0, [0, 2]]
    turn = flat[1, 0] * flat[2, 1] - flat[1, 1] * flat[2, 0]
    for a, b in zip(corners, corners.roll(-1, 0)):
        edge = (b - a)[[0, 2]] / (b - a)[[0, 2]].norm()
        along = points[:, [0, 2]] - a[[0, 2]]
        side = edge[0] * along[:, 1] - edge[1] * along[:, 0]
        inside &= side * turn > 0
        within = (along @ edge).clamp(0, float((b - a).norm()))
        distance = torch.minimum(distance, (along - within[:, None] * edge).norm(dim=1))
    assert 0.02 < float(inside.double().mean()) < 0.3
    shape = on_plane(points, torch.tensor([0.0, 1.0, 0.0]))
    means = []
    for size in (128, 256, 512, 1024):
        options = ShadowOptions(size=size, filter="none")
        cast = render_shadow_map(scene, sun, options)
        lit = shadow_factor(*shape, sun, cast, options)[0, 0] > 0.5
        bad = lit == inside
        texel = 1.0 / float(cast.cameras.intrinsics[0, (0, 1), (0, 1)].min())
        slant = 1.0 / abs(float(sun.direction[1]))
        assert float(distance[bad].max()) < 1.5 * texel * slant
        means.append(float(bad.double().mean()))  # area between both edges per area: mean error times edge length
    for coarse, fine in pairwise(means):
        assert 0.7 < coarse / fine / 2 < 1.3


def test_hard_mode_with_2048_texels_meets_its_target(boxes, seen):
    options = ShadowOptions(size=2048, filter="none")
    for light in (SUN, SPOT):
        reference = traced_visibility(RayCaster(boxes.geometry), light, seen)
        found = light_visibility(boxes, light, seen, options)
        assert float((wrong(found, reference, seen, 1.5 * 0.5) & in_cone(light, seen)).sum()) < 0.01 * float(
            seen.covered.sum()
        )


def test_point_light_in_a_room_has_no_seams():
    """A closed room of one box, the light inside: every wall is lit by every filter, also where faces meet."""
    scene = Scene(meshes=(box((-2.0, 0.0, -2.0), (2.0, 3.0, 2.0)),))
    light = PointLight(position=torch.tensor([0.3, 1.7, -0.2]))
    inside = Cameras.look_at((0.0, 1.5, 1.9), (0.3, 1.0, -2.0), fov_deg=110.0, **VIEW)
    gbuffer = rasterize(scene, inside)
    for name in ("none", "bilinear", "pcf", "poisson", "pcss"):
        options = ShadowOptions(
            size=256, filter=name, filter_radius=2, largest_radius=8.0, light_width=0.1, bias="receiver_plane"
        )
        found = light_visibility(scene, light, gbuffer, options)
        walls = gbuffer.geometric_normal.abs()
        creases = torch.stack([edge_distance(walls[..., axis] > 0.5) for axis in range(3)]).amin(0)
        assert float(found[creases > 4].min()) > 0.99, name
        assert float(found.mean()) > 0.98, name


def test_cascades_sharpen_near_shadows():
    """A long street: with cascades the foreground's shadow edges match rays better than with one map of that size."""
    wide = Scene(meshes=(floor(60.0), *(box((x, 0, z), (x + 1, 2, z + 1)) for x in (-3, 2) for z in (40, 20, 0, -30))))
    view = Cameras.look_at((0.0, 2.0, 50.0), (0.0, 1.0, 0.0), near=0.5, **VIEW)
    gbuffer = rasterize(wide, view)
    reference = traced_visibility(RayCaster(wide.geometry), SUN, gbuffer)
    one, four = (
        shadow_errors(
            light_visibility(wide, SUN, gbuffer, ShadowOptions(size=256, cascades=count)), reference, gbuffer.covered
        )
        for count in (1, 4)
    )
    assert four.mean_error < 0.5 * one.mean_error and four.mean_error < 0.02


# ---------------------------------------------------------------- comparison and filters


def two_by_two():
    """A map of four known depths under parallel light that travels along +z, one texel per unit."""
    depth = torch.tensor([[[1.0, 3.0], [3.0, 1.0]]])
    k = pinhole_matrix(1.0, 1.0, 1.0, 1.0)[None]
    limits = [torch.tensor(v, dtype=torch.float64) for v in (0.0, 10.0)]
    cameras = Cameras(torch.eye(4)[None], k, 2, 2, *limits, orthographic=True)
    return ShadowMap(cameras=cameras, depth=depth), DirectionalLight(direction=torch.tensor([0.0, 0.0, 1.0]))


def test_bilinear_compares_first_and_then_averages():
    cast, light = two_by_two()
    # u = 1.25, v = 0.75: fractions a = 0.75, b = 0.25 between the four texel centres; receiver at depth 2.
    points = on_plane(torch.tensor([[0.25, -0.25, 2.0]]), torch.tensor([0.0, 0.0, -1.0]))
    found = float(shadow_factor(*points, light, cast, ShadowOptions()))
    assert found == pytest.approx(0.75 * 0.75 + 0.25 * 0.25, abs=1e-6)  # the two texels of depth 3 are lit
    # The mean depth is 0.625 * 3 + 0.375 * 1 = 2.25: it belongs to no surface and calls the point fully lit.
    assert float(shadow_factor(*points, light, cast, ShadowOptions(filter="average_depth"))) == 1.0


def test_bilinear_is_continuous_and_hard_comparison_is_not():
    cast, light = two_by_two()
    x = torch.linspace(-0.49, 0.49, 2001)
    points = on_plane(
        torch.stack([x, torch.full_like(x, 0.3), torch.full_like(x, 2.0)], dim=1), torch.tensor([0.0, 0.0, -1.0])
    )
    smooth = shadow_factor(*points, light, cast, ShadowOptions())[0, 0]
    hard = shadow_factor(*points, light, cast, ShadowOptions(filter="none"))[0, 0]
    assert float(smooth.diff().abs().max()) < 0.003 and float(smooth.max() - smooth.min()) > 0.1
    assert float(hard.diff().abs().max()) == 1.0


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("light", LIGHTS.values(), ids=LIGHTS.keys())
def test_empty_map_lights_all_that_faces_the_light(light, name, seen):
    cameras = light_cameras(light, torch.tensor([[[-3.0, 0, -3], [3, 2, 3]]]), width=96, height=64, border=8.0)
    empty = ShadowMap(cameras=cameras, depth=torch.full((len(cameras), 64, 96), math.inf))
    found = shadow_factor(seen.position, seen.geometric_normal, light, empty, ShadowOptions(filter=name))
    assert bool(torch.isfinite(found).all()) and float(found.min()) >= 0 and float(found.max()) <= 1
    cosine = (towards(light, seen) * seen.geometric_normal).sum(-1)
    clear = cosine.abs() > 1e-5
    assert torch.equal((found == 1)[clear], (cosine > 0)[clear]) and bool((found[~seen.covered] == 1).all())


def test_fully_shadowed_pixel_is_texture_times_ambient(boxes, seen):
    material = Material(name="paint", diffuse=torch.tensor([0.5, 0.25, 0.125]), specular=0.3, shininess=20.0)
    scene = replace(boxes, materials=(material,), lights=(SUN,), ambient=torch.full((3,), 0.5))
    visibility = lights_visibility(scene, seen)
    dark = (visibility[:, 0] == 0) & seen.covered
    assert int(dark.sum()) > 500
    picture = shade(scene, seen, visibility)
    assert torch.equal(picture[dark], torch.tensor([0.25, 0.125, 0.0625]).expand_as(picture[dark]))


def test_two_lights_and_two_cameras_equal_separate_runs(boxes):
    scene = replace(boxes, lights=(SUN, POINT))
    views = [Cameras.look_at((x, 4.0, 5.5), (0.2, 0.3, 0.0), fov_deg=45.0, **VIEW) for x in (2.5, -2.0)]
    options = ShadowOptions(size=256)
    together = lights_visibility(scene, rasterize(scene, Cameras.cat(views)), options)
    assert together.shape == (2, 2, 160, 200)
    for b, view in enumerate(views):
        for index, light in enumerate(scene.lights):
            alone = light_visibility(scene, light, rasterize(scene, view), options)
            assert torch.equal(together[b, index], alone[0])
    cascaded = ShadowOptions(size=256, cascades=2)
    both = light_visibility(scene, SUN, rasterize(scene, Cameras.cat(views)), cascaded)
    for b, view in enumerate(views):
        assert torch.equal(both[b], light_visibility(scene, SUN, rasterize(scene, view), cascaded)[0])


def test_no_lights_and_no_triangles(seen):
    empty = Scene()
    assert lights_visibility(empty, seen).shape == (1, 0, 160, 200)
    lit = replace(empty, lights=(SUN, POINT))
    found = lights_visibility(lit, seen)
    assert bool(((found == 0) | (found == 1)).all()) and float(found.mean()) > 0.3


def test_a_map_is_reused(boxes, seen, monkeypatch):
    options = ShadowOptions(size=128)
    cast = render_shadow_map(boxes, SUN, options, gbuffer=seen)
    first = light_visibility(boxes, SUN, seen, options)
    monkeypatch.setattr(module, "rasterize_depth", None)  # drawing again would fail
    assert torch.equal(first, light_visibility(boxes, SUN, seen, options, cast))


def test_culling_front_faces_keeps_the_shadow_of_closed_bodies(boxes, seen):
    every = light_visibility(boxes, SUN, seen, ShadowOptions(size=512))
    back = light_visibility(boxes, SUN, seen, ShadowOptions(size=512, cull="front"))
    floor_pixels = seen.object_id == 0
    assert float((every - back).abs()[floor_pixels].mean()) < 0.01


def test_outside_the_map_is_lit_or_dark(boxes, seen):
    narrow = SpotLight(position=SPOT.position, direction=SPOT.direction, inner_deg=8.0, outer_deg=10.0)
    lit = light_visibility(boxes, narrow, seen, ShadowOptions(size=128))
    dark = light_visibility(boxes, narrow, seen, ShadowOptions(size=128, outside="shadow"))
    assert float(lit.mean() - dark.mean()) > 0.3 and bool((dark <= lit).all())


# ---------------------------------------------------------------- penumbrae


def half_plane(height: float) -> ShadowMap:
    """A half plane x < 0 at ``height`` above the floor, seen by a light 4 above it; 1024 texels, 90 degrees."""
    light = SpotLight(position=torch.tensor([0.0, 4.0, 0.0]), direction=torch.tensor([0.0, -1.0, 0.0]), outer_deg=45.0)
    cameras = light_cameras(light, torch.tensor([[[-4.0, 0, -4], [4, 3.0, 4]]]), width=1024, height=1024)
    origins, directions = cameras.rays()
    at_plate = origins + directions * (4.0 - height)
    return light, ShadowMap(cameras=cameras, depth=torch.where(at_plate[..., 0] < 0, 4.0 - height, 4.0).float())


def penumbra(cast, light, options) -> float:
    """Width over which visibility along x rises from 0.02 to 0.98, averaged over rows, extended to a full ramp."""
    x = torch.linspace(-1.5, 1.5, 1201)
    z = torch.linspace(-0.3, 0.3, 61)
    points = torch.cartesian_prod(x, z)
    points = torch.stack([points[:, 0], torch.zeros(len(points)), points[:, 1]], dim=1)
    image = shadow_factor(*on_plane(points, torch.tensor([0.0, 1.0, 0.0])), light, cast, options)
    profile = image.reshape(1201, 61).mean(1)
    assert profile[0] == 0 and profile[-1] == 1
    # Second moment of the profile's derivative: a disc of diameter w has the variance w^2 / 16.
    weight = profile.diff().double()
    middle = (x[1:] + x[:-1]).double() / 2
    mean = (weight * middle).sum()
    return 4.0 * math.sqrt(float((weight * (middle - mean) ** 2).sum()))


def test_pcss_penumbra_grows_linearly_with_the_distance_of_the_blocker():
    options = ShadowOptions(filter="pcss", light_width=0.5, taps=128, search_taps=64, largest_radius=128.0)
    for height in (0.5, 1.0, 2.0):
        light, cast = half_plane(height)
        wanted = 0.5 * height / (4.0 - height)
        assert penumbra(cast, light, options) == pytest.approx(wanted, rel=0.25)


def test_pcss_contact_stays_sharp():
    light, cast = half_plane(0.02)
    texel = 4.0 / float(cast.cameras.intrinsics[0, 0, 0])
    assert penumbra(cast, light, ShadowOptions(filter="pcss", light_width=0.5)) < 3.5 * texel


def test_cords_far_before_a_wall_cast_no_hard_lines_in_the_light_of_a_window():
    """They hide a few hundredths of the window, whether taps find them or texels happen to hold them."""
    wall = quad([-2.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.5, 0.0])
    cords = [quad([0.1 * k - 0.4, 0.0, 1.0], [0.0004 * 1.5**k, 0.02, 0.0], [0.2, 2.5, 0.0]) for k in range(6)]
    window = RectLight(corner=[-0.3, 0.6, 3.0], edge_u=[0.0, 1.2, 0.0], edge_v=[1.2, 0.0, 0.0])
    scene = Scene(meshes=[wall, *cords], lights=[window])
    cameras = Cameras.look_at([0.9, 1.2, 0.9], [-0.2, 1.2, 0.0], width=160, height=120, fov_deg=50.0)
    gbuffer = rasterize(scene, cameras)
    wall_seen = gbuffer.object_id == 0
    rays = traced_visibility(RayCaster(scene.geometry), window, gbuffer, samples=32)
    assert float(rays[wall_seen].min()) > 0.95
    found = light_visibility(scene, window, gbuffer, ShadowOptions(filter="pcss"))
    assert float((found[wall_seen] < 0.5).float().mean()) < 1e-4
    assert float((found - rays)[wall_seen].abs().mean()) < 0.02


def test_edges_decide_the_side_of_a_visibility_and_what_hides_from_afar_leaves_it():
    visibility = torch.tensor([0.2, 0.7, 0.2, 0.7, 0.2, 0.7])
    hidden = torch.tensor([[1, 1, 0, 0, 0, 0], [0, 0, 1, 1, 0, 0]]).bool()
    torch.testing.assert_close(folded(visibility, hidden), torch.tensor([0.2, 0.3, 0.2, 0.7, 0.8, 0.7]))


def test_pcss_of_a_directional_light_follows_its_angle():
    plate = quad((-6.0, 1.0, 6.0), (6.0, 0, 0), (0, 0, -12.0))
    scene = Scene(meshes=(floor(3.0), plate))
    sun = DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0]))
    options = ShadowOptions(filter="pcss", light_angle_deg=12.0, taps=128, search_taps=64, largest_radius=128.0)
    wanted = 2 * math.tan(math.radians(6.0)) * 1.0
    assert penumbra(render_shadow_map(scene, sun, options), sun, options) == pytest.approx(wanted, rel=0.25)


def test_pcss_of_a_disc_blocker_agrees_with_light_samples():
    """A small square plate below a square light: visibility on the floor against 256 rays per point."""
    scene = Scene(meshes=(floor(2.0), quad((-0.5, 1.0, 0.5), (1.0, 0, 0), (0, 0, -1.0))))
    light = RectLight(
        corner=torch.tensor([-0.25, 4.0, -0.25]), edge_u=torch.tensor([0.5, 0, 0]), edge_v=torch.tensor([0, 0, 0.5])
    )
    gbuffer = rasterize(scene, flat_image(60, 60))
    reference = traced_visibility(RayCaster(scene.geometry), light, gbuffer, samples=16)
    soft = ShadowOptions(filter="pcss", taps=64, search_taps=32, largest_radius=100.0)
    counted = gbuffer.covered & (gbuffer.position[..., 1] < 0.5)
    hard = shadow_errors(light_visibility(scene, light, gbuffer, ShadowOptions()), reference, counted)
    found = shadow_errors(light_visibility(scene, light, gbuffer, soft), reference, counted)
    assert found.mean_error < 0.5 * hard.mean_error and found.mean_error < 0.01


# ---------------------------------------------------------------- gradients


def test_soft_comparison_tends_to_the_hard_one(boxes, seen):
    hard = light_visibility(boxes, SUN, seen, ShadowOptions(size=256, edges="map"))
    soft = light_visibility(boxes, SUN, seen, ShadowOptions(size=256, soft=1e-6))
    assert float((hard - soft).abs().mean()) < 1e-3
    point = light_visibility(boxes, POINT, seen, ShadowOptions(size=128, filter="pcf", bias="slope", edges="map"))
    soft = light_visibility(boxes, POINT, seen, ShadowOptions(size=128, filter="pcf", soft=1e-6))
    assert float((point - soft).abs().mean()) < 1e-3


def test_soft_gradients_equal_finite_differences():
    cast, light = two_by_two()
    cast = ShadowMap(cameras=cast.cameras, depth=cast.depth.double().requires_grad_())
    points = torch.tensor([[0.25, -0.3, 2.0], [0.1, 0.2, 2.9]], dtype=torch.float64, requires_grad=True)
    options = ShadowOptions(soft=0.1)

    def factor(p, d):
        shape = on_plane(p, torch.tensor([0.0, 0.0, -1.0]))
        return shadow_factor(*shape, light, ShadowMap(cameras=cast.cameras, depth=d), options).double()

    assert torch.autograd.gradcheck(factor, (points, cast.depth), eps=1e-3, atol=2e-3)


# ---------------------------------------------------------------- the door


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size", 32), ("size", (512, 9000)), ("filter", "box"), ("bias", "auto"), ("constant_bias", -0.1),
        ("slope_bias", 5.0), ("filter_radius", 8), ("taps", 3), ("light_width", 0.0), ("largest_radius", 0.5),
        ("outside", "grey"), ("cull", "both"), ("soft", 0.0), ("cascades", 0), ("normal_offset", 4.0),
        ("largest_bias", math.nan), ("light_angle_deg", 0.0), ("search_taps", 500),
    ],
)  # fmt: skip
def test_options_name_what_is_wrong(name, value):
    with pytest.raises(OptionError, match=name):
        ShadowOptions(**{name: value})


def test_soft_needs_a_small_filter_and_a_slope_bias():
    for changes in ({"filter": "pcss"}, {"bias": "receiver_plane"}, {"normal_offset": 1.0}):
        with pytest.raises(OptionError, match="soft"):
            ShadowOptions(soft=0.1, **changes)


def test_defaults_are_those_of_the_method():
    options = ShadowOptions()
    assert (options.shape, options.constant_bias, options.slope_bias, options.largest_bias, options.normal_offset) == (
        (1024, 1024), 0.05, 1.0, 4.0, 0.0,
    )  # fmt: skip
    assert (options.filter, options.filter_radius, options.bias_mode) == ("bilinear", 1, "slope")
    assert (options.search_taps, options.taps, options.largest_radius) == (16, 32, 32.0)
    assert ShadowOptions(filter="pcss").bias_mode == "receiver_plane"


def test_wrong_shapes_are_named(boxes):
    cast = plane_map(light_cameras(SUN, boxes.bounds[None], width=64, height=64), torch.zeros(3), torch.ones(3))
    good = torch.zeros(1, 2, 2, 3)
    with pytest.raises(InputError, match="points"):
        shadow_factor(good[0], good[0], SUN, cast)
    with pytest.raises(InputError, match="normals"):
        shadow_factor(good, good[:, :1], SUN, cast)
    with pytest.raises(InputError, match="depth"):
        shadow_factor(good, good, SUN, ShadowMap(cameras=cast.cameras, depth=cast.depth[:, :9]))
    with pytest.raises(InputError, match="shadow_maps"):
        lights_visibility(boxes, None, shadow_maps=[cast])
