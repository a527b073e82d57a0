"""Fit the table of linearly transformed cosines: ``python -m torchrender.tuning.linear_cosines [-o FILE]``.

Each entry is the linear transformation of a clamped cosine that comes closest to the GGX lobe of one roughness seen at
one angle (Heitz, Dupuy, Hill and Neubelt, *Real-time polygonal-light shading with linearly transformed cosines*, 2016):
Levenberg and Marquardt's steps on four numbers, from rough to smooth, each roughness from the last. What is made
smallest is the integral of ``(p - q)^2 / (p + q)``, which minds the tails of a lobe as well as its peak.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torchrender.shading.linear_cosines import SHIPPED, SIZE, SMOOTHEST_ROW
from torchrender.tuning.fitted import write_fitted

Array = np.ndarray
FACETS, OPEN = 1200, 600
"""Directions that facets mirror, and directions spread by their cosine, at which a lobe is compared."""
STEPS = 40
LEAST_COSINE, LARGEST_COSINE = 1e-3, 1.0 - 1e-6
_GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
_FLOOR = 1e-3
"""Density below which a difference counts less."""


class Lobe(NamedTuple):
    """Lobes of K angles to the eye at Q directions on one side of the plane of the eye and the normal."""

    cosine: Array  # (K,) to the eye
    direction: Array  # (K,Q,3) the eye is in the plane of x and z, the normal is z
    value: Array  # (K,Q) density per steradian, 1 in all; 0 below the surface
    weight: Array  # (K,Q) one over the density of directions: the mean of value times weight is 1


class Transform(NamedTuple):
    """Transformations of K cosines, in the frame of the mirrored direction; s is the sine to the eye.

    ``[[a, 0, s sin], [0, c, 0], [s d, 0, cos]]`` with the sine and cosine of ``s tilt``.
    """

    a: Array
    tilt: Array
    c: Array
    d: Array


def lobe_of(cosine: Array, roughness: float) -> Lobe:
    """The lobe of GGX with Smith's height-correlated masking and no Fresnel term, times the cosine."""
    alpha, sine = max(roughness, SMOOTHEST_ROW) ** 2, np.sqrt(1.0 - cosine * cosine)
    eye = np.stack([sine, 0 * sine, cosine], -1)[:, None]
    across, turn = _spiral(FACETS)
    length = np.sqrt(alpha * alpha * sine * sine + cosine * cosine)
    x, z = (alpha * sine / length)[:, None], (cosine / length)[:, None]
    height = (1.0 - across) * (1.0 + z) - z  # visible facets, of a surface of roughness one
    wide = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    half = np.stack([alpha * (wide * np.cos(turn) + x), alpha * wide * np.sin(turn), np.maximum(height + z, 1e-9)], -1)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    mirrored = 2.0 * (eye * half).sum(-1, keepdims=True) * half - eye
    across, turn = _spiral(OPEN)
    radius = np.sqrt(across)
    free = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.sqrt(1.0 - across)], -1)
    direction = np.concatenate([mirrored, np.broadcast_to(free, (len(cosine), OPEN, 3))], 1)
    up = np.maximum(direction[..., 2], 1e-5)
    half = direction + eye
    half /= np.maximum(np.linalg.norm(half, axis=-1, keepdims=True), 1e-12)
    flat = (half[..., :2] ** 2).sum(-1)
    facets = alpha * alpha / (math.pi * (flat + alpha * alpha * (1.0 - flat)) ** 2) / (4.0 * cosine[:, None])
    hidden, masked = smith_lambda(cosine, alpha)[:, None], smith_lambda(up, alpha)
    density = (FACETS * facets / (1.0 + hidden) + OPEN * up / math.pi) / (FACETS + OPEN)
    value = np.where(direction[..., 2] > 1e-5, facets / (1.0 + hidden + masked), 0.0)
    return Lobe(cosine, direction, value / (value / density).mean(1, keepdims=True), 1.0 / density)


def density(one: Transform, lobe: Lobe) -> Array:
    """Densities (K,Q) of transformed cosines at the directions of the lobes."""
    c = lobe.cosine[:, None]
    s = np.sqrt(1.0 - c * c)
    a, tilt, across, d = (v[:, None] for v in one)
    b, e, d = np.sin(s * tilt), np.cos(s * tilt), s * d
    x = lobe.direction[..., 0] * c + lobe.direction[..., 2] * s
    z = -lobe.direction[..., 0] * s + lobe.direction[..., 2] * c
    size = a * e - b * d
    u, v, w = (e * x - b * z) / size, lobe.direction[..., 1] / across, (a * z - d * x) / size
    square = u * u + v * v + w * w
    return np.maximum(w, 0.0) / (math.pi * square * square) / np.abs(size * across)


def fit(lobe: Lobe, start: Transform, steps: int = STEPS) -> Transform:
    """The transformations that come closest, from a start; all K at once."""
    found = np.stack(start, -1)
    damping = np.full(len(found), 1e-2)
    rest = _rest(found, lobe)
    cost = (rest * rest).sum(1)
    for _ in range(steps):
        slopes = []
        for k in range(4):
            h = 1e-4 * np.maximum(np.abs(found[:, k]), 1e-2 if k in (1, 3) else 1e-4)
            moved = found.copy()
            moved[:, k] += h
            slopes.append((_rest(moved, lobe) - rest) / h[:, None])
        slope = np.stack(slopes, -1)
        square = slope.transpose(0, 2, 1) @ slope
        own = np.einsum("kii->ki", square)
        square = square + (damping[:, None] * own + 1e-9 * own.max(1, keepdims=True) + 1e-12)[..., None] * np.eye(4)
        step = np.linalg.solve(square, -(slope * rest[..., None]).sum(1)[..., None])[..., 0]
        step = np.clip(step, -0.5 * np.abs(found) - 0.1, 0.5 * np.abs(found) + 0.1)
        tried = found + step
        for k in (0, 2):
            tried[:, k] = np.maximum(tried[:, k], 0.5 * found[:, k])
        after = _rest(tried, lobe)
        now = (after * after).sum(1)
        better = now < cost
        found, rest = np.where(better[:, None], tried, found), np.where(better[:, None], after, rest)
        cost, damping = np.where(better, now, cost), np.clip(np.where(better, 0.4, 4.0) * damping, 1e-6, 1e6)
    return Transform(*found.T)


def first_of(lobe: Lobe) -> Transform:
    """A round cosine about the mean direction of each lobe."""
    mean = (lobe.direction * (lobe.value * lobe.weight)[..., None]).mean(1)
    c = lobe.cosine
    s = np.sqrt(1.0 - c * c)
    tilt = np.arctan2(mean[:, 0] * c + mean[:, 2] * s, -mean[:, 0] * s + mean[:, 2] * c) / s
    return Transform(np.cos(s * tilt), tilt, np.ones_like(c), -np.sin(s * tilt) / s)


def entries(one: Transform, cosine: Array) -> Array:
    """(K,5) numbers of the table: a, b / s, c, d / s, e."""
    s = np.sqrt(1.0 - cosine * cosine)
    return np.stack([one.a, np.sin(s * one.tilt) / s, one.c, one.d, np.cos(s * one.tilt)], -1).astype(np.float32)


def transform_of(kept: Array, cosine: Array) -> Transform:
    """The way back from :func:`entries`."""
    s = np.sqrt(1.0 - cosine * cosine)
    a, b, c, d, e = kept.astype(np.float64).T
    return Transform(a, np.arctan2(s * b, e) / s, c, d)


def smoother(one: Transform, before: float, after: float) -> Transform:
    """A start at another roughness."""
    ratio = (max(after, SMOOTHEST_ROW) / max(before, SMOOTHEST_ROW)) ** 2
    return Transform(one.a * ratio, one.tilt, one.c * ratio, one.d * ratio)


def cosines(size: int = SIZE) -> Array:
    """Cosines to the eye of the columns of a table."""
    return np.clip((np.arange(size) / (size - 1)) ** 2, LEAST_COSINE, LARGEST_COSINE)


def fit_table(size: int = SIZE) -> Array:
    """(S,S,5) float32: row = roughness times S - 1, column = root of the cosine times S - 1."""
    cosine, last = cosines(size), size - 1
    lobe = lobe_of(cosine, 1.0)
    found = fit(lobe, first_of(lobe))
    rows = [entries(found, cosine)]
    for row in range(last - 1, -1, -1):
        found = fit(lobe_of(cosine, row / last), smoother(found, (row + 1) / last, row / last))
        rows.append(entries(found, cosine))
    return np.stack(rows[::-1])


def _spiral(count: int) -> tuple[Array, Array]:
    """Shares of a disc's area (1,count) and turns (1,count) over half of it, spread evenly."""
    step = np.arange(count) + 0.5
    return (step / count)[None], (step * _GOLDEN % 1.0 * math.pi)[None]


def smith_lambda(cosine: Array, alpha: float) -> Array:
    """Smith's Lambda of GGX."""
    return 0.5 * (np.sqrt(1.0 + alpha * alpha * np.maximum(1.0 / (cosine * cosine) - 1.0, 0.0)) - 1.0)


def _rest(found: Array, lobe: Lobe) -> Array:
    """What the squares are summed of."""
    q = density(Transform(*found.T), lobe)
    above = lobe.direction[..., 2] > 1e-5
    return np.where(above, (lobe.value - q) * np.sqrt(lobe.weight / (lobe.value + q + _FLOOR)), 0.0)


def main() -> None:
    """The command."""
    write_fitted(__doc__, SHIPPED, fit_table)


if __name__ == "__main__":
    main()
