"""Welding and grouping by hash tables, against dictionaries and a search over a graph."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.meshes.crease import (
    corner_groups,
    split_vertices,
    sum_normals,
    turn_faces,
    unit_normals,
    weld_points,
)


def slow_groups(corners: np.ndarray, normals: np.ndarray, cosine: float) -> list[int]:
    """Corners as nodes; consecutive faces at an edge, in the order of half edges, join theirs if they meet gently."""
    uses: dict[tuple[int, int], list[int]] = {}
    for half in range(corners.size):
        f, k = divmod(half, 3)
        p, q = int(corners[f, k]), int(corners[f, (k + 1) % 3])
        uses.setdefault((min(p, q), max(p, q)), []).append(half)
    near: dict[int, set[int]] = {c: {c} for c in range(corners.size)}
    for halves in uses.values():
        for a, b in pairwise(halves):
            if float(normals[a // 3] @ normals[b // 3]) < cosine:
                continue
            ends_a = [a, a - a % 3 + (a % 3 + 1) % 3]
            ends_b = [b, b - b % 3 + (b % 3 + 1) % 3]
            for c in ends_a:
                for d in ends_b:
                    if corners.reshape(-1)[c] == corners.reshape(-1)[d] and not (c % 3 == d % 3 and c == d):
                        near[c].add(d)
                        near[d].add(c)
    label = [-1] * corners.size
    for start in range(corners.size):
        waiting = [start] if label[start] < 0 else []
        while waiting:
            c = waiting.pop()
            if label[c] < 0:
                label[c] = start
                waiting += near[c]
    return label


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 12), st.integers(3, 9), st.integers(0, 2**32 - 1), st.floats(-1.0, 1.0))
def test_groups_against_a_search(faces: int, points: int, seed: int, cosine: float) -> None:
    rng = np.random.default_rng(seed)
    corners = np.stack([rng.permutation(points)[:3] for _ in range(faces)]).astype(np.int64)
    normals = rng.normal(size=(faces, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    group = np.empty(corners.size, np.int32)
    corner_groups(corners, normals, cosine, group)
    assert group.tolist() == slow_groups(corners, normals, cosine)
    # New vertices: one for each pair of vertex and group, ordered by vertex.
    new, source, label = np.empty_like(corners), np.empty(corners.size, np.int32), np.empty(corners.size, np.int32)
    count = split_vertices(corners, group, points, new, source, label)
    pairs = {(int(v), int(g)) for v, g in zip(corners.reshape(-1), group, strict=True)}
    assert count == len(pairs) and {(int(s), int(g)) for s, g in zip(source[:count], label[:count])} == pairs
    assert (np.diff(source[:count]) >= 0).all()
    np.testing.assert_array_equal(source[new], corners)
    np.testing.assert_array_equal(label[new.reshape(-1)], group)


def test_a_hub_of_many_edges() -> None:
    """More edges at one position than the table has places near it; each rim edge is that of two faces."""
    spokes = np.arange(1, 61)
    fan = np.stack([np.zeros(60, np.int64), spokes, np.roll(spokes, -1)], axis=1)
    corners = np.concatenate([fan, fan[:, ::-1] + np.array([0, 0, 61])])
    normals = np.random.default_rng(0).normal(size=(120, 3))
    group = np.empty(corners.size, np.int32)
    corner_groups(np.ascontiguousarray(corners), normals, 0.0, group)
    assert group.tolist() == slow_groups(corners, normals, 0.0)


@given(st.lists(st.tuples(*[st.integers(0, 3)] * 3), min_size=1, max_size=20))
@settings(deadline=None)
def test_faces_begin_at_their_smallest_corner(rows: list[tuple[int, int, int]]) -> None:
    turned = np.empty((len(rows), 3), np.int64)
    turn_faces(np.array(rows), turned)
    for row, found in zip(rows, turned.tolist(), strict=True):
        ways = [row[k:] + row[:k] for k in range(3)]
        assert tuple(found) in ways and found[0] == min(row)


@given(st.lists(st.tuples(*[st.sampled_from([0.0, 1.0, -1.0, 1e-300, 5.0])] * 3), min_size=1, max_size=40))
@settings(deadline=None)
def test_welding_against_a_dictionary(rows: list[tuple[float, float, float]]) -> None:
    bits = np.array(rows).view(np.int64).reshape(-1, 3)
    place, first = np.empty(len(rows), np.int64), np.empty(len(rows), np.int64)
    count = weld_points(bits, place, first)
    known: dict[tuple[float, float, float], int] = {}
    assert place.tolist() == [known.setdefault(r, len(known)) for r in rows]
    assert [rows[k] for k in first[:count]] == list(known)


def test_angles_weigh_the_normals() -> None:
    """A corner of a cube in three squares: one is cut in two triangles there, which must not count twice."""
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0]], float)
    corners = np.array([[0, 1, 4], [0, 4, 2], [0, 2, 3], [0, 3, 1]], np.int64)
    a, b, c = (points[corners[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    sums = np.zeros((12, 3))
    sum_normals(points, corners, normals, (np.arange(12) * (np.arange(12) % 3 != 0)).astype(np.int32), sums)
    np.testing.assert_allclose(sums[0], [math.pi / 2] * 3, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-200, 1e-30, 1.0, 1e30, 1e150]))
@settings(deadline=None)
def test_unit_normals_of_any_size(seed: int, scale: float) -> None:
    points = np.random.default_rng(seed).normal(size=(6, 3))
    corners = np.array([[0, 1, 2], [3, 4, 5], [0, 0, 1], [2, 2, 2]], np.int64)
    found = np.empty((4, 3))
    unit_normals(points * scale, corners, found)
    for k in range(2):
        a, b, c = points[corners[k]]
        cross = np.cross(b - a, c - a)
        np.testing.assert_allclose(found[k], cross / np.linalg.norm(cross), atol=1e-9)
    assert not found[2:].any()
