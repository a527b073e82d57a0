"""The light of what rays hit: how wide a ray is where it arrives decides how much of a texture it sees."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.effects.reflections.reflectors import ReflectedRays
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.numerics.texture import build_pyramid, sample_texture
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import quad

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
