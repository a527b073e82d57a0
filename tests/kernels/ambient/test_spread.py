"""Values of few points for all pixels, beside a slow twin."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.ambient.spread import LEAST, REACH, Few, Many, spread_points


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
            beside = np.clip(REACH - abs(y - r), 0.0, 1.0) * np.clip(REACH - abs(x - c), 0.0, 1.0)
            if beside <= 0 or not few.normal[r, c].any():
                continue
            off = float((few.position[r, c] - here) @ normal) * near
            like = max(float(few.normal[r, c] @ normal), 0.0) * max(1.0 - off * off, 0.0)
            weight = beside * (like**4 + LEAST)
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


def test_a_pattern_leaves_no_dots_on_a_plane() -> None:
    """Sixteen points that differ by their number in the pattern: every pixel away from the border shows their mean."""
    side, step = 48, 3
    lens = np.array([40.0, 40.0, 24.0, 24.0], np.float32)
    depth, turn = np.full((side, side), 2.0, np.float32), np.eye(3, dtype=np.float32)
    facing = np.zeros((side, side, 3), np.float32)
    facing[..., 2] = -1.0
    at = np.arange(step // 2, side, step)
    x = (at + 0.5 - 24.0) / 40.0 * 2.0
    position = np.stack([*np.meshgrid(x, x), np.full((len(at), len(at)), 2.0)], axis=-1).astype(np.float32)
    pattern = np.random.default_rng(1).uniform(size=(4, 4)).astype(np.float32)
    values = np.tile(pattern, (len(at) // 4 + 1, len(at) // 4 + 1))[: len(at), : len(at), None].copy()
    found = np.zeros((side, side, 1), np.float32)
    few = Few(position, facing[step // 2 :: step, step // 2 :: step].copy(), values, step)
    spread_points(few, Many(depth, facing, turn, lens), found)
    np.testing.assert_allclose(found[9:-9, 9:-9, 0], pattern.mean(), atol=1e-5)


def test_a_face_of_one_point_is_not_as_dark_as_that_alone() -> None:
    """A stair's tread among risers: few rays found its only point hidden, where others saw half the sky."""
    side, step = 48, 4
    lens, turn = np.array([40.0, 40.0, 24.0, 24.0], np.float32), np.eye(3, dtype=np.float32)
    depth, normal = np.full((side, side), 2.0, np.float32), np.zeros((side, side, 3), np.float32)
    normal[..., 2] = -1.0
    normal[22:23, 20:25] = (0.0, -1.0, 0.0)
    at = np.arange(step // 2, side, step)
    x = (at + 0.5 - 24.0) / 40.0 * 2.0
    position = np.stack([*np.meshgrid(x, x), np.full((len(at), len(at)), 2.0)], axis=-1).astype(np.float32)
    own = normal[step // 2 :: step, step // 2 :: step].copy()
    hidden = own[..., 1] < 0.0
    assert hidden.sum() == 1
    values = np.where(hidden, 0.0, 0.5)[..., None].astype(np.float32)
    found = np.zeros((side, side, 1), np.float32)
    spread_points(Few(position, own, values, step), Many(depth, normal, turn, lens), found)
    assert 0.1 < found[22, 22, 0] < 0.3
    np.testing.assert_allclose(found[36, :, 0], 0.5, atol=0.01)
