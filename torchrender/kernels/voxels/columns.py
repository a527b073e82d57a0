"""Solid voxels: where the surface crosses the centre lines of cell columns, counted exactly in integers.

Vertices are snapped to 2^-s of a cell. Columns run along an axis ``c``; ``a < b`` are the other two, and column
(ia, ib) has the number ``ib na + ia``. A crossing is stored as ``4 k + 1 + sign`` with ``k`` the first cell above it.
Source: specification 05, section 5.2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxels.bits import span

BLOCK = 512  # triangles handed to a thread at once
EXACT = 1 << 19  # greatest side of a triangle, in snapped units, whose crossings are found in 64-bit integers


class Columns(NamedTuple):
    """Triangles and the columns that they may cross."""

    snapped: np.ndarray  # (V,3) int64 vertices in units of 2^-bits cell
    faces: np.ndarray  # (F,3) int32
    axis: int  # of the columns
    bits: int
    na: int  # cells along the other two axes, and along the columns
    nb: int
    nc: int


@kernel(parallel=True)
def snap(vertices, origin, scale, limit, snapped):
    """Vertices in units of 2^-s cell, rounded, into ``snapped`` (V,3) int64; returns the greatest coordinate.

    Coordinates beyond ``limit`` are not stored: they would not fit.
    """
    farthest = 0.0
    for v in prange(len(vertices)):
        most = 0.0
        for c in range(3):
            at = (vertices[v, c] - origin[c]) * scale
            most = max(most, abs(at))
            if abs(at) <= limit:
                snapped[v, c] = np.int64(np.rint(at))
        farthest = max(farthest, most)
    return farthest


@kernel(inline=True)
def mixed(value):
    """A uint64 whose bits all depend on all bits of ``value`` (Steele et al., SplitMix64)."""
    value = (value ^ (value >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return value ^ (value >> np.uint64(31))


@kernel(parallel=True)
def boundary(snapped, faces, names, sums):
    """Sums over the edges of each block of faces, as rows of ``sums`` (blocks, 2) uint64.

    The total of the first column takes edges with their direction: zero if as many faces run along each edge one way as
    the other, but for one chance in 2^64. The exclusive-or of the second takes them without: zero if an even number of
    faces shares each edge. Corners at the same place are one. ``names`` (V,) uint64 is scratch.
    """
    for v in prange(len(snapped)):
        name = np.uint64(0x9E3779B97F4A7C15)
        for c in range(3):
            name = mixed(name + np.uint64(snapped[v, c]))
        names[v] = name
    for block in prange(len(sums)):
        directed, undirected = np.uint64(0), np.uint64(0)
        first, last = span(block, BLOCK, len(faces))
        for t in range(first, last):
            for e in range(3):
                a, b = names[faces[t, e]], names[faces[t, (e + 1) % 3]]
                if a == b:
                    continue
                edge = mixed(min(a, b) + mixed(max(a, b)))
                directed += edge if a < b else ~edge + np.uint64(1)
                undirected ^= edge
        sums[block, 0], sums[block, 1] = directed, undirected


@kernel(inline=True)
def owns(e, dx, dy):
    """Is the centre inside this edge? Centres on it belong to the triangle on one side only."""
    return e > 0 or (e == 0 and (dy < 0 or (dy == 0 and dx > 0)))


@kernel(inline=True)
def crossed_cell(corner, u, w, area, px, py, bits):
    """First cell whose centre is not below the triangle's plane at (px, py); ``u``, ``w``: its edges at ``corner``."""
    x0, y0, z0 = corner
    na = u[1] * w[2] - w[1] * u[2]
    nb = u[2] * w[0] - w[2] * u[0]
    half = np.int64(1) << (bits - 1)
    reach = max(abs(u[0]), abs(u[1]), abs(u[2]), abs(w[0]), abs(w[1]), abs(w[2]))
    if reach > EXACT:
        slope = (np.float64(u[1]) * w[2] - np.float64(w[1]) * u[2]) * (px - x0)
        slope += (np.float64(u[2]) * w[0] - np.float64(w[2]) * u[0]) * (py - y0)
        return np.int64(np.ceil((z0 - slope / area - half) / (2.0 * half)))
    cell = z0 >> bits
    rest = (z0 - (cell << bits) - half) * area - (na * (px - x0) + nb * (py - y0))
    return cell - ((-rest) // (area << bits))


@kernel(inline=True)
def crossings(columns, t, found):
    """Crossings of triangle ``t`` as rows (column, stored crossing) of ``found``; returns how many there are."""
    snapped, faces, axis, bits, na, nb, nc = columns
    a, b = (1 if axis == 0 else 0), (1 if axis == 2 else 2)
    v0, v1, v2 = faces[t, 0], faces[t, 1], faces[t, 2]
    x0, y0, x1, y1, x2, y2 = (
        snapped[v0, a],
        snapped[v0, b],
        snapped[v1, a],
        snapped[v1, b],
        snapped[v2, a],
        snapped[v2, b],
    )
    half = np.int64(1) << (bits - 1)
    left = max((min(x0, x1, x2) + half - 1) >> bits, 0)
    right = min((max(x0, x1, x2) - half) >> bits, na - 1)
    low = max((min(y0, y1, y2) + half - 1) >> bits, 0)
    high = min((max(y0, y1, y2) - half) >> bits, nb - 1)
    if left > right or low > high:
        return 0
    z0, z1, z2 = snapped[v0, axis], snapped[v1, axis], snapped[v2, axis]
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return 0
    code = 2
    if area < 0:
        x1, y1, z1, x2, y2, z2 = x2, y2, z2, x1, y1, z1
        area, code = -area, 0
    u, w = (x1 - x0, y1 - y0, z1 - z0), (x2 - x0, y2 - y0, z2 - z0)
    count = 0
    for ib in range(low, high + 1):
        py = (ib << bits) + half
        for ia in range(left, right + 1):
            px = (ia << bits) + half
            if not owns(u[0] * (py - y0) - u[1] * (px - x0), u[0], u[1]):
                continue
            if not owns((x2 - x1) * (py - y1) - (y2 - y1) * (px - x1), x2 - x1, y2 - y1):
                continue
            if not owns(w[1] * (px - x0) - w[0] * (py - y0), -w[0], -w[1]):
                continue
            k = crossed_cell((x0, y0, z0), u, w, area, px, py, bits)
            found[count, 0] = ib * na + ia
            found[count, 1] = 4 * min(max(k, 0), nc) + code
            count += 1
    return count


@kernel(parallel=True)
def find_crossings(columns, threads, hits, places, events, tally):
    """Count crossings, or store them: in two calls, each column after the other.

    Args:
        columns: :class:`Columns`.
        hits: (F,) bool triangles that have crossings: written when counting, read when storing.
        places: (columns,) int64: counting adds the crossings of each column; storing takes and advances where its next
            one goes.
        events: int32, filled; without elements, crossings are counted.
        tally: (1,) int64, advanced by the blocks handed out.
    """
    count = len(columns.faces)
    blocks = (count + BLOCK - 1) // BLOCK
    storing = len(events) > 0
    shared = borrowed(places)
    scratch = np.empty((threads, columns.na * columns.nb, 2), np.int64)
    for thread in prange(threads):
        found = borrowed(scratch[thread])
        own = borrowed(columns)
        while True:
            block = fetch_add(tally, 0, 1)
            if block >= blocks:
                break
            for t in range(block * BLOCK, min((block + 1) * BLOCK, count)):
                if storing and not hits[t]:
                    continue
                met = crossings(own, t, found)
                if not storing:
                    hits[t] = met > 0
                for n in range(met):
                    at = fetch_add(shared, found[n, 0], 1)
                    if storing:
                        events[at] = found[n, 1]


@kernel(inline=True)
def sort_run(events, begin, end):
    """Insertion sort: a column has few crossings, and those of neighbouring triangles come nearly sorted."""
    for i in range(begin + 1, end):
        value = events[i]
        j = i - 1
        while j >= begin and events[j] > value:
            events[j + 1] = events[j]
            j -= 1
        events[j + 1] = value


@kernel(parallel=True)
def column_runs(events, starts, parity, cells, faults):
    """Turn the crossings of each column into places where it changes between outside and inside.

    Args:
        events: int32, in any order within a column; on return the first ``n`` of column ``i`` hold its changes and the
            next one, if any, is -1.
        starts: (columns + 1,) int64.
        parity: inside where the count is odd, else where the winding number is not zero.
        cells: cells of a column; changes there are of no consequence.
        faults: (columns,) uint8: 1 odd number of crossings, 2 winding number that does not return to zero.
    """
    for column in prange(len(starts) - 1):
        begin, end = starts[column], starts[column + 1]
        sort_run(events, begin, end)
        winding, inside = 0, False
        write = begin
        n = begin
        while n < end:
            k = events[n] >> 2
            while n < end and events[n] >> 2 == k:
                winding += (events[n] & 3) - 1
                n += 1
            now = ((n - begin) & 1) == 1 if parity else winding != 0
            if now != inside and k < cells:
                events[write] = k
                write += 1
            inside = now
        if write < end:
            events[write] = -1
        faults[column] = ((end - begin) & 1) | (2 if winding != 0 else 0)


@kernel(parallel=True)
def fill_rows(events, starts, cells, words):
    """Columns along x: set the bits between changes. ``words`` (columns, nw) uint64."""
    for row in prange(len(starts) - 1):
        n, end = starts[row], starts[row + 1]
        while n < end and events[n] >= 0:
            first = events[n]
            last = cells
            if n + 1 < end and events[n + 1] >= 0:
                last = events[n + 1]
            n += 2
            while first < last:
                stop = min(last, ((first >> 6) + 1) << 6)
                ones = ~np.uint64(0) >> np.uint64(64 - (stop - first))
                words[row, first >> 6] |= ones << np.uint64(first & 63)
                first = stop


@kernel(parallel=True)
def toggle_columns(events, starts, columns, steps, words):
    """Columns along y or z: toggle the bit at each change, for :func:`run_along` to spread.

    ``columns`` = (na, nb); ``words`` flat; cell (ia, ib, k) is bit ia of the row at ``ib steps[0] + k steps[1]``.
    """
    na, nb = columns
    for ib in prange(nb):
        for ia in range(na):
            n, end = starts[np.int64(ib) * na + ia], starts[np.int64(ib) * na + ia + 1]
            while n < end and events[n] >= 0:
                word = np.int64(ib) * steps[0] + events[n] * steps[1] + (ia >> 6)
                words[word] ^= np.uint64(1) << np.uint64(ia & 63)
                n += 1


@kernel(parallel=True)
def run_along(words):
    """Running exclusive-or along the middle axis of (outer, n, inner) uint64."""
    outer, n, inner = words.shape
    chunks = 16 if outer == 1 else 1
    for part in prange(outer * chunks):
        o, c = np.int64(part) // chunks, np.int64(part) % chunks
        begin, end = c * inner // chunks, (c + 1) * inner // chunks
        for k in range(1, n):
            for w in range(begin, end):
                words[o, k, w] ^= words[o, k - 1, w]
