"""How strong the lights of a room are: renderings of its proxy, fitted to the photo.

Source: specification 12, section 4: non-negative least squares of luminance, albedo of each part in turn.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.optimize import nnls
from torch import Tensor

from torchrender.numerics.color import luminance
from torchrender.photo.fog.picture import polygon_mask
from torchrender.photo.fog.room.emitters import Emitter

GREY = 0.6
ROUNDS = 3
USABLE = (0.02, 0.95)
"""Luminance of photo pixels that are neither noise nor cut off."""
LEAST_ALBEDO, LARGEST_ALBEDO = 0.05, 0.95


@dataclass(frozen=True, eq=False)
class LightFit:
    """Strengths of K sources, and albedo of the proxy's parts."""

    strength: Tensor  # (K,) of the sources in the order given
    albedo: Tensor  # (P,)
    error: float  # root mean square of luminance where it was fitted


def fit_lights(lit: Tensor, photo: Tensor, part: Tensor, parts: int) -> LightFit:
    """Strengths of sources whose irradiance at unit strength is known.

    Args:
        lit: (N,K) irradiance of each source at N places. photo: (N,3) what the photo shows there.
        part: (N,) int64 part of the proxy, -1 for none.
    """
    seen = luminance(photo)
    usable = (seen >= USABLE[0]) & (seen <= USABLE[1]) & (part >= 0)
    albedo = torch.full((parts,), GREY)
    count = lit.shape[1]
    if int(usable.sum()) < max(8, count) or not count:
        return LightFit(torch.zeros(count), albedo, 0.0)
    lit, seen, part = lit[usable].double(), seen[usable].double(), part[usable]
    strength = torch.zeros(count, dtype=torch.float64)
    for number in range(ROUNDS + 1):
        shown = lit * (albedo[part].double() / math.pi)[:, None]
        strength = torch.from_numpy(nnls(shown.numpy(), seen.numpy())[0])
        if number == ROUNDS:
            break
        made = (lit @ strength) / math.pi
        found = albedo.clone()
        for p in part.unique().tolist():
            rows = (part == p) & (made > 1e-4)
            if int(rows.sum()) >= 8:
                found[p] = float((seen[rows] / made[rows]).median())
        # Only light times albedo is seen: the mean albedo stays what it was.
        scale = GREY / float(found[part].mean())
        albedo = (found * scale).clamp(LEAST_ALBEDO, LARGEST_ALBEDO)
    error = float(((lit @ strength) * albedo[part].double() / math.pi - seen).square().mean().sqrt())
    return LightFit(strength.float(), albedo, error)


def light_color(emitters: Sequence[Emitter], photo: Tensor) -> Tensor:
    """(3,) chromaticity, of luminance 1, of the brightest tenth of the pixels of lights; white if none is in view."""
    h, w = photo.shape[:2]
    mask = torch.zeros(h, w, dtype=torch.bool)
    for emitter in emitters:
        mask |= polygon_mask(emitter.pixels, h, w)
    pixels = photo[mask]
    if not len(pixels):
        return torch.ones(3)
    bright = luminance(pixels)
    kept = pixels[bright >= torch.quantile(bright[:1_000_000], 0.9)]
    mean = kept.mean(dim=0)
    return mean / luminance(mean).clamp_min(1e-6) if float(mean.max()) > 0 else torch.ones(3)
