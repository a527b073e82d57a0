"""What the passes of shadows make: the share of each light that arrives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from torchrender.pipeline.buffer import Buffer

POINT_SHADOW: Buffer[dict[int, Tensor]] = Buffer("point_shadow", dict)
"""Visibility (B,H,W) in [0,1] of the lights without area, by their number in the scene."""

SOFT_SHADOW: Buffer[dict[int, Tensor]] = Buffer("soft_shadow", dict)
"""The same of the rectangular lights."""


def visibility_error(buffer: Buffer[dict[int, Tensor]]) -> Callable[[Mapping[str, Any], Mapping[str, Any]], float]:
    """Mean absolute error of the share of light that arrives, over pixels with a surface."""

    def error(found: Mapping[str, Any], reference: Mapping[str, Any]) -> float:
        covered, wanted = reference["gbuffer"].covered, reference[buffer.name]
        pairs = [(found[buffer.name][n], wanted[n]) for n in wanted]
        return float(torch.stack([(a - b).abs()[covered].mean() for a, b in pairs]).mean())

    return error
