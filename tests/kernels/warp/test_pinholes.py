"""Pinholes against a loop over lists of lines."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.warp.pinholes import close

LINES = ((-1, 0), (0, -1), (-1, -1), (-1, 1))


def twin(color: np.ndarray, depth: np.ndarray, valid: np.ndarray, source: np.ndarray, limits: tuple) -> list:
    """Every pixel from what was there before."""
    before = [a.copy() for a in (color, depth, valid, source)]
    result = [a.copy() for a in before]
    for y in range(1, depth.shape[0] - 1):
        for x in range(1, depth.shape[1] - 1):
            ends = [((y + j, x + i), (y - j, x - i)) for j, i in LINES]
            ends = [(a, b) for a, b in ends if before[2][a] and before[2][b]]
            depths = [(float(before[1][a]), float(before[1][b])) for a, b in ends]
            kept = [k for k, (p, q) in enumerate(depths) if abs(p - q) <= limits[0] * min(p, q)]
            if before[2][y, x] or len(kept) < 2:
                continue
            inverse = [0.5 / depths[k][0] + 0.5 / depths[k][1] for k in kept]
            mean = sum(inverse) / len(kept)
            if max(abs(one - mean) for one in inverse) > limits[1] * mean:
                continue
            colors = [0.5 * (before[0][ends[k][0]].astype(float) + before[0][ends[k][1]]) for k in kept]
            result[0][y, x], result[1][y, x] = np.mean(colors, axis=0), 1.0 / mean
            result[2][y, x], result[3][y, x] = True, before[3][ends[kept[0]][0]]
    return result


def test_pinholes_equal_the_slow_twin() -> None:
    rng = np.random.default_rng(1)
    depth = (5.0 + rng.choice([0.0, 0.0, 0.02, 0.5], (23, 31))).astype(np.float32)
    valid = rng.random(depth.shape) > 0.3
    depth[~valid] = np.inf
    color = rng.random((*depth.shape, 3)).astype(np.float32) * valid[..., None]
    source = np.where(valid, rng.integers(0, 3, depth.shape), -1)
    limits = (0.05, 0.01)
    wanted = twin(color, depth, valid, source, limits)
    missing = np.count_nonzero(~valid)
    counts = close(color, depth, valid, source, 2, limits)
    assert 20 < int(counts.sum()) < missing and int(counts.sum()) == missing - np.count_nonzero(~valid)
    for found, expected in zip((color, depth, valid, source), wanted, strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-6)
