"""Quads of a few pixels, drawn by the row, against the rule for one triangle in Python's integers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND
from torchrender.kernels.warp.quads.small_quads import HALF, SUBPIXEL
from torchrender.kernels.warp.warp import Canvas, Poses, Quads, draw_quads, key_of, nearest_first

SIZE = (40, 36)


def draw_triangle(corners: list[tuple[int, int, float]], number: int, keys: np.ndarray) -> None:
    """Every pixel of the picture against one triangle of snapped corners."""
    (ax, ay, qa), (bx, by, qb), (cx, cy, qc) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area <= 0:
        return
    xs, ys = (ax, bx, cx), (ay, by, cy)
    for v in range(max(min(ys) // SUBPIXEL, 0), min(max(ys) // SUBPIXEL + 1, SIZE[1])):
        for u in range(max(min(xs) // SUBPIXEL, 0), min(max(xs) // SUBPIXEL + 1, SIZE[0])):
            p = (u * SUBPIXEL + HALF, v * SUBPIXEL + HALF)
            f = []
            for (mx, my), (nx, ny) in (((bx, by), (cx, cy)), ((cx, cy), (ax, ay)), ((ax, ay), (bx, by))):
                dx, dy = nx - mx, ny - my
                owns = dy > 0 or (dy == 0 and dx < 0)
                f.append(dx * (p[1] - my) - dy * (p[0] - mx) - (0 if owns else 1))
            if min(f) >= 0:
                q = (f[0] * qa + f[1] * qb + (area - f[0] - f[1]) * qc) * (1.0 / area)
                place = v * SIZE[0] + u
                keys[place] = max(keys[place], key_of(q, number))


def twin(corners: np.ndarray, shape: np.ndarray, matrices: np.ndarray, bias: np.ndarray) -> np.ndarray:
    keys = np.zeros(SIZE[0] * SIZE[1], np.uint64)
    count, rows, _, columns = corners.shape
    for b, j, i in np.ndindex(count, rows, columns):
        bits = int(shape[b, j, i])
        at = []
        for k, (du, dv) in enumerate(((0, 0), (0, 1), (1, 1), (1, 0))):
            z, m = float(corners[b, j, k, i]), matrices[b]
            x, y, w = (z * (m[r, 0] * (i + du) + (m[r, 1] * (j + dv) + m[r, 2])) + m[r, 3] for r in range(3))
            x, y = (math.floor(c * (1.0 / w) * SUBPIXEL + 0.5) for c in (x, y))
            at.append((x, y, 1.0 / w * bias[b]))
        a, c1, c, d = at[1:] + at[:1] if bits & DIAGONAL else at
        if bits & FIRST:
            draw_triangle([a, c, c1], (b * rows + j) * columns + i, keys)
        if bits & SECOND:
            draw_triangle([c, a, d], (b * rows + j) * columns + i, keys)
    return keys


@pytest.mark.parametrize("scale", [0.4, 1.0, 1.0 + 2**-12, 2.3, 5.0])
def test_quads_of_every_size_equal_exact_integers(scale: float) -> None:
    """From below a pixel to more than small ones have, in two images, shifted by sub-pixels that give ties."""
    rng = np.random.default_rng(int(10 * scale))
    corners = (3.0 + rng.choice([0.0, 0.0, 0.02, 0.4], (2, 7, 4, 13))).astype(np.float32)
    shape = rng.choice(
        np.array([0, FIRST, SECOND, FIRST | SECOND, 7], np.uint8), (2, 7, 13), p=[0.1, 0.1, 0.1, 0.3, 0.4]
    )
    matrices = np.zeros((2, 3, 4))
    matrices[:, 0, 0] = matrices[:, 1, 1] = scale
    matrices[:, 2, 2] = 1.0
    matrices[:, 0, 2], matrices[:, 1, 2] = 3.5, 2.5
    matrices[1, 0, 3], matrices[1, 1, 3], matrices[1, 2, 3] = 1.7, -0.3, 0.05
    bias = np.array([0.999, 1.0])
    keys = np.zeros(SIZE[0] * SIZE[1], np.uint64)
    draw_quads(Quads(corners, shape, 0.0), Poses(matrices, 0.01, bias), 2, Canvas(keys, *SIZE))
    wanted = twin(corners, shape, matrices, bias)
    assert (wanted > 0).sum() > 5
    np.testing.assert_array_equal(keys, wanted)


def test_quads_behind_what_is_drawn_change_nothing() -> None:
    """What is there before is kept wherever it is nearer, at the first pixel of a box and at the others."""
    corners, shape = np.full((1, 6, 4, 6), 3.0, np.float32), np.full((1, 6, 6), FIRST | SECOND, np.uint8)
    matrix = np.zeros((1, 3, 4))
    matrix[0, :, :3] = np.diag([1.6, 1.6, 1.0])
    keys = np.zeros(SIZE[0] * SIZE[1], np.uint64)
    before = np.full(len(keys), key_of(1.0 / 2.0, 99), np.uint64)
    before[::3] = key_of(1.0 / 4.0, 99)
    keys[:] = before
    draw_quads(Quads(corners, shape, 0.0), Poses(matrix, 0.01, np.ones(1)), 1, Canvas(keys, *SIZE))
    drawn = (keys != before).reshape(SIZE[::-1])
    assert not (keys != before)[np.arange(len(keys)) % 3 != 0].any()
    assert drawn[:9, :9].sum() == 9 * 9 // 3 and not drawn[10:].any()


def test_images_go_by_their_factor() -> None:
    assert nearest_first(np.array([0.9, 1.0, 0.9, 0.95])).tolist() == [1, 3, 0, 2]
