"""Values of few points for all pixels, beside a slow twin."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.ambient.spread import REACH, Few, Many, spread_points


def twin(few: Few, many: Many, out: np.ndarray) -> None:
    fx, fy, cx, cy = many.lens
    for j, i in np.ndindex(many.depth.shape):
        z = many.depth[j, i]
        if np.isinf(z):
            continue
        here = np.array([(i + 0.5 - cx) / fx * z, (j + 0.5 - cy) / fy * z, z])
        normal = many.turn @ many.normal[j, i]
        near = 1.0 / (z * 1.5 * few.step / fx)
        y, x = (j - few.step // 2) / few.step, (i - few.step // 2) / few.step
        total, weights = np.zeros(few.values.shape[2]), 0.0
        for r, c in np.ndindex(few.normal.shape[:2]):
            beside = max(REACH - abs(y - r), 0.0) * max(REACH - abs(x - c), 0.0)
            if beside <= 0 or not few.normal[r, c].any():
                continue
            off = float((few.position[r, c] - here) @ normal) * near
            like = max(float(few.normal[r, c] @ normal), 0.0) * max(1.0 - off * off, 0.0)
            weight = beside * (like**4 + 1e-6)
            total += weight * few.values[r, c]
            weights += weight
        if weights > 0:
            out[j, i] = total / weights


def test_pixels_follow_points_of_their_own_plane() -> None:
    rng = np.random.default_rng(5)
    height, width, step = 11, 14, 3
    lens = np.array([20.0, 21.0, 7.2, 5.1], np.float32)
    depth = rng.uniform(4.0, 5.0, (height, width)).astype(np.float32)
    depth[2, 3] = np.inf
    normal = rng.normal(size=(height, width, 3))
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0].astype(np.float32)
    rows, columns = len(range(step // 2, height, step)), len(range(step // 2, width, step))
    own = rng.normal(size=(rows, columns, 3)).astype(np.float32)
    own /= np.linalg.norm(own, axis=-1, keepdims=True)
    own[1, 1] = 0.0
    position = rng.uniform(-1.0, 1.0, (rows, columns, 3)).astype(np.float32) + np.array([0, 0, 4.5], np.float32)
    few = Few(position, own, rng.uniform(size=(rows, columns, 2)).astype(np.float32), step)
    many = Many(depth, normal, turn, lens)
    found = np.full((height, width, 2), 7.0, np.float32)
    expected = found.copy()
    spread_points(few, many, found)
    twin(few, many, expected)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=1e-4)
    assert (found[2, 3] == 7.0).all()
