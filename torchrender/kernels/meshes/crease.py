"""Vertices welded by position, and normals that are smooth over gentle edges: hash tables and a union-find."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel

_EMPTY = -1
_NEAR = 8
"""Places of a table that are tried near the own one."""


@kernel()
def weld_points(bits: np.ndarray, place: np.ndarray, first: np.ndarray) -> int:
    """Number the distinct rows of ``bits`` (V,3) int64 in the order that they come in.

    ``place`` (V,) int64 gets each row's number, ``first`` (V,) the row that each number was met at; returns how many.
    """
    size = _table_size(len(bits))
    table = np.full(size, _EMPTY, np.int32)
    count = 0
    for v in range(len(bits)):
        slot = _mix(bits[v, 0], _mix(bits[v, 1], bits[v, 2])) & (size - 1)
        while True:
            known = table[slot]
            if known == _EMPTY:
                table[slot] = count
                first[count] = v
                place[v] = count
                count += 1
                break
            row = first[known]
            if bits[row, 0] == bits[v, 0] and bits[row, 1] == bits[v, 1] and bits[row, 2] == bits[v, 2]:
                place[v] = known
                break
            slot = (slot + 1) & (size - 1)
    return count


@kernel()
def turn_faces(faces: np.ndarray, turned: np.ndarray) -> None:
    """Each face (F,3) int64 from its smallest corner on, in the same order: ``turned`` (F,3) int64."""
    for f in range(len(faces)):
        k = 0
        if faces[f, 1] < faces[f, 0]:
            k = 1
        if faces[f, 2] < faces[f, k]:
            k = 2
        for j in range(3):
            turned[f, j] = faces[f, (k + j) % 3]


@kernel()
def corner_groups(corners: np.ndarray, normals: np.ndarray, cosine: float, group: np.ndarray) -> None:
    """Corners of one position that edges connect whose faces meet gently.

    Args:
        corners: (F,3) int64 welded positions.
        normals: (F,3) float64 unit normals.
        cosine: of the greatest angle that is gentle.
        group: (3F,) int32 gets the smallest corner that each corner is connected with.
    """
    faces = len(corners)
    for c in range(3 * faces):
        group[c] = c
    size = _table_size(3 * faces)
    table = np.full(size, _EMPTY, np.int32)  # last half edge of each edge
    most = np.int64(0)
    for f in range(faces):
        for k in range(3):
            most = max(most, corners[f, k])
    room = max(size // (most + 1), 1)
    for half in range(3 * faces):
        f, k = half // 3, half % 3
        p, q = corners[f, k], corners[f, (k + 1) % 3]
        low, high = min(p, q), max(p, q)
        # Neighbours in the mesh are neighbours in the table, which keeps it in the cache; hubs overflow to anywhere.
        slot, tries = (low * room + high % _NEAR) & (size - 1), 0
        while True:
            other = table[slot]
            if other == _EMPTY:
                table[slot] = half
                break
            g, j = other // 3, other % 3
            r, s = corners[g, j], corners[g, (j + 1) % 3]
            if min(r, s) == low and max(r, s) == high:
                table[slot] = half
                dot = normals[f, 0] * normals[g, 0] + normals[f, 1] * normals[g, 1] + normals[f, 2] * normals[g, 2]
                if dot >= cosine:
                    here, there = half, other
                    here_next, there_next = 3 * f + (k + 1) % 3, 3 * g + (j + 1) % 3
                    if p == r:
                        _join(group, here, there)
                        _join(group, here_next, there_next)
                    else:
                        _join(group, here, there_next)
                        _join(group, here_next, there)
                break
            tries += 1
            slot = _mix(low, high) & (size - 1) if tries == _NEAR else (slot + 1) & (size - 1)
    for c in range(3 * faces):
        group[c] = _root(group, c)


@kernel()
def split_vertices(
    faces: np.ndarray, group: np.ndarray, count: int, new: np.ndarray, source: np.ndarray, label: np.ndarray
) -> int:
    """One new vertex for each pair of old vertex and group, in the order of the old ones.

    Args:
        faces: (F,3) int64 old vertices.
        group: (3F,) int32.
        count: old vertices.
        new: (F,3) int64 gets the new vertex of each corner.
        source, label: (3F,) int32 get the old vertex and the group of each new one.

    Returns:
        How many new vertices there are.
    """
    flat = faces.reshape(-1)
    head = np.full(count, _EMPTY, np.int32)  # last new vertex of each old one
    before = np.empty(len(flat), np.int32)
    found = 0
    place = new.reshape(-1)
    for c in range(len(flat)):
        n = head[flat[c]]
        while n != _EMPTY and label[n] != group[c]:
            n = before[n]
        if n == _EMPTY:
            n = found
            source[n], label[n], before[n] = flat[c], group[c], head[flat[c]]
            head[flat[c]] = n
            found += 1
        place[c] = n
    start = np.zeros(count + 1, np.int64)
    for n in range(found):
        start[source[n] + 1] += 1
    for v in range(count):
        start[v + 1] += start[v]
    rank = np.empty(found, np.int32)
    for n in range(found):
        rank[n] = start[source[n]]
        start[source[n]] += 1
    old_source, old_label = source[:found].copy(), label[:found].copy()
    for n in range(found):
        source[rank[n]], label[rank[n]] = old_source[n], old_label[n]
    for c in range(len(flat)):
        place[c] = rank[place[c]]
    return found


@kernel()
def sum_normals(
    points: np.ndarray, corners: np.ndarray, normals: np.ndarray, group: np.ndarray, sums: np.ndarray
) -> None:
    """Add each face's normal, times its angle there, to the groups of its corners; ``sums`` (3F,3) float64."""
    for f in range(len(corners)):
        for k in range(3):
            a, b, c = corners[f, k], corners[f, (k + 1) % 3], corners[f, (k + 2) % 3]
            angle = _angle(points[a], points[b], points[c])
            g = group[3 * f + k]
            for axis in range(3):
                sums[g, axis] += angle * normals[f, axis]


@kernel()
def unit_normals(points: np.ndarray, corners: np.ndarray, normals: np.ndarray) -> None:
    """Unit normals (F,3) float64 by the right-hand rule; zero for triangles without area."""
    for f in range(len(corners)):
        a, b, c = corners[f, 0], corners[f, 1], corners[f, 2]
        big = 0.0
        for k in range(3):
            big = max(big, abs(points[b, k] - points[a, k]), abs(points[c, k] - points[a, k]))
        normals[f] = 0.0
        if not big > 0.0:
            continue
        ux, uy = (points[b, 0] - points[a, 0]) / big, (points[b, 1] - points[a, 1]) / big
        uz = (points[b, 2] - points[a, 2]) / big
        vx, vy = (points[c, 0] - points[a, 0]) / big, (points[c, 1] - points[a, 1]) / big
        vz = (points[c, 2] - points[a, 2]) / big
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        # Thin triangles: the product may be so small that its square is nothing.
        most = max(abs(x), abs(y), abs(z))
        if most > 0.0:
            x, y, z = x / most, y / most, z / most
            length = math.sqrt(x * x + y * y + z * z)
            normals[f, 0], normals[f, 1], normals[f, 2] = x / length, y / length, z / length


@kernel()
def _angle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Between the directions from a to b and from a to c; scaled first, so that no length under- or overflows."""
    big_u = max(abs(b[0] - a[0]), abs(b[1] - a[1]), abs(b[2] - a[2]))
    big_v = max(abs(c[0] - a[0]), abs(c[1] - a[1]), abs(c[2] - a[2]))
    if not big_u > 0.0 or not big_v > 0.0:
        return math.pi / 2
    dot, uu, vv = 0.0, 0.0, 0.0
    for k in range(3):
        u, v = (b[k] - a[k]) / big_u, (c[k] - a[k]) / big_v
        dot += u * v
        uu += u * u
        vv += v * v
    return math.acos(min(max(dot / math.sqrt(uu * vv), -1.0), 1.0))


@kernel()
def _join(group: np.ndarray, a: int, b: int) -> None:
    a, b = _root(group, a), _root(group, b)
    if a < b:
        group[b] = a
    else:
        group[a] = b


@kernel()
def _root(group: np.ndarray, a: int) -> int:
    while group[a] != a:
        group[a] = group[group[a]]
        a = group[a]
    return a


@kernel()
def _table_size(count: int) -> int:
    """A power of two with room for as many again."""
    size = 16
    while size < 2 * count:
        size *= 2
    return size


@kernel()
def _mix(a: int, b: int) -> int:
    """A number of both whose low bits depend on all of theirs."""
    h = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15) ^ (np.uint64(b) * np.uint64(0xC2B2AE3D27D4EB4F))
    h ^= h >> np.uint64(32)
    h *= np.uint64(0xD6E8FEB86659FD93)
    h ^= h >> np.uint64(29)
    return int(h & np.uint64(0x7FFFFFFFFFFFFFFF))
