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

    split: Tensor  # (S,S,4): a, b, and their sheen counterpart (share of white sheen that is sent back); 0
    mean: Tensor  # (S,2): the means of a and b over the hemisphere, weighted by the cosine


def sheen_albedo(cosine: Tensor, roughness: Tensor) -> Tensor:
    """Share (...) of light from everywhere that white sheen sends back."""
    return look_up(albedo_table().split, cosine, roughness)[..., 2]


def mean_albedo(roughness: Tensor) -> tuple[Tensor, Tensor]:
    """Cosine-weighted means (...) of ``a`` and ``b`` over all directions of the eye."""
    table = albedo_table().mean
    place = roughness.clamp(0.0, 1.0) * (SIZE - 1)
    low = place.detach().floor().clamp_max(SIZE - 2).long()
    a, b = torch.lerp(table[low], table[low + 1], (place - low)[..., None]).unbind(-1)
    return a, b


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
        sheen = torch.stack([_sheen(steps.square().clamp_min(1e-5), float(r)) for r in steps])
        terms = split_sum_table().transpose(0, 1).double()
        split = torch.cat([terms, sheen[..., None], torch.zeros(SIZE, SIZE, 1)], dim=-1)
        # Weighted means by trapezia over the cosine, of the piecewise linear table.
        cosine = steps.square()
        weight = torch.zeros(SIZE, dtype=torch.float64)
        weight[:-1] += cosine.diff() / 2
        weight[1:] += cosine.diff() / 2
        mean = (split[..., :2] * (2.0 * cosine * weight)[None, :, None]).sum(1) / (2.0 * cosine * weight).sum()
        return AlbedoTable(split.float().contiguous(), mean.float().contiguous())


def _sheen(cosine: Tensor, roughness: float) -> Tensor:
    """Share of uniform light (S,) that white sheen sends back, at most 1."""
    steps = 24
    mu = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps
    turn = (torch.arange(steps, dtype=torch.float64) + 0.5) / steps * math.pi
    light, angle = torch.meshgrid(mu, turn, indexing="ij")
    found = []
    for c in cosine.tolist():
        sine = math.sqrt(max(1.0 - c * c, 0.0))
        other = (1.0 - light * light).sqrt()
        x, y, z = sine + other * torch.cos(angle), other * torch.sin(angle), c + light
        flat = (x * x + y * y) / (x * x + y * y + z * z).clamp_min(1e-30)
        lobe = sheen_lobe(flat, light, torch.full_like(light, c), torch.full_like(light, roughness))
        found.append((lobe * light).mean() * 2.0 * math.pi)
    return torch.stack(found).clamp_max(1.0)
