"""Light of an environment on glossy surfaces: maps that are read at once, beside the sum over all pixels of the map."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from torchrender.raster import rasterize
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.material import PHONG, Material
from torchrender.scene.model import Scene
from torchrender.scene.sky.irradiance import latlong_directions, solid_angles
from torchrender.shade import shade
from torchrender.shading.sky import MIRRORED_SIDES, SkyMaps
from torchrender.tuning.systems.system import System, Trial

ROWS = 48
"""Of the map, and half its columns: few enough to sum over."""
ROUGHNESS = (0.3, 0.45, 0.6)
"""Of the materials in turn: lobes that are wider than the map's pixels. Every other one is a metal."""
SCALES = (16, 4, 1)
"""By which the sides of the maps of mirrored light are divided."""


def light_of_pixels(sky: Environment) -> tuple[DirectionalLight, ...]:
    """A parallel light from the middle of every pixel of a map, as it lies: without rotation and intensity."""
    height, width, _ = sky.radiance.shape
    toward = latlong_directions(height, width).reshape(-1, 3)
    power = (sky.radiance * solid_angles(height, width)[..., None].float()).reshape(-1, 3)
    return tuple(DirectionalLight(direction=-d, irradiance=light) for d, light in zip(toward, power, strict=True))


def small_sky(sky: Environment) -> Environment:
    """What surfaces see of a map, in few pixels."""
    fine = sky.lookup(latlong_directions(4 * ROWS, 8 * ROWS)).permute(2, 0, 1)[None]
    radiance = torch.nn.functional.avg_pool2d(fine, 4)[0].permute(1, 2, 0).contiguous()
    return Environment(radiance=radiance, name=sky.name)


def glossy(materials: Sequence[Material]) -> tuple[Material, ...]:
    """The materials with their colours, in turn plastics and metals of several roughnesses."""
    usual: dict[str, Any] = {name: number for name, (number, _) in PHONG.items()}
    return tuple(
        material
        if material.unlit
        else replace(material, **usual, metallic=float(number % 2), roughness=ROUGHNESS[number // 2 % len(ROUGHNESS)])
        for number, material in enumerate(materials)
    )


def _even(scene: Scene, sky: Environment) -> Scene:
    """The scene under the mean of the map."""
    weight = solid_angles(*sky.radiance.shape[:2])[..., None].float() / (4.0 * math.pi)
    return replace(scene, ambient=(sky.radiance * weight).sum(dim=(0, 1)))


def _environment(scene: Scene, size: int) -> Trial | None:
    apart = scene.with_sun_apart()
    if apart.environment is None or apart.environment.fill or not scene.geometry.triangle_count:
        return None
    sky = small_sky(apart.environment)
    materials = glossy(scene.materials)
    dark = replace(scene, materials=materials, lights=(), ambient=torch.zeros(3), environment=None)
    gbuffer = rasterize(dark, scene.camera(width=size, height=size))

    def shaded(lit: Scene) -> Tensor:
        return torch.where(gbuffer.covered[..., None], shade(lit, gbuffer), 0.0)

    settings: dict[str, Callable[[], Tensor]] = {"even": partial(shaded, _even(dark, sky))}
    for scale in SCALES:
        own = replace(sky)  # nothing is made of it yet
        sides = [max(side // scale, 2) for side in MIRRORED_SIDES]
        settings[f"maps of {sides[0]}"] = partial(_with_maps, shaded, replace(dark, environment=own), sides)
    return Trial(
        settings=settings,
        picture=lambda made: made,
        reference=lambda: shaded(replace(dark, lights=light_of_pixels(sky))),
    )


def _with_maps(shaded: Callable[[Scene], Tensor], scene: Scene, sides: Sequence[int]) -> Tensor:
    assert scene.environment is not None
    if not SkyMaps.are_made(scene.environment, True):
        SkyMaps.of(scene.environment, True, sides)
    return shaded(scene)


ENVIRONMENT = System(
    name="environment_light",
    summary="reads light of the environment from prefiltered maps; surfaces are in turn plastics and rough metals, and "
    "nothing hides the sky",
    reference=f"every pixel of the map, {ROWS} rows, a light of its own",
    trial=_environment,
)
