"""The triangle test one by one and four at a time."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from torchrender.kernels.rays.boxes import IDS, LINE, WIDE
from torchrender.kernels.rays.watertight import hit_triangle, row_length, shear_of
from torchrender.kernels.rays.wide_test import edges_around


@njit
def bits_of(packed, x, y, z, origin, slope):
    return edges_around(packed.ctypes.data, x, y, z, origin, slope)


def test_four_at_a_time_is_one_by_one() -> None:
    rng = np.random.default_rng(0)
    seen = np.zeros(2, int)
    for _ in range(400):
        line = np.zeros(LINE)
        corners = rng.standard_normal((WIDE, 3, 3))
        corners[1, 2] = corners[0, 2]  # shared corners and edges: rays below aim at them
        line[:IDS] = corners.transpose(1, 2, 0).reshape(-1)
        o = rng.standard_normal((1, 3))
        d = corners[0, 2:3] - o if rng.random() < 0.3 else rng.standard_normal((1, 3))
        x, y, z, *rest = shear_of(o, d, 0, 1.0)
        bits = bits_of(line, WIDE * x, WIDE * y, WIDE * z, tuple(rest[:3]), tuple(rest[3:5]))
        for q in range(WIDE):
            flat = corners[q].reshape(-1)
            det = hit_triangle(flat, 0, 3, 6, (x, y, z, *rest))[0]
            # A triangle seen from its edge has no determinant but edges that go round.
            assert bool(bits >> q & 1) or det == 0
            assert det != 0 or not bits >> q & 1 or edge_on(flat, o[0], d[0])
            seen[int(det != 0)] += 1
    assert seen.min() > 100


def edge_on(flat: np.ndarray, o: np.ndarray, d: np.ndarray) -> bool:
    a, b, c = flat.reshape(3, 3) - o
    return abs(np.dot(np.cross(b - a, c - a), d)) < 1e-12


def test_hits_equal_the_solved_equation() -> None:
    """o + t d = a + u (b - a) + v (c - a)."""
    rng = np.random.default_rng(1)
    for _ in range(300):
        corners, weights = rng.standard_normal((3, 3)), rng.dirichlet([1.0] * 3)
        o = rng.standard_normal((1, 3))
        d = (weights @ corners - o[0])[None] * rng.uniform(0.1, 10)
        det, t, b, c = hit_triangle(corners.reshape(-1), 0, 3, 6, shear_of(o, d, 0, 1.0))
        edges = np.stack([corners[1] - corners[0], corners[2] - corners[0], -d[0]], 1)
        u, v, wanted = np.linalg.solve(edges, o[0] - corners[0])
        np.testing.assert_allclose((t, b, c), (wanted, u, v), rtol=1e-7, atol=1e-9)
        assert (det > 0) == (np.dot(np.cross(edges[:, 0], edges[:, 1]), d[0]) < 0)


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1.0, 1e160, 1e300])
def test_lengths_neither_overflow_nor_underflow(size: float) -> None:
    d = size * np.array([[2.0, -3.0, 6.0], [0.0, 0.0, 0.0]])
    assert row_length(d, 0) == pytest.approx(7 * size, rel=1e-14)
    assert row_length(d, 1) == 0
