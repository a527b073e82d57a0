"""The sum over blocks of the sky beside its slow twin."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.sky.irradiance import SPAN, facing_sum


def twin(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    total = np.zeros((normals.shape[1], 3))
    for n in range(normals.shape[1]):
        for c in range(3):
            for k in range(vectors.shape[2]):
                total[n, c] += max(0.0, float(np.dot(vectors[c, :, k], normals[:, n])))
    return total


@pytest.mark.parametrize("count", [1, SPAN, SPAN + 3])
@pytest.mark.parametrize("blocks", [0, 1, 7])
def test_it_sums_what_faces_each_normal(count: int, blocks: int) -> None:
    rng = np.random.default_rng(3)
    vectors = rng.normal(size=(3, 3, blocks)).astype(np.float32)
    normals = rng.normal(size=(3, count)).astype(np.float32)
    total = np.full((count, 3), np.nan, np.float32)
    facing_sum(vectors, normals, total)
    np.testing.assert_allclose(total, twin(vectors, normals), rtol=1e-5, atol=1e-5)
