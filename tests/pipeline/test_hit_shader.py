"""The light of what rays hit: how wide a ray is where it arrives decides how much of a texture it sees."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.effects.reflections.reflectors import ReflectedRays
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions
from torchrender.numerics.texture import build_pyramid, sample_texture
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.renderer import light_of_samples, render
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import RectLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, quad

SIDE, CELLS = 8.0, 64


def checks() -> Tensor:
    board = (torch.arange(CELLS)[:, None] + torch.arange(CELLS)) % 2
    return board.float()[..., None].expand(CELLS, CELLS, 3).contiguous()


def card(distance: float, *others: object) -> Scene:
    """A card of fine checks at z = ``distance`` that faces -z, in light of one from everywhere."""
    mesh = quad(
        torch.tensor([SIDE / 2, -SIDE / 2, distance]), torch.tensor([-SIDE, 0.0, 0.0]), torch.tensor([0.0, SIDE, 0.0])
    )
    paint = Material(diffuse=torch.ones(3), diffuse_texture=checks())
    return Scene(meshes=(mesh, *others), materials=(paint, Material(specular=1.0)), ambient=torch.ones(3))  # type: ignore[arg-type]


def shaded(scene: Scene, distance: float, width: float, spread: float) -> tuple[Tensor, Tensor]:
    """Radiance (N,3) that parallel rays bring from the card, and its texture coordinates there."""
    place = torch.rand(200, 2, generator=torch.Generator().manual_seed(4), dtype=torch.float64) * 6.0 - 3.0
    origin = torch.cat([place, torch.zeros(200, 1, dtype=torch.float64)], dim=1)
    direction = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(200, 3).contiguous()
    hits: RayHits = RayCaster(scene.geometry).first_hit(origin, direction)
    assert hits.t.tolist() == pytest.approx([distance] * 200)
    rays = ReflectedRays(
        origin, direction, torch.full((200,), width).double(), torch.full((200,), spread, dtype=torch.float64)
    )
    uv = torch.stack([0.5 - place[:, 0] / SIDE, 0.5 + place[:, 1] / SIDE], dim=1)
    return hit_shader(scene)(rays, hits), uv


@pytest.mark.parametrize("distance", [1.0, 3.0, 20.0])
def test_a_ray_is_as_wide_as_it_starts_and_what_it_spreads(distance: float) -> None:
    width, spread = 0.1, 0.05
    found, uv = shaded(card(distance), distance, width, spread)
    footprint = torch.full((200,), (width + spread * distance) / SIDE)
    expected = sample_texture(build_pyramid(checks()), uv, footprint)
    torch.testing.assert_close(found, expected, rtol=0, atol=2e-3)
    if distance == 1.0:
        assert float(found.std()) > 0.1  # the checks still show


def test_far_checks_in_a_mirror_read_near_their_mean() -> None:
    """Two cells of the board fall into a pixel: the picture is grey, not a pattern of beats."""
    mirror = quad(torch.tensor([-4.0, -4.0, 0.0]), torch.tensor([8.0, 0.0, 0.0]), torch.tensor([0.0, 8.0, 0.0]))
    scene = card(60.0, type(mirror)(**{**vars(mirror), "material": 1}))
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=240, height=240, fov_deg=60.0)
    options = RenderOptions(reflections="traced", tracing=TraceOptions(glossy_rays=1))
    seen = render(scene, camera, options=options).radiance[0]
    on_card = seen[108:132, 108:132]
    assert float(on_card.mean()) == pytest.approx(0.5, abs=0.05)
    assert float(on_card.std()) < 0.05


def test_a_mirror_shows_metal_with_its_textures() -> None:
    """Polished gold by its texture alone, seen by way of a mirror under a white sky: what is seen of it directly."""
    gold = torch.tensor([1.0, 0.6, 0.2])
    metal = Material(
        diffuse=torch.ones(3),
        diffuse_texture=gold.expand(4, 4, 3).contiguous(),
        metallic=1.0,
        roughness=1.0,
        metallic_roughness_texture=torch.tensor([0.0, 0.0, 1.0]).expand(4, 4, 3).contiguous(),
    )
    mirror = quad(torch.tensor([-4.0, -4.0, 0.0]), torch.tensor([8.0, 0.0, 0.0]), torch.tensor([0.0, 8.0, 0.0]))
    plate = quad(torch.tensor([4.0, -4.0, 9.0]), torch.tensor([-8.0, 0.0, 0.0]), torch.tensor([0.0, 8.0, 0.0]))
    scene = Scene(
        meshes=(replace(mirror, material=0), replace(plate, material=1)),
        materials=(Material(specular=1.0, diffuse=torch.zeros(3)), metal),
        environment=Environment.constant(torch.ones(3)),
    )
    camera = Cameras.look_at([0.0, 0.0, 4.0], [0.3, 0.2, 0.0], width=32, height=32, fov_deg=20.0)
    options = RenderOptions(reflections="traced", tracing=TraceOptions(bounces=3), ambient_visibility="off")
    seen = render(scene, camera, options=options).radiance[0, 8:24, 8:24].reshape(-1, 3).mean(dim=0)
    # The plate mirrors the mirror, which mirrors the plate once more, and so on: between one and three times gold.
    assert bool((seen <= gold + 0.02).all()) and bool((seen >= gold**3 - 0.02).all())
    assert float(seen[2] / seen[0]) < 0.4


def below_a_lamp() -> tuple[Scene, Cameras]:
    """A beam over a floor, below a lamp as wide as it is high; and a view of what it shadows."""
    floor = quad(torch.tensor([-4.0, 0.0, 4.0]), torch.tensor([8.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, -8.0]))
    beam = box(torch.tensor([0.6, 0.2, 6.0]))
    beam = replace(beam, vertices=beam.vertices + torch.tensor([0.0, 1.2, 0.0]))
    lamp = RectLight(corner=[-1, 3, -1], edge_u=[2, 0, 0], edge_v=[0, 0, 2], radiance=2.0)
    camera = Cameras.look_at([0.0, 1.0, 0.1], [0.0, 0.0, 0.0], width=64, height=64, fov_deg=100.0, near=0.01)
    return Scene(meshes=(floor, beam), materials=(Material(), Material(specular=1.0)), lights=(lamp,)), camera


def shown_to_rays(scene: Scene, camera: Cameras, options: RenderOptions) -> Tensor:
    """Light (N,3) that the rays of a camera bring as those of a mirror would."""
    origin, direction = (rays.reshape(-1, 3) for rays in camera.rays())
    direction = torch.nn.functional.normalize(direction, dim=-1)
    none = torch.zeros(len(origin), dtype=torch.float64)
    hits = RayCaster(scene.geometry).first_hit(origin, direction)
    assert bool(hits.hit.all())
    return hit_shader(scene, options)(ReflectedRays(origin, direction, none, none), hits)


FOUR = RenderOptions(area_shadows="sampled", soft_shadow=SoftShadowOptions(light_samples=4))


def test_hits_have_the_shadows_of_lamps_that_the_picture_has() -> None:
    """Rays of the eye bring what the eye sees: sampled penumbrae as they are, hard ones but for the borders in maps."""
    scene, camera = below_a_lamp()
    for options, most in ((RenderOptions(area_shadows="hard"), 0.05), (FOUR, 1e-4)):
        seen = render(scene, camera, options=options).radiance.reshape(-1, 3)
        apart = (shown_to_rays(scene, camera, options) - seen).abs()
        assert float(apart.mean()) < most * float(seen.mean())


def test_guessed_penumbrae_of_hits_are_nearer_to_the_truth_than_hard_shadows() -> None:
    scene, camera = below_a_lamp()
    truth = render(scene, camera, options=RenderOptions(area_shadows="sampled")).radiance.reshape(-1, 3)
    hard, guessed = (
        float((shown_to_rays(scene, camera, RenderOptions(area_shadows=way)) - truth).abs().mean())
        for way in ("hard", "pcss")
    )
    assert guessed < 0.96 * hard


def test_samples_beside_a_picture_keep_its_shader_of_hits() -> None:
    """Extra layers of a stream are lit as the picture: what mirrors show is not made anew for each of both in turn."""
    scene, camera = below_a_lamp()
    mirror = quad(torch.tensor([-1.0, 0.01, 1.0]), torch.tensor([2.0, 0.0, 0.0]), torch.tensor([0.0, 0.0, -2.0]))
    scene = replace(scene, meshes=(*scene.meshes, replace(mirror, material=1)))
    few = SoftShadowOptions(light_samples=4)
    options = RenderOptions(area_shadows="sampled", soft_shadow=few, reflections="traced")
    history = render(scene, camera, options=options, history=RenderHistory()).history
    assert history is not None and history.last(HIT_SHADER) is not None
    lit = light_of_samples(scene, rasterize(scene, camera), options, history)
    assert lit.history.last(HIT_SHADER) is history.last(HIT_SHADER)
    assert lit.plan.options.area_shadows == "sampled"
    alone = light_of_samples(scene, rasterize(scene, camera), options)
    assert alone.plan.options.area_shadows == "pcss"
