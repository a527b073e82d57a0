"""Real spherical harmonics, and the light of an environment in them."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.scene.environment import Environment
from torchrender.scene.sky.irradiance import latlong_directions


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


def environment_bands(environment: Environment, rows: int) -> Tensor:
    """(9,3) float64 bands 0 to 2 of an environment's radiance, from a picture of ``rows`` by twice as many texels."""
    directions = latlong_directions(rows, 2 * rows)
    polar = (torch.arange(rows, dtype=torch.float64) + 0.5) * math.pi / rows
    weight = torch.sin(polar)[:, None] * (math.pi / rows) ** 2
    radiance = environment.lookup(directions).double()
    return torch.einsum("hwk,hwc,hw->kc", harmonics_2(directions.double()), radiance, weight.expand(rows, 2 * rows))
