"""Keys of a warp to depth, validity and colour, pixel by pixel."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.warp.resolve import resolve
from torchrender.kernels.warp.warp import key_of

ALL = 1 << 8  # the four pixels around a corner share one vertex


@pytest.mark.parametrize("smooth", [False, True])
def test_pixels_against_a_loop(smooth: bool) -> None:
    rng = np.random.default_rng(int(smooth))
    count, rows, columns = 2, 6, 7
    size = (9, 8)
    colors, bias = rng.random((count, rows, columns, 3)).astype(np.float32), np.array([1.0, 0.99])
    joined = np.full((count, rows + 1, columns + 1), ALL, np.int32)
    apart = rng.random(joined.shape) < 0.4  # pixels 0 and 3 (below the corner) on one surface, 1 and 2 on another
    joined[apart] = 0 | (1 << 2) | (1 << 4) | (0 << 6) | (1 << 8) | (1 << 9)
    back = np.zeros((count, 3, 4))
    back[:, 0, 0], back[:, 1, 1], back[:, 2, 2] = columns / size[0], rows / size[1], 1.0
    back[1, 0, 3] = 0.1
    keys, owner, depths = np.zeros(size[0] * size[1], np.uint64), {}, {}
    for y, x in np.ndindex(size[1], size[0]):
        if rng.random() < 0.1:
            continue
        b, z = int(rng.integers(0, 2)), rng.uniform(0.5, 6)
        u, v = x + 0.5, y + 0.5
        i, j = (int(c) for c in ((z * back[b, 0, 0] * u + back[b, 0, 3]) / z, back[b, 1, 1] * v))
        i, j = min(i, columns - 1), min(j, rows - 1)
        keys[y * size[0] + x] = key_of(bias[b] / z, (b * rows + j) * columns + i)
        owner[y, x], depths[y, x] = (b, j, i), z
    out = (
        np.zeros((*size[::-1], 3), np.float32), np.zeros(size[::-1], np.float32), np.zeros(size[::-1], np.bool_),
        np.zeros(size[::-1], np.int64),
    )  # fmt: skip
    resolve(keys, (rows, columns, joined, False), back, bias, (1.0, 5.0), colors, smooth, out)
    color, depth, valid, source = out
    assert 30 < valid.sum() < 60
    for y, x in np.ndindex(size[::-1]):
        known = (y, x) in owner and 1.0 <= depths[y, x] <= 5.0
        assert valid[y, x] == known
        if not known:
            assert depth[y, x] == np.inf and source[y, x] == -1 and not color[y, x].any()
            continue
        (b, j, i), z = owner[y, x], depths[y, x]
        assert source[y, x] == b and depth[y, x] == pytest.approx(z, rel=1e-6)
        if not smooth:
            np.testing.assert_array_equal(color[y, x], colors[b, j, i])
            continue
        zz = float(depth[y, x])
        u = (zz * back[b, 0, 0] * (x + 0.5) + back[b, 0, 3]) / zz
        v = back[b, 1, 1] * (y + 0.5)
        u, v = min(max(u, i), i + 1), min(max(v, j), j + 1)
        row, column = j + (v - j >= 0.5), i + (u - i >= 0.5)  # the corner that is nearest
        pixels = ((row, column), (row - 1, column), (row - 1, column - 1), (row, column - 1))
        own = pixels.index((j, i))
        word = int(joined[b, row, column])
        a, c = u - (column - 0.5), v - (row - 0.5)
        shares = (a * c, a * (1 - c), (1 - a) * (1 - c), (1 - a) * c)
        total, mixed = 0.0, np.zeros(3)
        for k, share in enumerate(shares):
            inside = 0 <= pixels[k][0] < rows and 0 <= pixels[k][1] < columns
            if (word >> (2 * k)) & 3 == (word >> (2 * own)) & 3 and inside:
                total, mixed = total + share, mixed + share * colors[(b, *pixels[k])]
        if not all(0 <= p[0] < rows and 0 <= p[1] < columns for p in pixels):
            continue  # at the border the groups hold pixels that are not there
        np.testing.assert_allclose(color[y, x], mixed / total, rtol=1e-4)
