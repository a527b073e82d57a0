"""Hits in holes, hit by hit."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.raster.records import Holes
from torchrender.kernels.rays.ray_holes import hits_in_holes


def test_hits_against_a_loop() -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 2, (4, 4)).astype(np.uint8)
    uv = np.array([[0, 0], [1, 0], [0, 1], [1, 1]], np.float32)
    faces = np.array([[0, 1, 2], [3, 2, 1], [0, 1, 2]], np.int32)
    holes = Holes(np.array([0, 0, -1], np.int32), np.array([[0, 4, 4]]), picture.reshape(-1), uv)
    triangle, weights = rng.integers(-1, 3, 300), rng.dirichlet(np.ones(3), 300)[:, 1:].astype(np.float32)
    out = np.ones(300, np.bool_)
    hits_in_holes(triangle, weights, faces, holes, out)
    for k in range(300):
        wanted = False
        if triangle[k] in (0, 1):
            shares = np.array([1 - weights[k].sum(dtype=float), *weights[k].astype(float)])
            s, r = shares @ uv[faces[triangle[k]]]
            wanted = picture[int((1 - r) * 4), int(s * 4)] == 0
        assert out[k] == wanted
    assert 0 < out.sum() < 300
