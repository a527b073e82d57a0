"""The medium that a hazy photo was taken in, from the photo and its depth.

At every depth the photo's brightness is spread over a range that shrinks by ``exp(-kappa length)`` and moves towards
the airlight. Quantiles of all depths are fitted together: what differs from depth to depth in one of them, the things
that stand there, hardly differs so in all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.optimize import least_squares
from torch import Tensor

from torchrender.checks import check_range, check_tensor
from torchrender.errors import InputError
from torchrender.photo.fog.options import CONTRAST, FogMedium

QUANTILES = (0.005, 0.02, 0.05)
"""Of brightness at every depth: in the darkest that stands anywhere, things differ least from depth to depth."""
BINS = 48
FEWEST = 64
"""Pixels that a range of depths needs."""


@dataclass(frozen=True, eq=False)
class Haze:
    """A medium lit alike everywhere: ``photo = clear exp(-kappa length) + airlight (1 - exp(-kappa length))``."""

    extinction: float  # 1/m
    airlight: Tensor  # (3,) linear light
    error: float  # root mean square of the quantiles

    @property
    def visibility(self) -> float:
        """Metres."""
        return CONTRAST / self.extinction if self.extinction > 0 else float("inf")

    def medium(self, asymmetry: float = 0.0) -> FogMedium:
        """As a medium that only scatters."""
        return FogMedium.of(scattering=self.extinction, asymmetry=asymmetry)

    def moved(self, photo: Tensor, length: Tensor) -> Tensor:
        """(H,W,3) another photo (H,W,3) in this haze; ``length``: (H,W) metres to what it shows."""
        left = torch.exp(-self.extinction * length)[..., None]
        return photo * left + self.airlight * (1.0 - left)

    def lifted(self, photo: Tensor, length: Tensor, least: float = 0.05) -> Tensor:
        """(H,W,3) the photo (H,W,3) without this haze, as far as it can be told; ``least`` transmittance is assumed."""
        left = torch.exp(-self.extinction * length)[..., None].clamp_min(least)
        return ((photo - self.airlight * (1.0 - left)) / left).clamp_min(0.0)


def estimate_haze(photo: Tensor, length: Tensor, *, sky: Tensor | None = None, largest: float = 2.0) -> Haze:
    """Airlight and extinction of a photo (H,W,3), linear light, taken in haze or fog.

    Args:
        length: (H,W) metres from the eye to what is seen; +inf where unknown.
        sky: (H,W) bool pixels of the sky, which show the airlight itself once it is thick.
        largest: extinction beyond which none is sought, 1/m.

    Raises:
        InputError: shapes that differ, or depths that do not vary.
    """
    check_tensor("photo", photo, ("H", "W", 3))
    check_tensor("length", length, tuple(photo.shape[:2]))
    check_range("largest", largest, 1e-6, 1e3)
    known = torch.isfinite(length) & (length > 0)
    if sky is not None:
        check_tensor("sky", sky, tuple(photo.shape[:2]))
        known &= ~sky
    depth, pixels = length[known].double().numpy(), photo[known].double().numpy()
    if len(depth) < 4 * FEWEST or np.quantile(depth, 0.95) < 1.1 * np.quantile(depth, 0.05):
        raise InputError("depths must vary, and be known for some hundred pixels, for a medium to be told from them")
    # Narrow ranges, for light falls off within each; of equal ratio, for most pixels are near.
    edges = np.geomspace(np.quantile(depth, 0.002), np.quantile(depth, 0.998) * (1 + 1e-9), BINS + 1)
    inside = (depth >= edges[0]) & (depth <= edges[-1])
    depth, pixels = depth[inside], pixels[inside]
    number = np.clip(np.searchsorted(edges, depth, side="right") - 1, 0, len(edges) - 2)
    at, curves = [], []
    for k in range(len(edges) - 1):
        rows = number == k
        if rows.sum() >= FEWEST:
            at.append(depth[rows].mean())
            curves.append(np.quantile(pixels[rows], QUANTILES, axis=0))
    if len(at) < 4:
        raise InputError("depths must vary: less than four ranges of them hold enough pixels")
    where, shown = np.array(at), np.stack(curves)  # (N,), (N,Q,3)
    top = None if sky is None or not bool(sky.any()) else photo[sky].double().median(dim=0).values.numpy()
    best = None
    for kappa in np.geomspace(0.05 / where.max(), min(largest, 4.0 / where.min()), 6):
        start = np.concatenate([[np.log(kappa)], shown[-1].mean(axis=0), shown[0].reshape(-1)])
        fit = least_squares(
            _misses, start, args=(where, shown, top), loss="soft_l1", f_scale=0.02, x_scale="jac", max_nfev=200
        )
        if best is None or fit.cost < best.cost:
            best = fit
    assert best is not None
    kappa = float(np.clip(np.exp(best.x[0]), 0.0, largest))
    airlight = torch.from_numpy(np.maximum(best.x[1:4], 0.0)).float()
    misses = _misses(best.x, where, shown, None)
    return Haze(kappa, airlight, float(np.sqrt((misses**2).mean())))


def _misses(x: np.ndarray, where: np.ndarray, shown: np.ndarray, sky: np.ndarray | None) -> np.ndarray:
    kappa, airlight, clear = np.exp(min(x[0], 5.0)), x[1:4], x[4:].reshape(shown.shape[1:])
    left = np.exp(-kappa * where)[:, None, None]
    out = (clear * left + airlight * (1.0 - left) - shown).reshape(-1)
    extra = [3.0 * np.minimum(airlight, 0.0), 3.0 * np.minimum(clear.reshape(-1), 0.0)]
    if sky is not None:
        # The sky is the airlight where the fog is thick; in thin haze it is its own.
        extra.append((1.0 - np.exp(-kappa * 1000.0)) * 3.0 * (airlight - sky))
    return np.concatenate([out, *extra])
