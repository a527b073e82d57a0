"""Fit where glossy surfaces look up prefiltered maps of the sky: ``python -m torchrender.tuning.sky_lobes [-o FILE]``.

Prefiltered maps hold round lobes, those of surfaces seen along their normal. Seen aslant, a lobe of GGX facets leans
towards the normal, is narrower across and cut by the horizon. Each entry is the direction and the roughness of the
round lobe that comes closest: the squared difference of their spherical harmonics up to degree :data:`DEGREE`, weighed
as light is spread over them in surroundings (less by higher degrees), over all directions and widths of a grid.
"""

from __future__ import annotations

import math

import numpy as np

from torchrender.shading.sky import SKY_LOBES
from torchrender.tuning.fitted import write_fitted
from torchrender.tuning.linear_cosines import smith_lambda

Array = np.ndarray
SIZE, DEGREE = 32, 48
ANGLES, HEIGHTS = 32, 40
ROUGHEST, LEANS = np.linspace(0.02, 1.0, 99), np.radians(np.arange(-90.0, 91.0))
"""Grid of round lobes: roughness, and angle to the normal, towards the mirrored direction."""
SMOOTH = 0.2
"""Roughness below which lobes are too narrow for the harmonics: they scale."""
MOST = 1.3, 1.5
"""Largest numbers of the table: of what is mirrored at grazing facets alone there is next to nothing face on."""


def harmonics(cosine: Array, azimuth: Array) -> tuple[Array, Array]:
    """Real orthonormal harmonics (N,K) that are even in azimuth, and their degrees (K,)."""
    sine = np.sqrt(np.maximum(1.0 - cosine * cosine, 0.0))
    values, degrees, top = [], [], np.full(len(cosine), math.sqrt(0.25 / math.pi))
    for m in range(DEGREE + 1):
        if m > 0:
            top = top * sine * math.sqrt((2 * m + 1) / (2 * m))
        turn = np.cos(m * azimuth) * (math.sqrt(2.0) if m else 1.0)
        before, now = np.zeros_like(top), top
        for degree in range(m, DEGREE + 1):
            values.append(now * turn)
            degrees.append(degree)
            k = degree + 1
            up = math.sqrt((4.0 * k * k - 1.0) / (k * k - m * m))
            back = math.sqrt(max((degree * degree - m * m) / (4.0 * degree * degree - 1.0), 0.0))
            before, now = now, up * (cosine * now - back * before)
    return np.stack(values, 1), np.array(degrees)


def facets(cosine: float, roughness: float) -> tuple[Array, Array, Array]:
    """Directions (Q,3) that facets mirror the eye to, weights (Q,) of light from there if all mirror all, and Schlick's
    weight (Q,) of their angles. The normal is z, the eye towards x.
    """
    alpha, sine = roughness**2, math.sqrt(max(1.0 - cosine * cosine, 0.0))
    turn = (np.arange(ANGLES)[:, None] + 0.5) * math.pi / ANGLES
    points, weights = np.polynomial.legendre.leggauss(HEIGHTS)
    free = (1.0 - points) / 2.0
    weight = np.broadcast_to(weights * free / ANGLES, (ANGLES, HEIGHTS))
    length = math.sqrt(alpha * alpha * sine * sine + cosine * cosine)
    x, z = alpha * sine / length, cosine / length
    height = (free * free)[None] * (1.0 + z) - z
    wide = np.sqrt(np.maximum(1.0 - height * height, 0.0))
    half = np.stack([alpha * (wide * np.cos(turn) + x), alpha * wide * np.sin(turn), height + z + 0.0 * turn], -1)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    facing = np.clip(sine * half[..., 0] + cosine * half[..., 2], 0.0, 1.0)
    out = 2.0 * facing[..., None] * half - np.array([sine, 0.0, cosine])
    hidden, masked = smith_lambda(np.array(cosine), alpha), smith_lambda(np.maximum(out[..., 2], 1e-6), alpha)
    share = np.where(out[..., 2] > 0.0, (1.0 + hidden) / (1.0 + hidden + masked) * weight, 0.0)
    return out.reshape(-1, 3), share.reshape(-1), ((1.0 - facing) ** 5).reshape(-1)


def round_lobes(steps: int = 4000) -> Array:
    """(R,DEGREE+1) zonal coefficients of the lobes of the prefiltered maps, of each roughness of the grid."""
    place = (np.arange(steps) + 0.5) / steps
    angle = place**2 * math.pi / 2.0
    cosine = np.cos(angle)
    solid = cosine * np.sin(angle) * place
    legendre = [np.ones(steps), cosine]
    for k in range(2, DEGREE + 1):
        legendre.append(((2 * k - 1) * cosine * legendre[-1] - (k - 1) * legendre[-2]) / k)
    alpha = ROUGHEST[:, None] ** 2
    value = (alpha / (0.5 - 0.5 * cosine + (0.5 + 0.5 * cosine) * alpha * alpha)) ** 2 * solid
    return (value / value.sum(1, keepdims=True)) @ np.stack(legendre, 1)


class Fit:
    """The search over the grid."""

    def __init__(self) -> None:
        degree = np.arange(DEGREE + 1)
        self.spread = np.where(degree > 0, 1.0 / (degree + 1.0), 0.0)
        self.round = round_lobes()
        self.own = (self.round**2 * self.spread) @ ((2 * degree + 1) / (4.0 * math.pi))
        self.at, self.degrees = harmonics(np.cos(LEANS), np.where(LEANS >= 0.0, math.pi, 0.0))

    def nearest(self, toward: Array, weight: Array) -> tuple[float, float]:
        """Angle to the normal and roughness of the round lobe next to that of directions (Q,3) and weights (Q,)."""
        values, _ = harmonics(np.clip(toward[:, 2], -1.0, 1.0), np.arctan2(toward[:, 1], toward[:, 0]))
        lobe = (weight / weight.sum()) @ values
        both = np.zeros((DEGREE + 1, len(LEANS)))
        np.add.at(both, self.degrees, (lobe * self.at).T)
        cost = self.own[:, None] - 2.0 * (self.round * self.spread) @ both
        i, j = (int(k) for k in np.unravel_index(cost.argmin(), cost.shape))
        return (
            float(LEANS[j]) + _bottom(cost[i], j) * float(LEANS[1] - LEANS[0]),
            float(ROUGHEST[i]) + _bottom(cost[:, j], i) * float(ROUGHEST[1] - ROUGHEST[0]),
        )


def _bottom(cost: Array, k: int) -> float:
    """Place, from the least of a row of numbers, of the bottom of the parabola through it and its neighbours."""
    if not 0 < k < len(cost) - 1:
        return 0.0
    before, least, after = cost[k - 1 : k + 2]
    return float(np.clip(0.5 * (before - after) / max(before - 2.0 * least + after, 1e-30), -0.5, 0.5))


def entry(fit: Fit, cosine: float, roughness: float) -> list[float]:
    """See :func:`torchrender.shading.sky.sky_lobe`: for facets that mirror all, and for those of Schlick's weight."""
    used = max(roughness, SMOOTH)
    toward, share, grazing = facets(cosine, used)
    mirror, found = math.acos(cosine), []
    for weight in (share, share * grazing):
        lean, width = fit.nearest(toward, weight)
        part = math.sin(lean) / max(math.sin(mirror - lean) + math.sin(lean), 1e-6)
        part = 1.0 - (1.0 - min(max(part, 0.0), MOST[0])) * min(roughness / SMOOTH, 1.0) ** 2
        found += [part, min(width / used, MOST[1])]
    return found


def fit_table(size: int = SIZE) -> Array:
    """(S,S,4) float32: row = roughness times S - 1, column = root of the cosine times S - 1."""
    fit, last = Fit(), size - 1
    cosines = np.clip((np.arange(size) / last) ** 2, 0.01, 0.995)
    return np.array([[entry(fit, c, row / last) for c in cosines] for row in range(size)], np.float32)


def main() -> None:
    """The command."""
    write_fitted(__doc__, SKY_LOBES, fit_table)


if __name__ == "__main__":
    main()
