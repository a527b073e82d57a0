"""Colours of few pixels for many, weight by weight."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.warp.joint_upsampling import spread_colors


@pytest.mark.parametrize(("seed", "channels"), [(0, 3), (1, 6), (2, 1)])
def test_against_a_loop(seed: int, channels: int) -> None:
    rng = np.random.default_rng(seed)
    (h, w), (rows, columns), limits = (7, 9), (4, 5), (0.05, 1e-3, 1e-6)

    def pixels(height: int, width: int):
        triangle = rng.integers(-1, 3, (height, width))
        depth = np.where(triangle >= 0, rng.choice([1.0, 1.02, 3.0], (height, width)), np.inf).astype(np.float32)
        owner = np.where(triangle >= 0, triangle // 2, -1) + 10 * (rng.random((height, width)) < 0.2)
        return depth, triangle, owner  # one object by several names: other things lie before it

    few, many = pixels(rows, columns), pixels(h, w)
    colors, materials = rng.random((rows, columns, channels)).astype(np.float32), np.array([0, 1, 1])
    out = np.zeros((h, w, channels), np.float32)
    wanted = rng.random((h, w)) < 0.8
    spread_colors(colors, few, many, materials, limits, wanted, out)
    widened = 0
    for j, i in np.ndindex(h, w):
        if not wanted[j, i]:
            assert not out[j, i].any()
            continue
        y, x = (j + 0.5) * rows / h - 0.5, (i + 0.5) * columns / w - 0.5
        near, face = 1.0 / float(many[0][j, i]), many[1][j, i]
        for reach in (1, 2):
            total, weights, likeness = np.zeros(channels), 0.0, 0.0
            for row in range(math.floor(y) + 1 - reach, math.floor(y) + 1 + reach):
                for column in range(math.floor(x) + 1 - reach, math.floor(x) + 1 + reach):
                    at = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                    other, seen = 1.0 / float(few[0][at]), few[1][at]
                    like = math.exp(-((abs(near - other) / max(near, other, 1e-30) / limits[0]) ** 2))
                    one_kind = seen >= 0 and face >= 0 and materials[seen] == materials[face]
                    one_surface = few[2][at] == many[2][j, i] and (seen == face or one_kind)
                    like *= 1.0 if one_surface else limits[1]
                    tent = (reach - abs(y - row)) * (reach - abs(x - column))
                    likeness += tent * like
                    weights += tent * (like + limits[2])
                    total += tent * (like + limits[2]) * colors[at]
            if likeness > limits[1] * reach**4:
                break
            widened += reach == 1
        np.testing.assert_allclose(out[j, i], total / weights, rtol=1e-5)
    assert widened > 3
