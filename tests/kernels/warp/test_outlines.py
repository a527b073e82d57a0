"""Smooth outlines against a plain loop."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.warp.outlines import SHORTEST, blend_outlines, weigh_neighbours

CAMERA = np.array([[6.0, 0.0, 4.0, 0.0], [0.0, 6.0, 3.0, 0.0], [0.0, 0.0, 1.0, 0.0]])
SHAPE = (6, 8)


def end(corners: np.ndarray, place: np.ndarray, way: np.ndarray) -> float:
    """Where a triangle (3,2) ends on the way, by clipping the whole line at each of its sides."""
    low, high = -np.inf, np.inf
    middle = corners.mean(axis=0)
    for k in range(3):
        start, along = corners[k], corners[(k + 1) % 3] - corners[k]
        inward = np.array([-along[1], along[0]])
        inward *= np.sign(inward @ (middle - start))
        here, change = max(0.0, inward @ (place - start)), inward @ way
        if change < 0:
            high = min(high, here / -change)
        elif change > 0:
            low = max(low, -here / change)
    return 0.5 if high > 1 or high - low < SHORTEST else high


@pytest.mark.parametrize("seed", range(6))
def test_outlines_against_a_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = np.concatenate([rng.uniform(-1.2, 1.2, (12, 2)), rng.uniform(0.8, 2.0, (12, 1))], axis=1)
    vertices[0, 2] = -1.0  # behind the eye
    faces = np.arange(12, dtype=np.int32).reshape(4, 3)
    triangle = np.repeat(np.repeat(rng.integers(-1, 4, (3, 4)), 2, axis=0), 2, axis=1)
    depth = np.where(triangle >= 0, rng.choice([1.0, 1.5, 3.0], SHAPE), np.inf).astype(np.float32)
    owner = np.where(triangle >= 0, triangle // 2, -1)
    light, out = rng.random((*SHAPE, 3)).astype(np.float32), np.zeros((*SHAPE, 3), np.float32)
    blend_outlines((depth, triangle, owner), (vertices, faces), CAMERA, light, out)
    changed = 0
    for at in np.ndindex(SHAPE):
        best, other = 0.0, at
        for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            beside = (at[0] + step[0], at[1] + step[1])
            if not (0 <= beside[0] < SHAPE[0] and 0 <= beside[1] < SHAPE[1]) or owner[beside] == owner[at]:
                continue
            front, back = (at, beside) if depth[at] <= depth[beside] else (beside, at)
            if triangle[front] < 0:
                continue
            corners = vertices[faces[triangle[front]]]
            reach = 0.5
            if (corners[:, 2] > 0).all():
                seen = (corners @ CAMERA[:, :3].T)[:, :2] / corners[:, 2:]
                place, there = (np.array([p[1] + 0.5, p[0] + 0.5]) for p in (front, back))
                reach = end(seen, place, there - place)
            share = 0.5 - reach if front == at else reach - 0.5
            if share > best:
                best, other = share, beside
        changed += best > 0
        assert np.allclose(out[at], light[at] + best * (light[other] - light[at]), atol=1e-5)
    assert changed


@pytest.mark.parametrize("seed", range(3))
def test_neighbours_against_a_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    owner = np.repeat(rng.integers(-1, 2, (3, 8)), 2, axis=0)
    light, out = rng.random((*SHAPE, 3)).astype(np.float32), np.zeros((*SHAPE, 3), np.float32)
    weights = rng.random((3, 3)).astype(np.float32)
    weights /= weights.sum()
    weigh_neighbours(owner, weights, light, out)
    for j, i in np.ndindex(SHAPE):
        expected = np.zeros(3)
        for dj, di in np.ndindex(3, 3):
            r, c = j + dj - 1, i + di - 1
            inside = 0 <= r < SHAPE[0] and 0 <= c < SHAPE[1]
            expected += weights[dj, di] * light[(r, c) if inside and owner[r, c] == owner[j, i] else (j, i)]
        assert np.allclose(out[j, i], expected, atol=1e-6)
