"""Reflections by rays: the law of reflection, the virtual picture behind a plane mirror, and the blend."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from torchrender.buffers import ReflectionState
from torchrender.effects.reflections.reflectors import blend_reflections, reflective, reflective_pixels
from torchrender.effects.reflections.traced import TraceOptions, environment_reflections, trace_reflections
from torchrender.errors import OptionError
from torchrender.numerics.lobe import lobe_directions, reflect, schlick
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.shade import shade
from torchrender.shading.ray_surface import ray_surface


def rectangle(corner: list[float], u: list[float], v: list[float], material: int) -> Mesh:
    a, eu, ev = (torch.tensor(x, dtype=torch.float64) for x in (corner, u, v))
    vertices = torch.stack([a, a + eu, a + eu + ev, a + ev])
    uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), uv=uv, material=material)


def checks(size: int = 8) -> Tensor:
    board = (torch.arange(size)[:, None] + torch.arange(size)) % 2
    return (0.1 + 0.8 * board.float())[..., None].expand(size, size, 3).contiguous()


def mirror_scene(gloss: float = 0.0) -> Scene:
    """A mirror in the plane z = 0, facing +z, and a textured card at z = 4 that faces it."""
    return Scene(
        meshes=(
            rectangle([-3.0, -3.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 0),
            rectangle([3.0, -2.0, 4.0], [-4.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1),
        ),
        materials=(
            Material(name="mirror", specular=1.0, gloss=gloss, diffuse=torch.zeros(3)),
            Material(name="card", diffuse=torch.ones(3), diffuse_texture=checks()),
        ),
        lights=(PointLight(position=torch.tensor([0.0, 0.0, 2.0]), intensity=torch.full((3,), 20.0)),),
        ambient=torch.full((3,), 0.2),
    )


def eye(size: int = 64) -> Cameras:
    return Cameras.look_at([-0.5, 0.0, 3.0], [0.4, 0.1, 0.0], width=size, height=size, fov_deg=60.0)


def traced(scene: Scene, cameras: Cameras, mask: Tensor | None = None, rays: int = 8):
    gbuffer = rasterize(scene, cameras)
    pixels = reflective_pixels(scene, gbuffer, mask)
    options = TraceOptions(glossy_rays=rays)
    return (
        gbuffer,
        pixels,
        trace_reflections(RayCaster(scene.geometry), pixels, hit_shader(scene, RenderOptions(shadows=False)), options),
    )


def test_a_mirror_shows_what_the_mirrored_camera_sees() -> None:
    scene, cameras = mirror_scene(), eye()
    _, _, layer = traced(scene, cameras)
    flip = torch.diag(torch.tensor([1.0, 1.0, -1.0, 1.0], dtype=torch.float64))
    behind = Cameras(
        cameras.camera_from_world @ flip, cameras.intrinsics, 64, 64, cameras.near, cameras.far
    )  # left-handed: the eye mirrored at z = 0
    card = Scene(meshes=scene.meshes[1:], materials=scene.materials, lights=scene.lights, ambient=scene.ambient)
    picture = shade(card, rasterize(card, behind))
    seen = (layer.state == ReflectionState.TRACED)[0]
    assert int(seen.sum()) > 500
    difference = (layer.color[0] - picture[0])[seen].abs().amax(-1)
    assert float(difference.median()) < 1e-4
    assert float((difference > 0.02).float().mean()) < 0.01  # at the card's rim, float32 decides


def test_distance_leads_to_the_reflected_point() -> None:
    gbuffer, _, layer = traced(mirror_scene(), eye())
    seen = layer.state == ReflectionState.TRACED
    point = gbuffer.position + layer.distance[..., None] * layer.direction
    assert float((point[seen][:, 2] - 4.0).abs().max()) < 1e-5
    left = layer.state == ReflectionState.ENVIRONMENT
    assert bool(left.any())
    assert bool(torch.isinf(layer.distance[left]).all())
    none = layer.state == ReflectionState.NONE
    assert not bool(layer.color[none].any()) and not bool(layer.direction[none].any())


def test_a_mask_traces_its_pixels_alone_and_alike() -> None:
    scene, cameras = mirror_scene(), eye()
    _, _, whole = traced(scene, cameras)
    mask = torch.zeros(1, 64, 64, dtype=torch.bool)
    mask[:, ::5, ::7] = True
    _, pixels, some = traced(scene, cameras, mask)
    assert 0 < len(pixels) <= int(mask.sum())
    assert torch.equal(some.color[mask], whole.color[mask])
    assert not bool((some.state[~mask] != ReflectionState.NONE).any())


def test_shadows_stand_in_reflections() -> None:
    base = mirror_scene()
    blocker = rectangle([1.2, -0.5, 3.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1)
    scene = Scene(meshes=(*base.meshes, blocker), materials=base.materials, lights=base.lights, ambient=base.ambient)
    lit = render(scene, eye(), options=RenderOptions(reflections="traced", shadows=False)).radiance
    dark = render(scene, eye(), options=RenderOptions(reflections="traced")).radiance
    mirror = reflective(scene, rasterize(scene, eye()))
    assert float((lit - dark)[mirror].amax()) > 0.1
    assert float((dark - lit)[mirror].amax()) < 1e-4


def test_hits_carry_the_same_attributes_and_light_as_pixels() -> None:
    scene, cameras = mirror_scene(), eye()
    gbuffer = rasterize(scene, cameras)
    origins, directions = (x.reshape(-1, 3) for x in cameras.rays())
    hits = RayCaster(scene.geometry).first_hit(origins, directions)
    width = gbuffer.depth.reshape(-1).double() * float(1.0 / cameras.intrinsics[0, 0, 0])
    surface = ray_surface(scene, origins, directions, hits, torch.where(torch.isfinite(width), width, 0.0))
    same = hits.triangle == gbuffer.triangle.reshape(-1)
    assert float(same.float().mean()) > 0.99
    for name in ("position", "normal", "geometric_normal", "uv", "uv_footprint", "color"):
        mine, other = getattr(surface, name), getattr(gbuffer, name)
        other = other.reshape(mine.shape)
        assert torch.allclose(mine[same], other[same], atol=2e-5, rtol=1e-4), name
    image = shade(scene, gbuffer).reshape(-1, 3)
    chosen = same & hits.hit
    assert torch.allclose(shade(scene, surface.image)[0, 0][chosen], image[chosen], atol=1e-4)


def test_blend_is_schlick() -> None:
    scene = mirror_scene()
    gbuffer, _, layer = traced(scene, eye())
    direct = torch.rand(1, 64, 64, 3, generator=torch.Generator().manual_seed(1))
    mixed = blend_reflections(scene, gbuffer, direct, layer)
    mirror = layer.state != ReflectionState.NONE
    assert torch.allclose(mixed[mirror], layer.color[mirror], atol=1e-6)  # degree 1 mirrors at every angle
    assert torch.equal(mixed[~mirror], direct[~mirror])
    degree, cosine = torch.tensor([0.0, 0.3, 0.3, 1.0]), torch.tensor([0.0, 1.0, 0.0, 0.4])
    assert torch.allclose(schlick(degree, cosine), torch.tensor([0.0, 0.3, 1.0, 1.0]))


def test_gloss_zero_is_the_mirror_and_small_gloss_is_near_it() -> None:
    _, _, mirror = traced(mirror_scene(), eye())
    _, _, nearly = traced(mirror_scene(gloss=1e-4), eye(), rays=8)
    assert float((mirror.color - nearly.color).abs().mean()) < 2e-3
    _, _, wide = traced(mirror_scene(gloss=0.6), eye(), rays=49)
    assert float(wide.color.std()) < 0.8 * float(mirror.color.std())


def test_lobes_fill_their_cone_above_the_surface() -> None:
    generator = torch.Generator().manual_seed(3)
    axis = torch.nn.functional.normalize(torch.randn(200, 3, generator=generator, dtype=torch.float64), dim=-1)
    gloss = torch.rand(200, generator=generator, dtype=torch.float64)
    turn = torch.rand(200, generator=generator, dtype=torch.float64)
    cone = lobe_directions(axis, axis, gloss, 16, turn)
    assert torch.allclose(cone.norm(dim=-1), torch.ones(200, 16, dtype=torch.float64))
    cosine = (cone * axis[:, None]).sum(-1)
    assert bool((cosine >= torch.cos(gloss * math.pi / 6)[:, None] - 1e-12).all())
    uniform = 1.0 - (1.0 - torch.cos(gloss * math.pi / 6)) / 2  # mean cosine over a cap of equal areas
    assert torch.allclose(cosine.mean(1), uniform, atol=1e-12)
    normal = torch.nn.functional.normalize(axis + 1.2 * torch.randn(200, 3, generator=generator), dim=-1)
    above = (axis * normal).sum(-1) > 0.0
    grazing = lobe_directions(axis[above], normal[above], gloss[above], 49, turn[above])
    assert float((grazing * normal[above, None]).sum(-1).min()) >= -1e-12
    flat = lobe_directions(axis, axis, torch.zeros_like(gloss), 8, turn)
    assert torch.equal(flat, axis[:, None].expand(200, 8, 3))


def test_reflect_keeps_length_and_turns_the_normal_part() -> None:
    d = torch.tensor([[0.6, -0.8, 0.0]])
    assert torch.allclose(reflect(d, torch.tensor([[0.0, 1.0, 0.0]])), torch.tensor([[0.6, 0.8, 0.0]]))


def test_the_environment_is_what_the_centre_sees() -> None:
    scene = mirror_scene()
    gbuffer = rasterize(scene, eye())
    pixels = reflective_pixels(scene, gbuffer)
    shader = hit_shader(scene, RenderOptions(shadows=False))
    layer = environment_reflections(pixels, shader)
    mirror = layer.state == ReflectionState.ENVIRONMENT
    leaving = (pixels.position, pixels.object_id)
    assert torch.equal(layer.color[mirror], shader.environment(pixels.direction, leaving=leaving))
    # Straight ahead from the centre (0, 0, 2) the cube map shows the card, straight back the mirror.
    ahead = shader.environment(torch.tensor([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    assert float(ahead[0].mean()) > 0.15
    hit = RayCaster(scene.geometry).first_hit(torch.tensor([[0.0, 0.0, 2.0]]), torch.tensor([[0.0, 0.0, -1.0]]))
    assert int(hit.triangle) < 2


@pytest.mark.parametrize("mode", ["traced", "environment"])
def test_no_reflector_in_view_costs_nothing(mode: str) -> None:
    scene = mirror_scene()
    away = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 9.0], width=16, height=16)
    plain = render(scene, away, options=RenderOptions(reflections="off")).radiance
    assert torch.equal(render(scene, away, options=RenderOptions(reflections=mode)).radiance, plain)
    assert len(reflective_pixels(scene, rasterize(scene, away))) == 0


def test_options_name_what_is_wrong() -> None:
    with pytest.raises(OptionError, match="glossy_rays"):
        TraceOptions(glossy_rays=0)
    with pytest.raises(OptionError, match="reflections"):
        RenderOptions(reflections="mirrors")
