"""Spheres that share points as well as they can: what others cover is handed over, and freed spheres help elsewhere.

Clusters by flood fill (specification 08, section 4) leave spheres whose points other spheres cover as well. Handing
those over lets spheres shrink, and some are not needed at all; each of these takes half of the cluster whose split
gains most. A teleport takes away the sphere whose points cost least elsewhere, for another split.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.effects.sky_shadows.clusters import Array, Model, State, outermost, sphere_of
from torchrender.kernels.sky_shadows.fit import outside_volume

MEANS = 4
"""Rounds in which two halves of a cluster find their middles."""

SETTLED = 1e-3
"""Share of what stands out that another round has to gain."""

RIM = 0.97
"""Share of its radius from which on points keep a sphere from shrinking."""


class _Split(NamedTuple):
    gain: float  # volume that stands out no more
    halves: tuple[Array, Array] | None = None  # rows of points
    middles: tuple[Array, Array] | None = None


class Sharing:
    """A state whose spheres share their points."""

    def __init__(self, model: Model, state: State) -> None:
        self.model, self.points = model, model.points
        self.centres, self.radii = state.centres.copy(), state.radii.copy()
        self.labels, self.outside = state.labels.copy(), state.outside.copy()
        self.away = np.linalg.norm(model.points[:, None] - self.centres[None], axis=-1)  # (N,S)
        self._splits: dict[int, _Split] = {}

    @property
    def state(self) -> State:
        """As it is now."""
        return State(self.centres.copy(), self.radii.copy(), self.labels.copy(), self.outside.copy())

    def settle(self) -> Sharing:
        """Points handed over and spheres split until nothing is left to gain that way; itself."""
        before = np.inf
        while self.outside.sum() < before * (1.0 - SETTLED):
            before = float(self.outside.sum())
            self._relieve()
            self._use_free()
        return self

    def without(self, sphere: int) -> Sharing:
        """Another one, in which the others cover a sphere's points and that sphere helps elsewhere."""
        other = Sharing.__new__(Sharing)
        other.__dict__.update({k: v.copy() if hasattr(v, "copy") else v for k, v in self.__dict__.items()})
        _, rows, takers = other._loss(sphere)
        other.labels[rows] = takers
        other._put(sphere, rows[:0])
        for taker in np.unique(takers).tolist():
            other._put(taker, np.flatnonzero(other.labels == taker))
        return other.settle()

    def with_points(self, points: Array) -> Sharing:
        """Another one that covers points (M,3) as well, each by a sphere that holds it or grows least for it."""
        labels, reach = joined(self.state, points)
        missed = reach > self.radii[labels]
        if not missed.any():
            return self
        other = Sharing.__new__(Sharing)
        other.__dict__.update({k: v.copy() if hasattr(v, "copy") else v for k, v in self.__dict__.items()})
        added = points[missed]
        other.points = np.concatenate([self.points, added])
        other.labels = np.concatenate([self.labels, labels[missed]])
        away = np.linalg.norm(added[:, None] - self.centres[None], axis=-1)
        other.away = np.concatenate([self.away, away])
        for sphere in np.unique(labels[missed]).tolist():
            other._put(sphere, np.flatnonzero(other.labels == sphere))
        return other.settle()

    def dispensable(self) -> list[int]:
        """Spheres in use, first the one without which least would stand out."""
        used = np.flatnonzero(self.radii > 0)
        if len(used) < 2:
            return []
        return [int(k) for _, k in sorted((self._loss(int(k))[0], int(k)) for k in used)]

    def _put(self, sphere: int, rows: Array, centre: Array | None = None) -> None:
        self.labels[rows] = sphere
        self._splits.pop(sphere, None)
        if not len(rows):
            self.radii[sphere] = self.outside[sphere] = 0.0
            return
        begin = self.centres[sphere] if centre is None else centre
        place, radius, outside = sphere_of(self.model, begin, self.points[rows])
        self.centres[sphere], self.radii[sphere], self.outside[sphere] = place, radius, outside
        self.away[:, sphere] = np.linalg.norm(self.points - place, axis=1)

    def _relieve(self) -> None:
        """Spheres give away what others cover, the one that stands out most first."""
        for sphere in np.argsort(-self.outside).tolist():
            rows = np.flatnonzero(self.labels == sphere)
            if not len(rows):
                self._put(sphere, rows)
                continue
            depth = self.away[rows] - np.where(self.radii > 0, self.radii, -np.inf)[None]
            depth[:, sphere] = np.inf
            taker = depth.argmin(axis=1)
            given = depth[np.arange(len(rows)), taker] <= 0
            if not (given & (self.away[rows, sphere] >= RIM * self.radii[sphere])).any():
                continue
            self.labels[rows[given]] = taker[given]
            for k in np.unique(taker[given]).tolist():
                self._splits.pop(k, None)
            kept = self.centres[sphere].copy(), self.radii[sphere], self.outside[sphere]
            self._put(sphere, rows[~given])
            if self.outside[sphere] > kept[2]:  # a search that found worse: fewer points fit into what was there
                self.centres[sphere], self.radii[sphere], self.outside[sphere] = kept
                self.away[:, sphere] = np.linalg.norm(self.points - kept[0], axis=1)

    def _use_free(self) -> None:
        free = np.flatnonzero(self.radii <= 0).tolist()
        while free:
            used = np.flatnonzero(self.radii > 0).tolist()
            best = max(used, key=lambda k: self._split(k).gain)
            split = self._split(best)
            if split.gain <= 0 or split.halves is None or split.middles is None:
                return
            self._put(best, split.halves[0], split.middles[0])
            self._put(free.pop(), split.halves[1], split.middles[1])

    def _split(self, sphere: int) -> _Split:
        """A cluster in two, about its two outermost points."""
        if sphere not in self._splits:
            self._splits[sphere] = self._halved(sphere)
        return self._splits[sphere]

    def _halved(self, sphere: int) -> _Split:
        rows = np.flatnonzero(self.labels == sphere)
        points = self.points[rows]
        outer = outermost(points)
        apart = ((outer[:, None] - outer[None]) ** 2).sum(axis=-1)
        i, j = np.unravel_index(int(apart.argmax()), apart.shape)
        a, b = outer[i], outer[j]
        for _ in range(MEANS):
            first = ((points - a) ** 2).sum(axis=1) < ((points - b) ** 2).sum(axis=1)
            if first.all() or not first.any():
                return _Split(0.0)
            a, b = points[first].mean(axis=0), points[~first].mean(axis=0)
        left = sphere_of(self.model, a, points[first])[2] + sphere_of(self.model, b, points[~first])[2]
        return _Split(float(self.outside[sphere]) - left, (rows[first], rows[~first]), (a, b))

    def _loss(self, sphere: int) -> tuple[float, Array, Array]:
        """What more would stand out without a sphere, its points, and the spheres that would take them."""
        rows = np.flatnonzero(self.labels == sphere)
        growth = self.away[rows] - self.radii[None]
        growth[:, (self.radii <= 0) | (np.arange(len(self.radii)) == sphere)] = np.inf
        takers = growth.argmin(axis=1)
        loss = -float(self.outside[sphere])
        for taker in np.unique(takers).tolist():
            reach = self.away[rows[takers == taker], taker].max()
            if reach > self.radii[taker]:
                place = self.centres[taker]
                grown = outside_volume(self.model.solid, place[0], place[1], place[2], reach)
                loss += float(grown) - float(self.outside[taker])
        return loss, rows, takers


def joined(state: State, points: Array) -> tuple[Array, Array]:
    """The sphere of each point (N,3), which holds it or grows least for it, and the distance to its centre."""
    labels, reach = np.zeros(len(points), np.int64), np.zeros(len(points))
    shut = np.where(state.radii > 0, -state.radii, np.inf)
    if not np.isfinite(shut).any():  # a model of one point
        shut[:] = 0.0
    for rows in np.array_split(np.arange(len(points)), len(points) // 4096 + 1):
        away = np.linalg.norm(points[rows, None] - state.centres[None], axis=-1)
        labels[rows] = (away + shut).argmin(axis=1)
        reach[rows] = away[np.arange(len(rows)), labels[rows]]
    return labels, reach
