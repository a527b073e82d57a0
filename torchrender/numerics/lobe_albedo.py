"""How much light a rough surface mirrors in all: the two terms of the split sum, computed once.

The mirrored share under light from everywhere is ``f0 a + f90 b`` with ``a`` and ``b`` functions of the cosine to the
eye and of the roughness (Karis, *Real shading in Unreal Engine 4*, 2013), for the GGX lobe with Smith's
height-correlated term and Schlick's Fresnel term. Computed by importance sampling of the visible normals (Heitz 2018).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import torch
from torch import Tensor

from torchrender.numerics.ggx import SMOOTHEST, fifth_power, sheen_lobe

SIZE = 32
"""Cosines and roughnesses in the table; the cosines stand closer towards grazing angles."""
SAMPLES = 32
"""Per side of the square that directions are drawn from."""


@dataclass(frozen=True, eq=False)
class AlbedoTable:
    """Values at ``cosine = (column / (S-1))^2`` and ``roughness = row / (S-1)``."""

    split: Tensor  # (S,S,4): a, b, and their sheen counterpart (share of white sheen that is sent back); 0
    mean: Tensor  # (S,2): the means of a and b over the hemisphere, weighted by the cosine


def directional_albedo(cosine: Tensor, roughness: Tensor) -> tuple[Tensor, Tensor]:
    """The terms ``a`` and ``b`` (...) of the mirrored share ``f0 a + f90 b``.

    Args:
        cosine: (...) between eye and normal, in [0,1].
        roughness: (...) in [0,1].
    """
    a, b, _, _ = look_up(albedo_table().split, cosine, roughness).unbind(-1)
    return a, b


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
        split = torch.stack([_row(float(r), steps.square().clamp_min(1e-5)) for r in steps])
        # Weighted means by trapezia over the cosine, of the piecewise linear table.
        cosine = steps.square()
        weight = torch.zeros(SIZE, dtype=torch.float64)
        weight[:-1] += cosine.diff() / 2
        weight[1:] += cosine.diff() / 2
        mean = (split[..., :2] * (2.0 * cosine * weight)[None, :, None]).sum(1) / (2.0 * cosine * weight).sum()
        return AlbedoTable(split.float().contiguous(), mean.float().contiguous())


def _row(roughness: float, cosine: Tensor) -> Tensor:
    """Values (S,4) of one roughness."""
    alpha = max(roughness, SMOOTHEST) ** 2
    t = (torch.arange(SAMPLES, dtype=torch.float64) + 0.5) / SAMPLES
    # Close towards one, where few normals send much of the light astray: the long tail of the distribution.
    first, second = (v.reshape(1, -1) for v in torch.meshgrid(1.0 - (1.0 - t) ** 4, t, indexing="ij"))
    weight = (4.0 * (1.0 - t) ** 3 / SAMPLES**2).repeat_interleave(SAMPLES)[None]
    weight = weight / weight.sum()
    c = cosine[:, None]
    half = _visible_normal(c, alpha, first, second)
    eye_half = (half[0] * (1.0 - c * c).sqrt() + half[2] * c).clamp(0.0, 1.0)
    light = 2.0 * eye_half * half[2] - c
    above = light > 0
    share = torch.where(above, _masked(light.clamp_min(1e-9), c, alpha), 0.0)
    grazing = fifth_power(eye_half)
    a, b = (share * (1.0 - grazing) * weight).sum(1), (share * grazing * weight).sum(1)
    return torch.stack([a, b, _sheen(cosine, roughness), torch.zeros_like(a)], dim=-1)


def _visible_normal(c: Tensor, alpha: float, first: Tensor, second: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Normals of microfacets as the eye at cosine ``c`` sees them, for uniform numbers (Heitz 2018)."""
    x, z = alpha * (1.0 - c * c).sqrt(), c
    length = (x * x + z * z).sqrt()
    x, z = x / length, z / length
    radius, turn = first.sqrt(), 2.0 * math.pi * second
    p, q = radius * torch.cos(turn), radius * torch.sin(turn)
    s = 0.5 * (1.0 + z)
    q = (1.0 - s) * (1.0 - p * p).clamp_min(0.0).sqrt() + s * q
    r = (1.0 - p * p - q * q).clamp_min(0.0).sqrt()
    # The frame about (x, 0, z): first axis (0, 1, 0), second its cross product.
    nx, ny, nz = -z * q + x * r, p.expand_as(q), x * q + z * r
    nx, ny, nz = alpha * nx, alpha * ny, nz.clamp_min(1e-9)
    length = (nx * nx + ny * ny + nz * nz).sqrt()
    return nx / length, ny / length, nz / length


def _masked(light: Tensor, eye: Tensor, alpha: float) -> Tensor:
    """``G2 / G1`` of the height-correlated Smith term: what is left of the light after importance sampling."""
    square = alpha * alpha
    root_eye = (eye * eye * (1.0 - square) + square).sqrt()
    root_light = (light * light * (1.0 - square) + square).sqrt()
    return light * (eye + root_eye) / (light * root_eye + eye * root_light)


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
