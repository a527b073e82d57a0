"""Direct light: a loop over pixels as twin, closed forms, and the laws that other passes rely on."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchrender import shade as module
from torchrender.buffers import GBuffer
from torchrender.errors import InputError, OptionError
from torchrender.numerics.polygon_light import polygon_irradiance
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color, shade

FLOOR = Mesh(
    vertices=torch.tensor([[-4.0, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]]),
    faces=torch.tensor([[0, 2, 1], [0, 3, 2]]),
)


def floor_scene(*lights: Light, material: Material | None = None, ambient: float = 0.0) -> Scene:
    materials = (material or Material(diffuse=torch.tensor([0.5, 0.4, 0.3])),)
    return Scene(meshes=(FLOOR,), materials=materials, lights=lights, ambient=torch.full((3,), ambient))


def overhead(width: int = 6, height: int = 4, count: int = 1) -> Cameras:
    eyes = [[0.3 * k, 5.0, 0.1] for k in range(count)]
    return Cameras.look_at(eyes, [[0.3 * k, 0.0, 0.0] for k in range(count)], width=width, height=height)


def floor_gbuffer(cameras: Cameras, normal: tuple[float, float, float] = (0.0, 1.0, 0.0)) -> GBuffer:
    """What the cameras see of the plane y = 0, in closed form; the first row of pixels is left empty."""
    origin, direction = cameras.rays()
    depth = -origin[..., 1] / direction[..., 1]
    position = origin + depth[..., None] * direction
    covered = torch.ones(depth.shape, dtype=torch.bool)
    covered[:, 0] = False
    ids = torch.where(covered, 0, -1)

    def image(value: Tensor) -> Tensor:
        return torch.where(covered[..., None], value.float().expand(*depth.shape, value.shape[-1]), 0.0)

    return GBuffer(
        cameras=cameras,
        depth=torch.where(covered, depth, math.inf).float(),
        triangle=ids,
        object_id=ids,
        barycentric=image(torch.zeros(2)),
        position=image(position),
        normal=image(torch.nn.functional.normalize(torch.tensor(normal), dim=0)),
        geometric_normal=image(torch.tensor([0.0, 1.0, 0.0])),
        uv=image(position[..., [0, 2]] / 8 + 0.5),
        uv_footprint=torch.where(covered, 1e-4, 0.0),
        color=image(torch.ones(3)),
        material=ids,
    )


SUN = DirectionalLight(direction=torch.tensor([0.3, -1.0, 0.2]), irradiance=torch.tensor([2.0, 1.5, 1.0]))
LAMP = PointLight(position=torch.tensor([0.5, 2.0, -0.3]), intensity=torch.tensor([3.0, 4.0, 5.0]))
SPOT = SpotLight(position=torch.tensor([-0.5, 3.0, 0.0]), direction=torch.tensor([0.1, -1.0, 0.0]), outer_deg=25.0)
PANEL = RectLight(
    corner=torch.tensor([-0.5, 2.0, -0.5]), edge_u=torch.tensor([1.0, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.0, 1.0])
)
LIGHTS: tuple[Light, ...] = (SUN, LAMP, SPOT, PANEL)
GLOSSY = Material(
    diffuse=torch.tensor([0.5, 0.4, 0.3]), specular=0.6, specular_color=torch.tensor([1.0, 0.8, 0.2]), shininess=20.0
)


def slow_pixel(scene: Scene, eye: Tensor, p: Tensor, n: Tensor, s: list[float]) -> Tensor:
    """Radiance of one point of the floor by the formulas, in float64."""
    material = scene.materials[0]
    p, n, eye = p.double(), n.double(), eye.double()
    view = (eye - p) / (eye - p).norm()
    diffuse, specular = scene.ambient.double().clone(), torch.zeros(3, dtype=torch.float64)
    for factor, light in zip(s, scene.lights, strict=True):
        if isinstance(light, DirectionalLight):
            direction, color = -light.direction.double(), light.irradiance.double()
            amount = max(float(n @ direction), 0.0)
        elif isinstance(light, RectLight):
            c, u, v = light.corner, light.edge_u, light.edge_v
            offset = light.centre.double() - p
            direction, color = offset / offset.norm(), light.radiance.double()
            corners = torch.stack([c, c + u, c + u + v, c + v])
            amount = float(polygon_irradiance(corners, p.float()[:, None], n.float()[:, None])[0])
        else:
            offset = light.position.double() - p
            direction, color = offset / offset.norm(), light.intensity.double()
            square = float(offset @ offset)
            amount = max(float(n @ direction), 0.0) / square * max(1.0 - (square / light.range**2) ** 2, 0.0)
            if isinstance(light, SpotLight):
                amount *= float(light.cone(-(direction @ light.direction.double())))
        diffuse += factor * amount * color / math.pi
        reflected = 2 * (n @ direction) * n - direction
        lobe = max(float(reflected @ view), 0.0) ** material.shininess * (material.shininess + 2) / (2 * math.pi)
        specular += factor * amount * lobe * color
    tint = material.specular * material.specular_color
    return (material.diffuse * diffuse + tint * specular + material.emission).float()


def test_agrees_with_a_loop_over_pixels() -> None:
    scene = floor_scene(*LIGHTS, material=replace(GLOSSY, emission=torch.tensor([0.0, 0.1, 0.0])), ambient=0.2)
    cameras = overhead(count=2)
    gbuffer = floor_gbuffer(cameras, normal=(0.1, 1.0, -0.2))
    visibility = torch.rand(2, 4, 4, 6, generator=torch.Generator().manual_seed(0))
    image = shade(scene, gbuffer, visibility)
    for b in range(2):
        for j in range(1, 4):
            for i in range(6):
                p, n = gbuffer.position[b, j, i], gbuffer.normal[b, j, i]
                expected = slow_pixel(scene, cameras.eye[b], p, n, visibility[b, :, j, i].tolist())
                torch.testing.assert_close(image[b, j, i], expected, rtol=2e-5, atol=1e-6)


def test_a_range_cuts_the_inverse_square_off() -> None:
    """By torch and by the kernel; beyond the range nothing is left."""
    lights = (replace(LAMP, range=3.1), replace(SPOT, range=3.2), replace(LAMP, range=0.5))
    scene, cameras = floor_scene(*lights, material=GLOSSY), overhead(width=24, height=16)
    seen = floor_gbuffer(cameras)
    plain = shade(scene, seen)
    dark = 0
    for j in range(1, 16):
        for i in range(24):
            wanted = slow_pixel(scene, cameras.eye[0], seen.position[0, j, i], seen.normal[0, j, i], [1.0] * 3)
            torch.testing.assert_close(plain[0, j, i], wanted, rtol=2e-5, atol=1e-6)
            dark += not bool(wanted.any())
    assert 20 < dark < 300 and float(plain.max()) > 0
    fused = shade(scene, rasterize(scene, cameras))
    torch.testing.assert_close(fused[0, 1:], plain[0, 1:], rtol=1e-4, atol=1e-6)
    endless = floor_scene(*(replace(light, range=math.inf) for light in lights), material=GLOSSY)
    assert bool((shade(endless, seen)[0, 1:] >= plain[0, 1:]).all())


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_a_range_that_is_none_is_refused(value: float) -> None:
    for light in (LAMP, SPOT):
        with pytest.raises(OptionError, match="range"):
            replace(light, range=value)


def test_chunks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, gbuffer = floor_scene(*LIGHTS, material=GLOSSY), floor_gbuffer(overhead())
    whole = shade(scene, gbuffer)
    monkeypatch.setattr(module, "CHUNK", 5)
    torch.testing.assert_close(shade(scene, gbuffer), whole)


def test_fully_shadowed_pixel_is_exactly_texture_times_ambient() -> None:
    texture = torch.rand(8, 8, 3, generator=torch.Generator().manual_seed(1))
    scene = floor_scene(*LIGHTS, material=replace(GLOSSY, diffuse_texture=texture), ambient=0.25)
    gbuffer = floor_gbuffer(overhead())
    image = shade(scene, gbuffer, torch.zeros(1, 4, 4, 6))
    assert torch.equal(image[gbuffer.covered], (diffuse_color(scene, gbuffer) * 0.25)[gbuffer.covered])


def test_light_adds_up_and_scales() -> None:
    gbuffer = floor_gbuffer(overhead(), normal=(0.2, 1.0, 0.1))
    apart = sum(shade(floor_scene(light, material=GLOSSY), gbuffer) for light in LIGHTS)
    torch.testing.assert_close(shade(floor_scene(*LIGHTS, material=GLOSSY), gbuffer), apart)
    triple = replace(LAMP, intensity=3 * LAMP.intensity)
    torch.testing.assert_close(
        shade(floor_scene(triple, material=GLOSSY), gbuffer), 3 * shade(floor_scene(LAMP, material=GLOSSY), gbuffer)
    )


def test_no_visibility_means_all_lit() -> None:
    scene, gbuffer = floor_scene(*LIGHTS, material=GLOSSY), floor_gbuffer(overhead())
    torch.testing.assert_close(shade(scene, gbuffer), shade(scene, gbuffer, torch.ones(1, 4, 4, 6)))


def test_a_white_furnace_returns_the_albedo() -> None:
    """A Lambert surface in surroundings of radiance one sends out its albedo, whatever form the surroundings take."""
    gbuffer = floor_gbuffer(overhead(), normal=(0.3, 1.0, 0.2))
    albedo = torch.tensor([0.5, 0.4, 0.3])
    constant = shade(floor_scene(ambient=1.0), gbuffer)
    around = shade(replace(floor_scene(), environment=Environment.constant(torch.ones(3))), gbuffer)
    covered = gbuffer.covered
    torch.testing.assert_close(constant[covered], albedo.expand_as(constant[covered]))
    torch.testing.assert_close(around[covered], albedo.expand_as(constant[covered]), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(constant[~covered], torch.ones(6, 3))
    torch.testing.assert_close(around[~covered], torch.ones(6, 3))


def test_small_panel_acts_like_a_point_light() -> None:
    side = 0.01
    panel = RectLight(
        corner=torch.tensor([0.5 - side / 2, 2.0, -0.3 - side / 2]),
        edge_u=torch.tensor([side, 0.0, 0.0]),
        edge_v=torch.tensor([0.0, 0.0, side]),
        radiance=torch.full((3,), 1 / side**2),
    )
    gbuffer = floor_gbuffer(overhead())
    lamp = replace(LAMP, intensity=torch.ones(3))
    point = shade(floor_scene(lamp, material=GLOSSY), gbuffer)
    offset = (lamp.position - gbuffer.position).float()
    cosine = (offset[..., 1] / offset.norm(dim=-1))[..., None]  # of the panel, which emits by Lambert's law
    torch.testing.assert_close(shade(floor_scene(panel, material=GLOSSY), gbuffer), point * cosine, rtol=2e-3, atol=0)


def test_panel_shines_to_one_side_only() -> None:
    turned = replace(PANEL, edge_u=PANEL.edge_v, edge_v=PANEL.edge_u)
    gbuffer = floor_gbuffer(overhead())
    assert PANEL.normal.tolist() == [0.0, -1.0, 0.0] and turned.normal.tolist() == [0.0, 1.0, 0.0]
    lit, dark = (shade(floor_scene(light), gbuffer)[gbuffer.covered] for light in (PANEL, turned))
    assert float(lit.amin()) > 0 and float(dark.amax()) == 0


def test_phong_lobe_mirrors_its_degree_at_normal_incidence() -> None:
    """Light of radiance one from the whole hemisphere comes back as the degree, whatever the exponent; and its lobe."""
    cameras = Cameras.look_at([0.0, 1.0, 0.0], [0.0, 0.0, 0.0], width=3, height=3, fov_deg=1.0)

    def sun(tilt: float, irradiance: float) -> DirectionalLight:
        toward = torch.tensor([-math.sin(tilt), -math.cos(tilt), 0.0])
        return DirectionalLight(direction=toward, irradiance=torch.full((3,), irradiance))

    step = math.pi / 2 / 300
    tilts = [(number + 0.5) * step for number in range(300)]
    # The eye stands above: all directions of one tilt act alike, so one light carries the solid angle of its ring.
    hemisphere = [sun(tilt, 2 * math.pi * math.sin(tilt) * step) for tilt in tilts]
    for exponent in (1.0, 8.0, 64.0, 1000.0):
        mirror = Material(diffuse=torch.zeros(3), specular=0.7, shininess=exponent)
        whole = shade(floor_scene(*hemisphere, material=mirror), floor_gbuffer(cameras))[0, 1, 1, 0]
        assert float(whole) == pytest.approx(0.7, rel=5e-3)
        tilt = math.radians(20)
        seen = shade(floor_scene(sun(tilt, 1.0), material=mirror), floor_gbuffer(cameras))[0, 1, 1, 0]
        expected = 0.7 * math.cos(tilt) ** exponent * (exponent + 2) / (2 * math.pi) * math.cos(tilt)
        assert float(seen) == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("light", LIGHTS, ids=lambda light: light.name)
def test_light_below_the_surface_gives_nothing(light: Light) -> None:
    """Also where the shading normal leans so far that it would see the light."""
    below = torch.tensor([1.0, -1.0, 1.0])
    if isinstance(light, DirectionalLight):
        light = replace(light, direction=torch.tensor([-1.0, 0.05, 0.0]))
    elif isinstance(light, RectLight):
        light = RectLight(
            corner=torch.tensor([1.0, -1.0, 0.0]), edge_u=PANEL.edge_v, edge_v=torch.tensor([0.0, 0.9, 0.0])
        )
    else:
        light = replace(light, position=light.position * below - torch.tensor([-9.0, 0.0, 0.0]))
    gbuffer = floor_gbuffer(overhead(), normal=(1.0, 0.2, 0.0))
    assert float(shade(floor_scene(light, material=GLOSSY), gbuffer).abs().max()) == 0.0


def test_light_on_the_surface_stays_finite() -> None:
    gbuffer = floor_gbuffer(overhead())
    at = gbuffer.position[0, 2, 3]
    edge_u, edge_v = torch.tensor([0.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, 0.0])
    lights = (
        replace(LAMP, position=at),
        replace(LAMP, position=at + torch.tensor([0.0, 1e-20, 0.0])),
        replace(SPOT, position=at),
        RectLight(corner=at, edge_u=edge_u, edge_v=edge_v),
        RectLight(corner=at, edge_u=edge_u * 0, edge_v=edge_v),
        DirectionalLight(direction=torch.tensor([1.0, 0.0, 0.0])),
    )
    sharp = replace(GLOSSY, shininess=1e6)
    for light in lights:
        for material in (GLOSSY, sharp, replace(GLOSSY, shininess=0.0)):
            assert torch.isfinite(shade(floor_scene(light, material=material), gbuffer)).all()


@given(st.floats(-90, 90), st.floats(0, 360), st.floats(0, 1e6))
@settings(max_examples=30, deadline=None)
def test_never_negative_never_nan(elevation: float, azimuth: float, shininess: float) -> None:
    e, a = math.radians(elevation), math.radians(azimuth)
    direction = torch.tensor([math.cos(e) * math.cos(a), math.sin(e), math.cos(e) * math.sin(a)])
    scene = floor_scene(DirectionalLight(direction=direction), material=replace(GLOSSY, shininess=shininess))
    image = shade(scene, floor_gbuffer(overhead(), normal=(0.5, 1.0, 0.5)))
    assert torch.isfinite(image).all() and float(image.min()) >= 0.0


def test_vertex_colour_and_texture_multiply_the_diffuse_part_only() -> None:
    texture = torch.zeros(2, 2, 4)
    texture[..., 1] = 0.5
    gbuffer = floor_gbuffer(overhead())
    gbuffer = replace(gbuffer, color=gbuffer.color * torch.tensor([0.2, 0.4, 0.6]))
    textured = replace(GLOSSY, diffuse_texture=texture)
    image = shade(floor_scene(SUN, material=textured), gbuffer)
    plain = shade(floor_scene(SUN, material=replace(GLOSSY, diffuse=torch.zeros(3))), gbuffer)
    diffuse = (image - plain)[gbuffer.covered]
    torch.testing.assert_close(diffuse[:, (0, 2)], torch.zeros_like(diffuse[:, (0, 2)]))
    expected = 0.4 * 0.4 * 0.5 * float(SUN.irradiance[1]) * -float(SUN.direction[1]) / math.pi
    torch.testing.assert_close(diffuse[:, 1], torch.full_like(diffuse[:, 1], expected), rtol=1e-3, atol=1e-4)


def test_texture_top_row_is_v_one() -> None:
    texture = torch.zeros(2, 1, 3)
    texture[0] = 1.0
    gbuffer = floor_gbuffer(overhead())
    uv = torch.tensor([0.5, 0.75]).expand(1, 4, 6, 2)
    scene = floor_scene(material=Material(diffuse=torch.ones(3), diffuse_texture=texture), ambient=1.0)
    assert float(shade(scene, replace(gbuffer, uv=uv))[0, 1:].min()) == pytest.approx(1.0)


def test_background_colour_environment_and_ambient() -> None:
    cameras = overhead()
    gbuffer = floor_gbuffer(cameras)
    sky = torch.rand(16, 32, 3, generator=torch.Generator().manual_seed(3))
    scene = replace(floor_scene(ambient=0.3), environment=Environment(radiance=sky, rotation_deg=40.0))
    assert torch.equal(
        shade(scene, gbuffer, background=(1.0, 2.0, 3.0))[0, 0], torch.tensor([1.0, 2.0, 3.0]).expand(6, 3)
    )
    assert torch.equal(shade(floor_scene(ambient=0.3), gbuffer)[0, 0], torch.full((6, 3), 0.3))
    _, direction = cameras.rays()
    unit = torch.nn.functional.normalize(direction[0, 0], dim=-1).float()
    torch.testing.assert_close(shade(scene, gbuffer)[0, 0], scene.environment.lookup(unit))  # type: ignore[union-attr]


def test_batch_equals_single_views() -> None:
    scene = replace(floor_scene(*LIGHTS, material=GLOSSY), environment=Environment.constant(torch.ones(3)))
    cameras = overhead(count=3)
    whole = shade(scene, floor_gbuffer(cameras))
    for k in range(3):
        torch.testing.assert_close(shade(scene, floor_gbuffer(cameras[k]))[0], whole[k])


def test_orthographic_eye_direction_is_the_same_everywhere() -> None:
    cameras = replace(overhead(), orthographic=True, far=torch.tensor([10.0]).double())
    mirror = Material(diffuse=torch.zeros(3), specular=1.0, shininess=50.0)
    image = shade(floor_scene(SUN, material=mirror), floor_gbuffer(cameras))[0, 1:].reshape(-1, 3)
    torch.testing.assert_close(image, image[:1].expand_as(image))


def test_gradients_of_colours_and_intensities_agree_with_finite_differences() -> None:
    gbuffer = floor_gbuffer(overhead())

    def total(diffuse: Tensor, tint: Tensor, intensity: Tensor) -> Tensor:
        material = replace(GLOSSY, diffuse=diffuse, specular_color=tint)
        return shade(floor_scene(replace(LAMP, intensity=intensity), material=material), gbuffer).double().sum()

    values = [GLOSSY.diffuse, GLOSSY.specular_color, LAMP.intensity]
    inputs = [v.clone().requires_grad_() for v in values]
    gradients = torch.autograd.grad(total(*inputs), inputs)
    for place, gradient in enumerate(gradients):
        for channel in range(3):
            step = torch.zeros(3)
            step[channel] = 0.01
            high, low = ([v + sign * step if k == place else v for k, v in enumerate(values)] for sign in (1, -1))
            slope = float(total(*high) - total(*low)) / 0.02
            assert float(gradient[channel]) == pytest.approx(slope, rel=2e-3)


def test_empty_images_and_scenes() -> None:
    empty = torch.full((1, 4, 6), -1)
    gbuffer = replace(floor_gbuffer(overhead()), triangle=empty, material=empty)
    assert torch.equal(shade(Scene(), gbuffer), torch.zeros(1, 4, 6, 3))
    assert torch.equal(diffuse_color(Scene(), gbuffer), torch.zeros(1, 4, 6, 3))


def test_wrong_visibility_is_named() -> None:
    with pytest.raises(InputError, match=r"visibility must have shape \(1, 4, 4, 6\)"):
        shade(floor_scene(*LIGHTS), floor_gbuffer(overhead()), torch.ones(1, 3, 4, 6))


def test_far_from_the_world_origin_nothing_changes() -> None:
    away = torch.tensor([1e5, -2e5, 3e5])
    lamp = replace(LAMP, position=torch.tensor([0.5, 2.0, -0.25]))
    near = floor_scene(lamp, material=GLOSSY)
    moved_floor = replace(FLOOR, vertices=FLOOR.vertices.double() + away)
    far = replace(near, meshes=(moved_floor,), lights=(replace(lamp, position=lamp.position + away),))
    cameras = overhead()
    matrix = cameras.camera_from_world.clone()
    matrix[:, :3, 3] -= (cameras.rotation @ away.double()[:, None])[..., 0]
    gbuffer = floor_gbuffer(cameras)
    covered = gbuffer.covered
    position = torch.where(covered[..., None], gbuffer.position.double() + away, 0.0)
    moved = replace(gbuffer, cameras=replace(cameras, camera_from_world=matrix), position=position)
    torch.testing.assert_close(shade(far, moved)[covered], shade(near, gbuffer)[covered], rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("area_light", ["polygon", "centre"])
@pytest.mark.parametrize("seen", ["triangles", "samples"])
def test_rectangles_send_their_light_to_one_side(seen: str, area_light: str) -> None:
    """Seen by the compiled kernel, which takes triangles, and by torch."""
    corner, u, v = torch.tensor([-0.5, 1.5, -0.5]), torch.tensor([1.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, 1.0])
    sums = []
    for first, second in ((u, v), (v, u)):
        scene = floor_scene(RectLight(corner=corner, edge_u=first, edge_v=second, radiance=torch.ones(3)))
        cameras = overhead()
        gbuffer = rasterize(scene, cameras) if seen == "triangles" else floor_gbuffer(cameras)
        sums.append(float(shade(scene, gbuffer, area_light=area_light).sum()))
    assert min(sums) == 0.0 and max(sums) > 0.1


@pytest.mark.parametrize("seen", ["triangles", "samples"])
def test_empty_pixels_show_what_the_environment_shows_and_not_what_it_sheds(seen: str) -> None:
    around = Environment(radiance=torch.full((4, 8, 3), 0.5), shown=torch.full((4, 8, 3), 2.0))
    scene, cameras = replace(floor_scene(), environment=around), overhead()
    if seen == "triangles":
        cameras = Cameras.look_at((0.0, 5.0, 0.0), (0.0, 9.0, 1.0), width=6, height=4)
    gbuffer = rasterize(scene, cameras) if seen == "triangles" else floor_gbuffer(cameras)
    empty = ~gbuffer.covered
    assert bool(empty.any())
    torch.testing.assert_close(shade(scene, gbuffer)[empty], torch.full((int(empty.sum()), 3), 2.0))
