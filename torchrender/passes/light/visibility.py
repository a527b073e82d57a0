"""What the passes of shadows make: the share of each light that arrives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.shadows.light_reach import shines
from torchrender.effects.shadows.small_lights import small_lights
from torchrender.passes.light.light_reach import LIGHT_REACH
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.scene.light import Light, RectLight

POINT_SHADOW: Buffer[dict[int, Tensor]] = Buffer("point_shadow", dict)
"""Visibility (B,H,W) in [0,1] of the lights without area, by their number in the scene."""

SOFT_SHADOW: Buffer[dict[int, Tensor]] = Buffer("soft_shadow", dict)
"""The same of the rectangular lights."""


def lights_in_view(frame: Frame, *, area: bool) -> dict[int, Light]:
    """The lights with or without an area that reach what is seen, by their number; all that shine where that is not
    known."""
    reach, lights = frame.get(LIGHT_REACH), frame.scene.lights
    known = [shines(light) for light in lights] if reach is None else reach.any.tolist()
    return {n: x for n, x in enumerate(lights) if known[n] and isinstance(x, RectLight) == area}


def lights_by_rays(frame: Frame) -> set[int]:
    """Numbers of the lights without area that reach so little of the picture that rays are asked, not maps."""
    reach = frame.get(LIGHT_REACH)
    if reach is None or frame.options.point_shadows != "maps" or frame.options.shadow.coverage != "view":
        return set()
    return small_lights(reach, lights_in_view(frame, area=False), frame.options.shadow)


def visibility_error(buffer: Buffer[dict[int, Tensor]]) -> Callable[[Mapping[str, Any], Mapping[str, Any]], float]:
    """Mean absolute error of the share of light that arrives, over pixels with a surface."""

    def error(found: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
        covered, wanted = reference["gbuffer"].covered, reference[buffer.name]
        pairs = [(found[buffer.name][n], wanted[n]) for n in wanted if n in found[buffer.name]]
        return float(torch.stack([(a - b).abs()[covered].mean() for a, b in pairs]).mean()) if pairs else 0.0

    return error
