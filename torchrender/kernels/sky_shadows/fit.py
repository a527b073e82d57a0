"""Spheres that cover a solid: clusters of its points by flood fill, and the sphere of a cluster that stands out least.

Source: specification 08, section 4 (Wang and others, *Variational sphere set approximation for solid objects*, 2006).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel

_GOLDEN = 0.3819660112501051
_SPHERE = 4.0 / 3.0 * math.pi


class Solid(NamedTuple):
    """A solid in cubic cells."""

    filled: np.ndarray  # (nz,ny,nx) uint8
    before: np.ndarray  # (nz,ny,nx+1) int32 filled cells of the row before each
    origin: np.ndarray  # (3,) float64 lowest corner
    cell: float


def solid_of(filled: np.ndarray, origin: np.ndarray, cell: float) -> Solid:
    """A solid of cells (nz,ny,nx), not 0 where filled."""
    cells = np.ascontiguousarray(filled != 0, np.uint8)
    before = np.zeros((*cells.shape[:2], cells.shape[2] + 1), np.int32)
    np.cumsum(cells, axis=2, out=before[:, :, 1:])
    return Solid(cells, before, np.ascontiguousarray(origin, np.float64), float(cell))


@kernel()
def outside_volume(solid, x, y, z, radius):
    """Volume of a sphere outside the solid; cells at its edge count in part, so that it is smooth.

    Cells of a row that lie within whole are counted at once.
    """
    filled, before, origin, h = solid.filled, solid.before, solid.origin, solid.cell
    reach, core = radius + 0.5 * h, max(radius - 0.5 * h, 0.0)
    k0 = max(math.ceil((z - reach - origin[2]) / h - 0.5), 0)
    k1 = min(math.floor((z + reach - origin[2]) / h - 0.5), filled.shape[0] - 1)
    inside = 0.0
    for k in range(k0, k1 + 1):
        dz = origin[2] + (k + 0.5) * h - z
        flat = math.sqrt(max(reach * reach - dz * dz, 0.0))
        j0 = max(math.ceil((y - flat - origin[1]) / h - 0.5), 0)
        j1 = min(math.floor((y + flat - origin[1]) / h - 0.5), filled.shape[1] - 1)
        for j in range(j0, j1 + 1):
            dy = origin[1] + (j + 0.5) * h - y
            square = dz * dz + dy * dy
            line = math.sqrt(max(reach * reach - square, 0.0))
            i0 = max(math.ceil((x - line - origin[0]) / h - 0.5), 0)
            i1 = min(math.floor((x + line - origin[0]) / h - 0.5), filled.shape[2] - 1)
            first = last = i0  # of the cells within whole, and the one behind them
            if square < core * core:
                line = math.sqrt(core * core - square)
                first = max(math.ceil((x - line - origin[0]) / h - 0.5), i0)
                last = max(min(math.floor((x + line - origin[0]) / h - 0.5), i1) + 1, first)
                inside += before[k, j, last] - before[k, j, first] if last > first else 0
            i = i0
            while i <= i1:
                if i == first and last > first:
                    i = last
                    continue
                if filled[k, j, i] != 0:
                    dx = origin[0] + (i + 0.5) * h - x
                    share = 0.5 - (math.sqrt(square + dx * dx) - radius) / h
                    inside += min(max(share, 0.0), 1.0)
                i += 1
    return _SPHERE * radius**3 - h**3 * inside


@kernel()
def _farthest(points, x, y, z):
    most = 0.0
    for i in range(points.shape[0]):
        a, b, c = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
        most = max(most, a * a + b * b + c * c)
    return math.sqrt(most)


@kernel()
def _cost(solid, points, place):
    radius = _farthest(points, place[0], place[1], place[2])
    return outside_volume(solid, place[0], place[1], place[2], radius)


@kernel()
def refit(solid, points, place, rounds):
    """Moves ``place`` (3,) to where the sphere around all points (N,3) stands out least; what stands out.

    Powell's method: line searches along directions that follow what the round before moved.
    """
    directions = np.eye(3)
    best = _cost(solid, points, place)
    step = 2.0 * solid.cell
    trial = np.empty(3)
    for _ in range(rounds):
        before, begin = best, place.copy()
        largest, drop = 0, 0.0
        for d in range(4):
            last = d == 3
            if last:
                along = place - begin
                length = math.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
                if length < 1e-3 * solid.cell:
                    break
                along /= length
            else:
                along = directions[d].copy()
            earlier = best
            low, high = -step, step
            a, b = low + _GOLDEN * (high - low), high - _GOLDEN * (high - low)
            for c in range(3):
                trial[c] = place[c] + a * along[c]
            fa = _cost(solid, points, trial)
            for c in range(3):
                trial[c] = place[c] + b * along[c]
            fb = _cost(solid, points, trial)
            for _ in range(6):
                if fa < fb:
                    high, b, fb = b, a, fa
                    a = low + _GOLDEN * (high - low)
                    for c in range(3):
                        trial[c] = place[c] + a * along[c]
                    fa = _cost(solid, points, trial)
                else:
                    low, a, fa = a, b, fb
                    b = high - _GOLDEN * (high - low)
                    for c in range(3):
                        trial[c] = place[c] + b * along[c]
                    fb = _cost(solid, points, trial)
            found, at = (fa, a) if fa < fb else (fb, b)
            if found < best:
                best = found
                for c in range(3):
                    place[c] += at * along[c]
            if last:
                directions[largest] = along
            elif earlier - best > drop:
                largest, drop = d, earlier - best
        if before - best < 1e-3 * (abs(best) + 1e-3 * solid.cell**3):
            if step <= 0.5 * solid.cell:
                break
            step *= 0.4
    return best


@kernel()
def volumes_within(solid, centres, width, table):
    """Volume of the solid within each radius ``n width`` of each centre (K,3) into table (K,M)."""
    filled, origin, h = solid.filled, solid.origin, solid.cell
    last = table.shape[1] - 1
    table[:] = 0.0
    for k in range(filled.shape[0]):
        for j in range(filled.shape[1]):
            for i in range(filled.shape[2]):
                if filled[k, j, i] == 0:
                    continue
                x, y, z = origin[0] + (i + 0.5) * h, origin[1] + (j + 0.5) * h, origin[2] + (k + 0.5) * h
                for c in range(centres.shape[0]):
                    a, b, d = x - centres[c, 0], y - centres[c, 1], z - centres[c, 2]
                    place = math.ceil(math.sqrt(a * a + b * b + d * d) / width)
                    table[c, min(place, last)] += 1.0
    for c in range(centres.shape[0]):
        total = 0.0
        for n in range(last + 1):
            total += table[c, n]
            table[c, n] = total * h**3


@kernel()
def _sticks_out(table, c, width, radius):
    place = radius / width
    n = min(int(place), table.shape[1] - 2)
    share = min(place - n, 1.0)
    inside = table[c, n] + (table[c, n + 1] - table[c, n]) * share
    return max(_SPHERE * radius**3 - inside, 0.0)


@kernel()
def flood(points, neighbours, centres, volumes, radii, labels):
    """Gives each point (N,3) the sphere whose growth to it adds least outside the solid; ties: the nearest.

    ``neighbours`` (N,M) int64, ``volumes``: table of :func:`volumes_within` and its width. ``radii`` (K,) grow from
    what they are, and ``labels`` (N,) are set.
    """
    table, width = volumes
    count = points.shape[0]
    labels[:] = -1
    waiting = np.zeros(count, np.uint8)
    stack = np.empty(count, np.int64)
    used, seed = 0, 0
    nearest = math.inf
    for p in range(count):
        a, b, c = points[p, 0] - centres[0, 0], points[p, 1] - centres[0, 1], points[p, 2] - centres[0, 2]
        if a * a + b * b + c * c < nearest:
            nearest, seed = a * a + b * b + c * c, p
    present = np.empty(centres.shape[0])
    for k in range(centres.shape[0]):
        present[k] = _sticks_out(table, k, width, radii[k])
    stack[0], used = seed, 1
    waiting[seed] = 1
    beginning = 0
    while True:
        if used == 0:
            while beginning < count and waiting[beginning] != 0:
                beginning += 1
            if beginning == count:
                break
            stack[0], used = beginning, 1
            waiting[beginning] = 1
        used -= 1
        p = stack[used]
        best, least, closest = -1, math.inf, math.inf
        for k in range(centres.shape[0]):
            a, b, c = points[p, 0] - centres[k, 0], points[p, 1] - centres[k, 1], points[p, 2] - centres[k, 2]
            distance = math.sqrt(a * a + b * b + c * c)
            growth = 0.0
            if distance > radii[k]:
                growth = max(_sticks_out(table, k, width, distance) - present[k], 0.0)
            if growth < least or (growth == least and distance < closest):
                best, least, closest = k, growth, distance
        labels[p] = best
        if closest > radii[best]:
            radii[best] = closest
            present[best] = _sticks_out(table, best, width, closest)
        for n in range(neighbours.shape[1]):
            other = neighbours[p, n]
            if waiting[other] == 0:
                waiting[other] = 1
                stack[used] = other
                used += 1
