"""One triangle added to the count of a row, pixel by pixel."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.raster.count_layers import count_row, is_needed
from torchrender.kernels.raster.records import Nearer, Stored


def test_a_row_against_a_loop() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = 9
        base, step = rng.uniform(0.2, 0.6), rng.normal(0, 0.02)
        low, high, far = 0.15, 0.55, 5.0
        z = [np.float32(1.0 / min(max(base + step * x, low), high)) for x in range(n)]
        depth = np.where(rng.random(n) < 0.5, z, rng.uniform(1, 8, n)).astype(np.float32)  # often equal depths
        depth[0] = np.inf
        triangle = rng.integers(0, 9, n)
        found = Nearer(np.zeros(n, np.int32), np.zeros(n, np.bool_))
        relative, absolute = 0.1, 0.05
        count_row(4, (base, step, low, high), (relative, absolute, far), Stored(depth, triangle), found)
        nearer = [
            z[x] <= far and (z[x] < depth[x] or (z[x] == depth[x] and triangle[x] > 4)) for x in range(n)
        ]  # of equal depths the lower id is in front
        np.testing.assert_array_equal(found.number, nearer)
        touching = [ok and float(z[x]) * 1.1 + 0.05 >= float(depth[x]) for x, ok in enumerate(nearer)]
        np.testing.assert_array_equal(found.touching, touching)


def test_a_tile_that_asks_for_nothing_is_not_needed() -> None:
    depth = np.zeros((6, 7), np.float32)
    depth[2, 3] = 1.0
    for top in range(6):
        for left in range(7):
            assert is_needed(depth, left, top, 6, 5) == (top <= 2 and left <= 3)
            assert is_needed(depth, 0, 0, left, top) == (top >= 2 and left >= 3)
