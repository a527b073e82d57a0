"""The cost of a choice, and of everything that differs from it in one object, by table look-ups alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchrender.photo.style.adjacency import Smoothness
from torchrender.photo.style.statistics import UNITS, ColorStatistics, StyleTables


@dataclass(frozen=True)
class CostParts:
    """F and what it is made of."""

    mean: float
    deviation: float
    histogram: float
    smooth: float
    prior: float
    fit: float

    @property
    def total(self) -> float:
        """F."""
        return self.mean + self.deviation + self.histogram + self.smooth + self.prior + self.fit


class StyleCost:
    """``F = sum_j E(S, V_j) + w_s smoothness + prior + misfit`` of choices (m,) of candidates.

    Views without any pixel of an object cost nothing. Bins that the photo leaves empty add nothing to an
    intersection, so they are left out.
    """

    def __init__(
        self,
        tables: StyleTables,
        wanted: ColorStatistics,
        smoothness: Smoothness,
        *,
        smooth_weight: float,
        prior: np.ndarray | None = None,
        misfit: np.ndarray | None = None,
        units: str = "normalized",
    ) -> None:
        histogram = wanted.histogram.numpy()
        kept = np.flatnonzero(histogram[tables.bins] > 0)
        self._object, self._view = tables.object, tables.view
        self._sums = tables.sums[:, :, :4]
        self._counts = tables.counts[:, :, kept].astype(np.float64)
        self._photo = histogram[tables.bins[kept]]
        self._mean, self._deviation = wanted.mean.numpy(), wanted.deviation.numpy()
        self._scale = UNITS[units] ** 2
        self._pixels = np.bincount(tables.view, tables.count, minlength=tables.views)
        self._smoothness, self._weight = smoothness, smooth_weight
        nothing = np.zeros((tables.objects, tables.sums.shape[1]))
        self._prior = nothing if prior is None else prior
        self._misfit = nothing if misfit is None else misfit
        self._own = self._prior + self._misfit  # of each object's candidates, whatever the others have
        self._of_view = [np.flatnonzero(tables.view == j) for j in range(tables.views)]
        self.objects, self.columns, self.views = tables.objects, int(tables.sums.shape[1]), tables.views

    def parts(self, choice: np.ndarray) -> CostParts:
        """F of a choice, part by part."""
        shares = self._terms(*self._totals(choice), np.arange(self.views))
        prior, fit = (float(t[np.arange(self.objects), choice].sum()) for t in (self._prior, self._misfit))
        smooth = self._weight * self._smoothness.total(choice) if self._weight else 0.0
        mean, deviation, histogram = (float(p.sum()) for p in shares)
        return CostParts(mean, deviation, histogram, smooth, prior, fit)

    def total(self, choice: np.ndarray) -> float:
        """F of a choice."""
        return self.parts(choice).total

    def totals(self, choices: np.ndarray) -> np.ndarray:
        """(B,) F of many choices (B,m) at once."""
        rows = np.arange(len(self._object))
        chosen = choices[:, self._object]
        out = np.zeros(len(choices))
        own_sums, own_counts = self._sums[rows, chosen], self._counts[rows, chosen]
        for j, pairs in enumerate(self._of_view):
            terms = self._terms(own_sums[:, pairs].sum(axis=1), own_counts[:, pairs].sum(axis=1), np.array(j))
            out += sum(terms)
        if self._weight:
            out += self._weight * self._smoothness.totals(choices)
        return out + self._own[np.arange(self.objects), choices].sum(axis=1)

    def start(self, choice: np.ndarray) -> Moves:
        """The neighbourhood of a choice, kept up to date as it moves."""
        return Moves(self, choice)

    def _totals(self, choice: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(n,4) sums and (n,K) counts of every view."""
        rows = np.arange(len(self._object))
        chosen = choice[self._object]
        sums, counts = np.zeros((self.views, 4)), np.zeros((self.views, len(self._photo)))
        np.add.at(sums, self._view, self._sums[rows, chosen])
        np.add.at(counts, self._view, self._counts[rows, chosen])
        return sums, counts

    def _terms(
        self, sums: np.ndarray, counts: np.ndarray, view: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parts of E for sums (...,4) and counts (...,K) of views (...)."""
        pixels = self._pixels[view]
        some = pixels > 0
        share = 1.0 / np.maximum(pixels, 1.0)
        while share.ndim < sums.ndim - 1:
            share, some = share[..., None], some[..., None]
        mean = sums[..., :2] * share[..., None]
        square = sums[..., 2:] * share[..., None]
        deviation = np.sqrt(np.maximum(square - mean * mean, 0.0))
        first = self._scale * ((mean - self._mean) ** 2).sum(axis=-1)
        second = self._scale * ((deviation - self._deviation) ** 2).sum(axis=-1)
        common = np.minimum(counts * share[..., None], self._photo).sum(axis=-1)
        return some * first, some * second, some * np.clip(1.0 - common, 0.0, 1.0)


class Moves:
    """F of all choices that differ from the present one in one object."""

    def __init__(self, cost: StyleCost, choice: np.ndarray) -> None:
        self._cost = cost
        self.choice = choice.copy()
        self._change = np.zeros((len(cost._object), cost.columns))  # of E of the pair's view
        self._now = np.zeros(cost.views)  # E of each view
        for j in range(cost.views):
            self._refresh(j)
        self.total = self._recount()

    def neighbours(self) -> np.ndarray:
        """(m,C) F after the move of object i to candidate c; of the present choice where that is no move."""
        cost = self._cost
        out = np.zeros((cost.objects, cost.columns))
        np.add.at(out, cost._object, self._change)
        if cost._weight:
            out += cost._weight * cost._smoothness.moves(self.choice)
        out += cost._own - cost._own[np.arange(cost.objects), self.choice][:, None]
        return self.total + out

    def move(self, index: int, column: int) -> None:
        """Give object ``index`` candidate ``column``: only views that show it are looked at again."""
        self.choice[index] = column
        for j in self._cost._view[self._cost._object == index]:
            self._refresh(int(j))
        self.total = self._recount()

    def _refresh(self, j: int) -> None:
        cost = self._cost
        rows = cost._of_view[j]
        chosen = self.choice[cost._object[rows]]
        # Summed afresh, so that no rounding error gathers over moves.
        own_sums, own_counts = cost._sums[rows, chosen], cost._counts[rows, chosen]
        sums, counts = own_sums.sum(axis=0), own_counts.sum(axis=0)
        view = np.array(j)
        self._now[j] = float(sum(cost._terms(sums, counts, view)))
        if not len(rows):
            return
        moved = cost._terms(
            sums - own_sums[:, None] + cost._sums[rows], counts - own_counts[:, None] + cost._counts[rows], view
        )
        self._change[rows] = sum(moved) - self._now[j]

    def _recount(self) -> float:
        cost = self._cost
        smooth = cost._weight * cost._smoothness.total(self.choice) if cost._weight else 0.0
        own = float(cost._own[np.arange(cost.objects), self.choice].sum())
        return float(self._now.sum()) + smooth + own
