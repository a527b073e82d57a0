"""How much light lobes send back in all: GGX by the split sum, its mean over all directions, and sheen."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from torchrender.numerics.ggx import sheen_lobe
from torchrender.numerics.split_sum import TABLE_SIZE, split_sum_table

SIZE = TABLE_SIZE


@dataclass(frozen=True, eq=False)
class AlbedoTable:
    """Values at ``cosine = (column / (S-1))^2`` and ``roughness = row / (S-1)``."""

    split: Tensor  # (S,S,4): the factors of :func:`torchrender.numerics.split_sum.directional_albedo`
    mean: Tensor  # (S,4): their means over the hemisphere, weighted by the cosine
    sheen: Tensor  # (S,S,1): share of light from everywhere that white sheen sends back


def sheen_albedo(cosine: Tensor, roughness: Tensor) -> Tensor:
    """Share (...) of light from everywhere that white sheen sends back."""
    return look_up(albedo_table().sheen, cosine, roughness)[..., 0]


def mean_albedo(roughness: Tensor) -> Tensor:
    """Cosine-weighted means (4,...) of the factors over all directions of the eye."""
    table = albedo_table().mean
    place = roughness.clamp(0.0, 1.0) * (SIZE - 1)
    low = place.detach().floor().clamp_max(SIZE - 2).long()
    return torch.lerp(table[low], table[low + 1], (place - low)[..., None]).movedim(-1, 0)


def look_up(table: Tensor, cosine: Tensor, roughness: Tensor) -> Tensor:
    """Bilinear values (...,C) of a table (S,S,C)."""
    x = cosine.clamp(0.0, 1.0).sqrt() * (SIZE - 1)
    y = roughness.clamp(0.0, 1.0) * (SIZE - 1)
    i, j = x.detach().floor().clamp_max(SIZE - 2).long(), y.detach().floor().clamp_max(SIZE - 2).long()
    u, v = (x - i)[..., None], (y - j)[..., None]
    flat = table.reshape(SIZE * SIZE, -1)
    first = j * SIZE + i
    corners = (flat[first], flat[first + 1], flat[first + SIZE], flat[first + SIZE + 1])
    return torch.lerp(torch.lerp(corners[0], corners[1], u), torch.lerp(corners[2], corners[3], u), v)


@cache
def albedo_table() -> AlbedoTable:
    """The table, computed when it is first asked for."""
    with torch.inference_mode(False), torch.no_grad():
        steps = torch.arange(SIZE, dtype=torch.float64) / (SIZE - 1)
        sheen = _sheen(steps.square().clamp_min(1e-5), steps)
        split = split_sum_table().transpose(0, 1).double()
        # Weighted means by trapezia over the cosine, of the piecewise linear table.
        cosine = steps.square()
        weight = torch.zeros(SIZE, dtype=torch.float64)
        weight[:-1] += cosine.diff() / 2
        weight[1:] += cosine.diff() / 2
        mean = (split * (2.0 * cosine * weight)[None, :, None]).sum(1) / (2.0 * cosine * weight).sum()
        return AlbedoTable(split.float().contiguous(), mean.float().contiguous(), sheen[..., None].float().contiguous())


def _sheen(cosine: Tensor, roughness: Tensor) -> Tensor:
    """Share of uniform light (R,S) that white sheen of roughness (R,) sends to an eye at cosine (S,), at most 1."""
    steps = 24
    mu = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    turn = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps * math.pi
    light, angle = torch.meshgrid(mu, turn, indexing="ij")
    c = cosine[:, None, None]
    sine = (1.0 - c * c).clamp_min(0.0).sqrt()
    other = (1.0 - light * light).sqrt()
    x, y, z = sine + other * torch.cos(angle), other * torch.sin(angle), c + light
    flat = (x * x + y * y) / (x * x + y * y + z * z).clamp_min(1e-30)
    rows = [(sheen_lobe(flat, light, c, rough) * light).mean(dim=(-1, -2)) for rough in roughness]
    return (torch.stack(rows) * 2.0 * math.pi).clamp_max(1.0)
