"""Scenes with all that scattering takes from other passes, and the errors of its pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.checks import checked_fields
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, ScatteringLayer, scatter
from torchrender.effects.shadows.shadow_map import ShadowOptions, render_shadow_map
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene

SUN_FINER = 4
"""Times as many texels of a sun's image as of a lamp's: what the planner has drawn for shafts."""
SUN_STEPS = 8
"""Times as many steps before a sun as at a lamp: with 512 of equal length the reference itself is 3 % off."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StudyOptions:
    """How much is measured."""

    size: tuple[int, int] = (800, 600)  # of pictures that are timed
    small: tuple[int, int] = (200, 150)  # of T1 as published, and of pictures beside a path tracer
    map_size: int = 1024  # texels of lamps' images, of a side; suns' have SUN_FINER times as many
    published_steps: int = 128  # of T1 as published
    probes: int = 2000  # pixels of large pictures, from anywhere and from edges, that are compared with references
    rays_steps: int = 512  # of these at lamps, each with a shadow ray; before suns SUN_STEPS times as many
    frames: int = 60  # of the film
    film: tuple[int, int] = (160, 120)
    runs: int = 3
    peer_samples: tuple[int, ...] = (1, 4, 16, 64)  # per pixel, of the path tracer
    peer_seeds: int = 1  # pictures whose mean is the reference of the path tracer


QUICK = StudyOptions(
    size=(80, 60), small=(40, 30), map_size=256, published_steps=32, probes=100, rays_steps=64, frames=4,
    film=(40, 30), runs=1,
    peer_samples=(1, 4), peer_seeds=1,
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Stage:
    """A scene with everything that scattering takes from other passes."""

    scene: Scene
    camera: Cameras
    seen: GBuffer
    lit: Illumination

    @classmethod
    def of(
        cls, scene: Scene, camera: Cameras, size: int, *, shadows: bool = True, caster: RayCaster | None = None
    ) -> Stage:
        """With shadow maps of ``size`` texels, finer ones of suns; ``caster``: one that is known already."""
        sides = [SUN_FINER * size if isinstance(light, DirectionalLight) else size for light in scene.lights]
        drawn = zip(scene.lights, sides, strict=True)
        maps = tuple(render_shadow_map(scene, light, ShadowOptions(size=side)) for light, side in drawn)
        caster = caster or RayCaster(scene.geometry)
        lit = Illumination(lights=scene.lights, shadow_maps=maps if shadows else (), caster=caster, size=scene.diagonal)
        return cls(scene, camera, rasterize(scene, camera), lit)

    def layer(self, **options: Any) -> ScatteringLayer:
        """By these options."""
        how = ScatterOptions(**options)
        return scatter(self.scene.media, self.camera, self.seen.depth, self.lit, how, position=self.seen.position)

    def light(self, **options: Any) -> Tensor:
        """(H,W) float64 scattered light, of one colour."""
        return self.layer(**options).scattered[0, ..., 0].double()


def errors(found: Tensor, wanted: Tensor, edge: Tensor | None = None) -> dict[str, float]:
    """RMSE over the mean, and percentile and maximum of relative errors; with ``edge`` RMSE there."""
    off = found - wanted
    relative = (off.abs() / wanted.clamp_min(1e-3 * float(wanted.mean()))).reshape(-1)
    made = {
        "rmse": float(off.square().mean().sqrt() / wanted.mean()),
        "p99": float(relative.kthvalue(max(int(0.99 * relative.numel()), 1)).values),
        "max": float(relative.max()),
    }
    if edge is not None and bool(edge.any()):
        made["edge"] = float(off[edge].square().mean().sqrt() / wanted[edge].mean().clamp_min(1e-12))
    return made


def shaft_edges(light: Tensor) -> Tensor:
    """(H,W) bool: the twentieth of the pixels where light changes most, as a share of it."""
    dy, dx = torch.gradient(light)
    change = torch.sqrt(dx * dx + dy * dy) / (light + 0.1 * light.mean())
    return change > change.reshape(-1).kthvalue(int(0.95 * change.numel())).values
