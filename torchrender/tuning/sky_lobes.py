"""Fit where glossy surfaces look up prefiltered maps of the sky: ``python -m torchrender.tuning.sky_lobes [-o FILE]``.

Prefiltered maps hold round lobes, those of surfaces seen along their normal. Seen aslant, a lobe of GGX facets leans
towards the normal, is longer in the plane of the eye than across and cut by the horizon. Each entry is the pair of
round lobes in that plane whose sum comes closest: the squared difference of their spherical harmonics up to degree
:data:`DEGREE`, weighed as light is spread over them in surroundings (less by higher degrees). One lobe after the other
is the best on a grid of all directions and widths for the one before, until nothing gets better; neighbours in the
table begin with each other's pair, so that what lies between them is blended of like with like.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from torchrender.numerics.ggx import dielectric_fresnel
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
MOST = 1.5
"""Largest part and width of the table."""
BEYOND = 1.25, math.radians(2.0)
"""How far lobes may lie from the normal: times the mirrored direction, and angle."""
LEAST_SHARE = 0.05
DIELECTRIC, LEAST_ADDED = 1.5, 1e-3
"""Index of refraction of what the second pair is fitted to; the least that Fresnel's term adds to what it mirrors."""
STEP = 4
"""Places of the grid by which lobes may differ from their neighbours' in the table."""
WORTH = 0.85
"""Share of the cost from which on a pair is taken that is not like the neighbours'."""
ROUNDS = 12

Lobe = tuple[int, int]
"""Place in the grid: roughness, angle."""


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
    alpha = ROUGHEST[:, None] ** 2
    value = (alpha / (0.5 - 0.5 * cosine + (0.5 + 0.5 * cosine) * alpha * alpha)) ** 2 * solid
    return (value / value.sum(1, keepdims=True)) @ legendre(cosine).T


class Pair(NamedTuple):
    """Two lobes, the one farther from the normal first; their cost, and the share of the first."""

    cost: float
    first: Lobe
    second: Lobe
    share: float


class Fit:
    """The search over the grid."""

    def __init__(self) -> None:
        degree = np.arange(DEGREE + 1)
        self.spread = np.where(degree > 0, 1.0 / (degree + 1.0), 0.0)
        self.round = round_lobes()
        self.at, self.degrees = harmonics(np.cos(LEANS), np.where(LEANS >= 0.0, math.pi, 0.0))
        self.of_degree = (self.degrees == degree[:, None]).astype(float)
        power = self.spread * (2 * degree + 1) / (4.0 * math.pi)
        self.own = ((self.round**2) @ power)[:, None]
        self.weighed = self.round * power
        self.legendre = legendre(np.cos(LEANS - LEANS[0]))

    def common(self, values: Array, weight: Array) -> Array:
        """Inner products (R,L) of the lobes of the grid with that of harmonics (Q,K) of directions and weights (Q,)."""
        lobe = (weight / weight.sum()) @ values
        return np.asarray((self.round * self.spread) @ (self.of_degree @ (lobe[:, None] * self.at.T)))

    def costs(self, common: Array, lobe: Lobe) -> tuple[Array, Array]:
        """Cost of each lobe of the grid together with a given one, but for a constant, and the best share of that."""
        i, j = lobe
        both = (self.round * self.weighed[i]) @ self.legendre[:, np.abs(np.arange(len(LEANS)) - j)]
        mine, own = float(self.own[i, 0]), float(common[i, j])
        best = (own - common + self.own - both) / np.maximum(mine + self.own - 2.0 * both, 1e-12)
        share = np.clip(best, LEAST_SHARE, 1.0 - LEAST_SHARE)
        rest = 1.0 - share
        cost = share**2 * mine + rest**2 * self.own + 2.0 * share * (rest * both - own) - 2.0 * rest * common
        return cost, share

    def pair(self, common: Array, allowed: Array, begin: tuple[Lobe, Lobe] | None = None) -> Pair:
        """The pair found from the best single lobe on, or near where to ``begin``."""
        single = np.where(allowed, self.own - 2.0 * common, np.inf)
        one, last = (_least(single), None) if begin is None else begin
        found: Pair | None = None
        for _ in range(ROUNDS):
            cost, share = self.costs(common, one)
            near = allowed if last is None or begin is None else allowed & _near(last)
            two = _least(np.where(near, cost, np.inf)) if near.any() else one
            if found is not None and cost[two] >= found.cost - 1e-9:
                break
            found = Pair(float(cost[two]), one, two, float(share[two]))
            one, last = two, one
        assert found is not None
        if found.first[1] >= found.second[1]:
            return found
        return Pair(found.cost, found.second, found.first, 1.0 - found.share)


def legendre(cosine: Array) -> Array:
    """(DEGREE+1,N) Legendre polynomials."""
    values = [np.ones_like(cosine), cosine]
    for k in range(2, DEGREE + 1):
        values.append(((2 * k - 1) * cosine * values[-1] - (k - 1) * values[-2]) / k)
    return np.stack(values)


def _least(cost: Array) -> Lobe:
    i, j = np.unravel_index(int(cost.argmin()), cost.shape)
    return int(i), int(j)


def _near(lobe: Lobe) -> Array:
    rows, columns = np.ogrid[: len(ROUGHEST), : len(LEANS)]
    return np.asarray((np.abs(rows - lobe[0]) <= STEP) & (np.abs(columns - lobe[1]) <= STEP))


def mirrored_shares(cosine: float, roughness: float) -> tuple[Array, Array, Array]:
    """Directions (Q,3) of :func:`facets`, and weights (Q,) of light from there if all facets mirror all, and if they
    are those of a dielectric.
    """
    toward, share, grazing = facets(cosine, roughness)
    facing = torch.from_numpy(1.0 - grazing**0.2)
    return toward, share, share * dielectric_fresnel(DIELECTRIC**2 - 1.0, facing).numpy()


def pairs_of(fit: Fit, cosine: float, roughness: float, begin: Sequence[Sequence[Pair]]) -> list[Pair]:
    """Of facets that mirror all, and of those of a dielectric; ``begin``: the same of neighbours in the table."""
    toward, *weights = mirrored_shares(cosine, roughness)
    values, _ = harmonics(np.clip(toward[:, 2], -1.0, 1.0), np.arctan2(toward[:, 1], toward[:, 0]))
    farthest = min(BEYOND[0] * math.acos(cosine) + BEYOND[1], math.pi / 2.0)
    allowed = np.broadcast_to((LEANS >= -1e-9) & (farthest >= LEANS), (len(ROUGHEST), len(LEANS)))
    found = []
    for number, weight in enumerate(weights):
        common = fit.common(values, weight)
        lobe = (weight / weight.sum()) @ values
        power = float((lobe**2 * fit.spread[fit.degrees]).sum())
        anew = fit.pair(common, allowed)
        like = [fit.pair(common, allowed, (one[number].first, one[number].second)) for one in begin]
        best = min(like, key=lambda one: one.cost, default=anew)
        found.append(anew if anew.cost + power < WORTH * (best.cost + power) else best)
    return found


def entry(pairs: Sequence[Pair], cosine: float, roughness: float) -> list[float]:
    """See :func:`torchrender.shading.sky.sky_lobes`."""
    used, mirror, found = max(roughness, SMOOTH), math.acos(cosine), []
    for pair in pairs:
        for row, column in (pair.first, pair.second):
            lean = float(LEANS[column])
            part = math.sin(lean) / max(math.sin(mirror - lean) + math.sin(lean), 1e-6)
            part = 1.0 - (1.0 - min(max(part, 0.0), MOST)) * min(roughness / SMOOTH, 1.0) ** 2
            found += [part, min(float(ROUGHEST[row]) / used, MOST)]
    _, all_, some = mirrored_shares(cosine, max(roughness, SMOOTH / 2.0))
    along = ((DIELECTRIC - 1.0) / (DIELECTRIC + 1.0)) ** 2
    added = 1.0 - along * float(all_.sum()) / float(some.sum())
    return [*found, *(pair.share for pair in pairs), 1.0 / max(added, LEAST_ADDED), 0.0]


def fit_table(size: int = SIZE) -> Array:
    """(S,S,12) float32: row = roughness times S - 1, column = root of the cosine times S - 1."""
    fit, last = Fit(), size - 1
    cosines = np.clip((np.arange(size) / last) ** 2, 0.01, 0.995)
    table = np.zeros((size, size, 12), np.float32)
    above: dict[int, list[Pair]] = {}
    for row in range(last, -1, -1):
        roughness = row / last
        right: list[Pair] | None = None
        for column in range(last, -1, -1):
            cosine, begin = float(cosines[column]), [one for one in (right, above.get(column)) if one is not None]
            if row == last or (row + 1) / last > SMOOTH:
                above[column] = pairs_of(fit, cosine, max(roughness, SMOOTH), begin)
            right = above[column]
            table[row, column] = entry(right, cosine, roughness)
    return table


def main() -> None:
    """The command."""
    write_fitted(__doc__, SKY_LOBES, fit_table)


if __name__ == "__main__":
    main()
