"""Shadow maps where numbers get hard: grazing planes, huge coordinates, borders, points behind the light, no caster."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from shadow_scenes import box, floor, on_plane, plane_map, quad
from torchrender.buffers import ShadowMap
from torchrender.effects.shadows.light_cameras import light_cameras
from torchrender.effects.shadows.shadow_map import ShadowOptions, light_visibility, render_shadow_map, shadow_factor
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras, pinhole_matrix
from torchrender.scene.light import DirectionalLight, PointLight, SpotLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

CASES = [
    ShadowOptions(size=size, filter=name, filter_radius=n, bias=bias, largest_radius=8.0, light_width=0.3)
    for size, name, n, bias in [
        (128, "none", 0, "slope"), (128, "bilinear", 0, "slope"), ((96, 160), "pcf", 1, "slope"),
        (128, "none", 0, "receiver_plane"), (128, "pcf", 3, "receiver_plane"), (128, "pcf", 3, "slope"),
        (128, "poisson", 2, None), ((160, 96), "pcss", 0, None),
    ]
]  # fmt: skip


def tilted(direction: torch.Tensor, tilt_deg: float, turn: float) -> torch.Tensor:
    """A unit normal at ``tilt_deg`` from the direction against the light."""
    back = -torch.nn.functional.normalize(direction.double(), dim=0)
    aside = torch.linalg.cross(back, torch.tensor([0.3, 0.5, 0.81], dtype=torch.float64))
    aside = aside / aside.norm()
    other = torch.linalg.cross(back, aside)
    angle = math.radians(tilt_deg)
    return math.cos(angle) * back + math.sin(angle) * (math.cos(turn) * aside + math.sin(turn) * other)


def plane_case(light, tilt_deg: float, turn: float, options: ShadowOptions, seed: int):
    """Visibility of 2,000 points of a plane that nothing shadows, and the cosine between its normal and the light."""
    direction = light.direction
    normal = tilted(direction, tilt_deg, turn)
    height, width = options.shape
    boxes = torch.tensor([[[-1.0, -1, -1], [1, 1, 1]]])
    cameras = light_cameras(light, boxes, width=width, height=height, border=8.0)
    cast = plane_map(cameras, torch.zeros(3), normal)
    generator = torch.Generator().manual_seed(seed)
    flat = torch.rand(2000, 3, generator=generator, dtype=torch.float64) * 2 - 1
    points = flat - (flat @ normal)[:, None] * normal
    # Points near the border reach taps outside the map, which are lit and cannot fail.
    found = shadow_factor(*on_plane(points, normal), light, cast, options)[0, 0]
    toward = -direction.double() if isinstance(light, DirectionalLight) else light.position.double() - points
    cosine = (torch.nn.functional.normalize(toward, dim=-1) * normal).sum(-1).expand(len(points))
    return found, cosine


DIRECTION = torch.tensor([0.4, -1.0, 0.3])
LIGHTS = {
    "parallel": DirectionalLight(direction=DIRECTION),
    "spot": SpotLight(position=-4 * DIRECTION, direction=DIRECTION, outer_deg=25.0, inner_deg=20.0),
}


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("options", CASES, ids=lambda o: f"{o.filter}{o.filter_radius}-{o.bias_mode}-{o.size}")
@settings(deadline=None, max_examples=20)
@given(tilt_deg=st.floats(0, 85), turn=st.floats(0, 6.28), seed=st.integers(0, 99))
def test_tilted_planes_do_not_shadow_themselves(name, options, tilt_deg, turn, seed):
    found, cosine = plane_case(LIGHTS[name], tilt_deg, turn, options, seed)
    facing = cosine > 1e-4  # a tilted plane under a spot may turn away from parts of the light's cone
    assert bool((found[facing] == 1).all()), float(found[facing].min())
    assert bool((found[cosine < -1e-4] == 0).all())
    assert bool(facing.any()) and (name == "spot" or bool(facing.all()))


def test_constant_bias_does_shadow_tilted_planes():
    """What the remedies are for: two texels are too little from some tilt on, on every light."""
    for light in LIGHTS.values():
        constant = ShadowOptions(size=128, bias="constant", constant_bias=0.5, filter="none")
        assert float(plane_case(light, 5.0, 1.0, constant, 0)[0].min()) == 1
        failed, cosine = plane_case(light, 75.0, 1.0, constant, 0)
        assert 0.05 < float((failed[cosine > 0] == 0).double().mean()) < 0.95


def test_grazing_to_edge_on_planes_give_numbers():
    for tilt in (89.0, 89.9, 89.9999, 90.0, 90.0001, 120.0):
        for options in CASES:
            found, _ = plane_case(LIGHTS["parallel"], tilt, 0.7, options, 0)
            assert bool(torch.isfinite(found).all()) and float(found.min()) >= 0 and float(found.max()) <= 1
            if tilt > 90.00001:
                assert bool((found == 0).all())


@settings(deadline=None, max_examples=20)
@given(st.floats(-5, 5), st.floats(0, 80), st.integers(0, 99))
def test_planes_of_any_size_and_far_from_the_origin(exponent, tilt_deg, seed):
    """Coordinates 10^-5 to 10^5, and the same far away: float32 storage must not speckle the surface."""
    scale = 10.0**exponent
    direction = LIGHTS["parallel"].direction
    normal = tilted(direction, tilt_deg, 0.3 * seed)
    generator = torch.Generator().manual_seed(seed)
    for offset in (0.0, 1e3):
        centre = torch.tensor([offset, -offset, offset], dtype=torch.float64) * scale
        boxes = torch.stack([centre - scale, centre + scale])[None]
        cameras = light_cameras(LIGHTS["parallel"], boxes, width=128, height=128)
        cast = plane_map(cameras, centre, normal)
        flat = (torch.rand(1000, 3, generator=generator, dtype=torch.float64) * 2 - 1) * scale
        points = (flat - (flat @ normal)[:, None] * normal + centre).float()
        found = shadow_factor(*on_plane(points, normal), LIGHTS["parallel"], cast, ShadowOptions(size=128))
        assert float(found.min()) == 1


def test_far_lights_and_large_depth_ratios():
    """A spot 10^5 away from a scene of size one, and a point light 10^-4 above a floor of size 8."""
    floor_scene = Scene(meshes=(floor(4.0), box((-0.5, 0.5, -0.5), (0.5, 1.0, 0.5))))
    view = Cameras.look_at((0.0, 3.0, 6.0), (0.0, 0.0, 0.0), width=80, height=60, fov_deg=50.0)
    gbuffer = rasterize(floor_scene, view)
    far = SpotLight(
        position=torch.tensor([0.0, 1e5, 0.0]), direction=torch.tensor([0.0, -1, 0]), inner_deg=0.1, outer_deg=0.2
    )
    near = PointLight(position=torch.tensor([2.0, 1e-4, 0.0]))
    for light in (far, near):
        found = light_visibility(floor_scene, light, gbuffer, ShadowOptions(size=512))
        assert bool(torch.isfinite(found).all())
    up = gbuffer.covered & (gbuffer.position[..., 1] > 0.99)
    assert float(light_visibility(floor_scene, far, gbuffer)[up].min()) == 1


def test_points_behind_the_light_and_at_the_light():
    light = SpotLight(position=torch.tensor([0.0, 2.0, 0.0]), direction=torch.tensor([0.0, -1.0, 0.0]))
    cameras = light_cameras(light, torch.tensor([[[-1.0, 0, -1], [1, 1, 1]]]), width=64, height=64)
    cast = ShadowMap(cameras=cameras, depth=torch.full((1, 64, 64), 0.5))
    points = torch.tensor([[0.0, 3.0, 0.0], [0.0, 2.0, 0.0], [0.5, 2.0, 0.0], [math.nan, 0, 0], [math.inf, 0, 0]])
    normals = -torch.nn.functional.normalize(points.nan_to_num(1.0, 1.0) - light.position, dim=-1)[None, None]
    for name in ("none", "bilinear", "poisson", "pcss"):
        for outside, value in (("lit", 1.0), ("shadow", 0.0)):
            options = ShadowOptions(filter=name, outside=outside)
            found = shadow_factor(points[None, None], normals, light, cast, options)[0, 0].tolist()
            # Behind; on the light itself there is no direction (and a zero normal here); beside; not a point at all.
            assert found == [value, 1.0, value, 1.0, 1.0]


def test_empty_texels_stay_lit_next_to_full_ones():
    light = DirectionalLight(direction=torch.tensor([0.0, 0.0, 1.0]))
    limits = [torch.tensor(v, dtype=torch.float64) for v in (0.0, 10.0)]
    cameras = Cameras(torch.eye(4)[None], pinhole_matrix(1, 1, 2, 2)[None], 4, 4, *limits, orthographic=True)
    depth = torch.full((1, 4, 4), math.inf)
    depth[:, :, :2] = 1.0
    x = torch.linspace(-2.5, 2.5, 401)
    points = on_plane(torch.stack([x, torch.zeros_like(x), torch.full_like(x, 3.0)], 1), torch.tensor([0.0, 0, -1]))
    cast = ShadowMap(cameras=cameras, depth=depth)
    for name in ("none", "bilinear", "average_depth"):
        found = shadow_factor(*points, light, cast, ShadowOptions(filter=name))[0, 0]
        assert bool(torch.isfinite(found).all()) and bool((found[x > 0.51] == 1).all())
    bilinear = shadow_factor(*points, light, cast, ShadowOptions())[0, 0]
    inner = (x > -1.4) & (x < 1.4)
    assert torch.allclose(bilinear[inner], (x[inner] + 0.5).clamp(0, 1), atol=1e-5)
    assert bool((bilinear[x < -2.0] == 1).all())  # outside the map
    soft = shadow_factor(*points, light, cast, ShadowOptions(soft=1e-4))[0, 0]
    assert bool(torch.isfinite(soft).all())


def test_points_on_texel_borders_take_one_side_and_never_a_third_value():
    light = DirectionalLight(direction=torch.tensor([0.0, 0.0, 1.0]))
    limits = [torch.tensor(v, dtype=torch.float64) for v in (0.0, 10.0)]
    cameras = Cameras(torch.eye(4)[None], pinhole_matrix(1, 1, 4, 4)[None], 8, 8, *limits, orthographic=True)
    depth = torch.where(torch.arange(8) % 2 == 0, 1.0, 5.0).expand(1, 8, 8).contiguous()
    x = torch.arange(-4.0, 5.0)
    points = on_plane(torch.stack([x, torch.zeros_like(x), torch.full_like(x, 3.0)], 1), torch.tensor([0.0, 0, -1]))
    cast = ShadowMap(cameras=cameras, depth=depth)
    hard = shadow_factor(*points, light, cast, ShadowOptions(filter="none"))[0, 0]
    assert hard.tolist() == [0, 1, 0, 1, 0, 1, 0, 1, 1]  # u = 8 lies outside and is lit
    bilinear = shadow_factor(*points, light, cast, ShadowOptions())[0, 0]
    assert bilinear[1:-1].tolist() == [0.5] * 7


def test_coplanar_light_and_degenerate_triangles():
    light = PointLight(position=torch.tensor([0.0, 0.0, 0.0]))  # in the plane of the floor
    needle = Mesh(vertices=torch.tensor([[0.0, 1, 0], [1.0, 1, 0], [2.0, 1, 0]]), faces=torch.tensor([[0, 1, 2]]))
    scene = Scene(meshes=(floor(2.0), needle, quad((0.5, 0.2, -0.5), (0, 0, 1.0), (0, 1.0, 0))))
    view = Cameras.look_at((-2.0, 3.0, 4.0), (0.0, 0.0, 0.0), width=80, height=60)
    gbuffer = rasterize(scene, view)
    for options in (
        ShadowOptions(size=128),
        ShadowOptions(size=128, filter="pcss"),
        ShadowOptions(size=128, soft=0.01),
    ):
        found = light_visibility(scene, light, gbuffer, options)
        assert bool(torch.isfinite(found).all())
        assert float(found[gbuffer.object_id == 0].max()) <= 1
        # The wall faces the light; a soft comparison puts lit surfaces themselves at one half or more.
        assert float(found[gbuffer.object_id == 2].double().mean()) > (0.95 if options.soft is None else 0.5)


def test_thin_casters_below_a_texel_leave_gaps_but_no_false_values():
    wire = box((-2.0, 1.0, -0.002), (2.0, 1.004, 0.002))
    scene = Scene(meshes=(floor(2.0), wire))
    sun = DirectionalLight(direction=torch.tensor([0.02, -1.0, 0.03]))
    view = Cameras.look_at((0.0, 12.0, 0.0), (0.0, 0.0, 0.0), width=120, height=90, fov_deg=25.0)
    gbuffer = rasterize(scene, view)
    found = light_visibility(scene, sun, gbuffer, ShadowOptions(size=128))
    assert bool(torch.isfinite(found).all()) and float(found.double().mean()) > 0.95


def test_contact_has_no_strip_of_light():
    """A wall on a floor: the floor is dark up to the wall, but for the strip that the bias allows."""
    wall = quad((0.0, 0.0, -2.0), (0.0, 0.0, 4.0), (0.0, 2.0, 0.0))
    scene = Scene(meshes=(floor(2.0), wall))
    sun = DirectionalLight(direction=torch.tensor([0.7, -1.0, 0.0]))
    x = torch.linspace(1e-3, 0.5, 500)
    points = on_plane(torch.stack([x, torch.zeros_like(x), torch.full_like(x, 0.3)], 1), torch.tensor([0.0, 1, 0]))
    for options in (ShadowOptions(size=512), ShadowOptions(size=512, filter="none", bias="receiver_plane")):
        cast = render_shadow_map(scene, sun, options)
        found = shadow_factor(*points, sun, cast, options)[0, 0]
        texel = 1.0 / float(cast.cameras.intrinsics[0, (0, 1), (0, 1)].min())
        assert bool((found[x > 5 * texel] == 0).all())


def test_bias_uses_the_geometric_normal_that_is_handed_in():
    """Bent shading normals must not change which points are lit: a plane with its own normal is clean, with a bent
    one it is not; so the caller passes geometric normals, and the light-visibility pass does."""
    light = LIGHTS["parallel"]
    normal = tilted(light.direction, 70.0, 0.3)
    boxes = torch.tensor([[[-1.0, -1, -1], [1, 1, 1]]])
    cast = plane_map(light_cameras(light, boxes, width=128, height=128), torch.zeros(3), normal)
    flat = torch.rand(500, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 2 - 1
    points = flat - (flat @ normal)[:, None] * normal
    right = shadow_factor(*on_plane(points, normal), light, cast, ShadowOptions())
    bent = shadow_factor(*on_plane(points, -light.direction.double()), light, cast, ShadowOptions())
    assert float(right.min()) == 1 and float(bent.min()) < 1
