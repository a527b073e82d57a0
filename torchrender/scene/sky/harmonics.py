"""Real spherical harmonics."""

from __future__ import annotations

import torch
from torch import Tensor


def harmonics_2(d: Tensor) -> Tensor:
    """The nine real spherical harmonics up to band 2 (...,9) of unit directions (...,3)."""
    x, y, z = d.unbind(-1)
    one = torch.ones_like(x)
    return torch.stack(
        [
            0.282095 * one,
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3 * z * z - 1),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ],
        dim=-1,
    )
