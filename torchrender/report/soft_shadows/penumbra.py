"""Penumbrae of pictures against 4,096 rays to the light each, by the number of samples that they are made with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.shadow_map import light_visibility, options_for
from torchrender.effects.shadows.soft_shadow import Occluders, SoftShadowOptions, occluders, soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.progress import part
from torchrender.report.soft_shadows.subject import StudyOptions
from torchrender.scene.light import RectLight
from torchrender.scene.procedural import build

TRUE_SAMPLES = 64  # along each edge of the light


def penumbra_errors(study: StudyOptions) -> list[dict[str, Any]]:
    """One record for each scene and number of samples: error over penumbra pixels alone, 0 to 255, and time."""
    return [row for name in study.penumbra_scenes for row in _of_scene(name, study)]


def _of_scene(name: str, study: StudyOptions) -> list[dict[str, Any]]:
    with part(f"penumbra, {name}"):
        scene = build(name)
        light = next(light for light in scene.lights if isinstance(light, RectLight))
        seen = rasterize(scene, scene.camera(width=study.penumbra_picture, height=study.penumbra_picture))
        caster, ready = RayCaster(scene.geometry), occluders(scene.geometry)
        first = traced_visibility(caster, light, seen, samples=8)
        half = (seen.covered & (first > 0.02) & (first < 0.98)).reshape(-1).nonzero().reshape(-1)
        chosen = torch.zeros(seen.triangle.numel(), dtype=torch.bool)
        chosen[half[torch.linspace(0, len(half) - 1, min(study.penumbra_pixels, len(half))).long()]] = True
        chosen = chosen.reshape(seen.triangle.shape)
        few = replace(seen, triangle=torch.where(chosen, seen.triangle, -1))
        truth = traced_visibility(caster, light, few, samples=TRUE_SAMPLES)[chosen]
        pcss = options_for(light, scene, ShadowOptions(filter="pcss"))
        ways: dict[str, Callable[[], Tensor]] = {"pcss": partial(light_visibility, scene, light, seen, pcss)}
        for count in study.sample_counts:
            options = SoftShadowOptions(light_samples=count)
            ways[f"{count} x {count}"] = partial(_sampled, ready, light, seen, options, scene.bounds)
        errors = {way: 255.0 * (work()[chosen] - truth).abs() for way, work in ways.items()}
        times = take_turns(ways, runs=2, warm_up=0)
        facts = {"scene": name, "share": len(half) / seen.triangle.numel()}
        return [
            facts | {"way": way, "ms": times[way].least, "error": float(e.mean()), "p99": float(e.quantile(0.99))}
            for way, e in errors.items()
        ]


def _sampled(ready: Occluders, light: RectLight, seen: GBuffer, options: SoftShadowOptions, bounds: Tensor) -> Tensor:
    return soft_shadow(ready, light, seen, options, bounds=bounds).visibility[:, 0]
