"""Lights are listed for blocks of pixels: what is not listed is left out, and what is left out lights nothing."""

from __future__ import annotations

from dataclasses import replace

import torch

from torchrender.effects.shadows.light_reach import light_reach
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.shade import sent_light, shade
from torchrender.shading.lights import LightLists

CAMERAS = Cameras.look_at([0.0, 1.0, 4.0], [0.0, 0.0, 0.0], width=70, height=50, fov_deg=40.0)


def scene_of_spots(material: Material) -> Scene:
    """Narrow spots from all around, most of which miss a ball."""
    generator = torch.Generator().manual_seed(3)
    lights = []
    for number in range(24):
        place = 3.0 * torch.nn.functional.normalize(torch.randn(3, generator=generator), dim=0)
        aim = place + torch.randn(3, generator=generator) * (0.2 if number % 3 == 0 else 4.0) - place * 1.2
        direction = torch.nn.functional.normalize(aim - place, dim=0)
        lights.append(
            SpotLight(
                position=place, direction=direction, intensity=torch.full((3,), 2.0), inner_deg=6.0, outer_deg=9.0
            )
        )
    return Scene(meshes=(sphere(segments=24),), materials=(material,), lights=tuple(lights))


def lists_of(scene: Scene, seen: object) -> LightLists:
    found = light_reach(scene, seen)  # type: ignore[arg-type]
    return LightLists(found.starts, found.lights, found.side)


def test_listed_lights_give_the_same_picture() -> None:
    """A black, glossy thing too: it takes light for its highlights alone."""
    for material in (Material(), Material(metallic=0.0, roughness=0.3, diffuse=torch.zeros(3))):
        scene = scene_of_spots(material)
        seen = rasterize(scene, CAMERAS)
        lists = lists_of(scene, seen)
        assert 0 < len(lists.lights) < 0.7 * len(scene.lights) * (len(lists.starts) - 1)
        wanted = shade(scene, seen)
        assert float(wanted.max()) > 0
        torch.testing.assert_close(sent_light(scene, seen, lists=lists).radiance, wanted, atol=1e-6, rtol=1e-5)


def test_lists_decide_which_lights_are_looked_at() -> None:
    scene = scene_of_spots(Material())
    seen = rasterize(scene, CAMERAS)
    lists = lists_of(scene, seen)
    none = lists._replace(starts=torch.zeros_like(lists.starts))
    dark = shade(replace(scene, lights=()), seen)
    torch.testing.assert_close(sent_light(scene, seen, lists=none).radiance, dark)


def test_shadow_factors_of_some_lights_alone() -> None:
    lamps = tuple(PointLight(position=torch.tensor([x, 3.0, 2.0]), intensity=torch.ones(3)) for x in range(6))
    scene = replace(scene_of_spots(Material()), lights=lamps)
    seen = rasterize(scene, CAMERAS)
    factors = torch.rand(1, 2, 50, 70, generator=torch.Generator().manual_seed(0))
    every = torch.ones(1, 6, 50, 70)
    every[:, [1, 4]] = factors
    lists = lists_of(scene, seen)._replace(shaded=(1, 4))
    wanted = shade(scene, seen, every)
    torch.testing.assert_close(sent_light(scene, seen, factors, lists=lists).radiance, wanted)
    bright = replace(scene.materials[0], diffuse=torch.full((3,), 0.8, requires_grad=True))
    torch_scene = replace(scene, materials=(bright,))
    seen = rasterize(torch_scene, CAMERAS)
    torch.testing.assert_close(
        sent_light(torch_scene, seen, factors, lists=lists).radiance.detach(), wanted, atol=1e-5, rtol=1e-4
    )
