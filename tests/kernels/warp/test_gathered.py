"""Samples placed into a view, against a plain loop."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.warp.gathered import place_samples

CAMERA = np.array([[6.0, 0.0, 4.5, 0.1], [0.0, 6.0, 3.5, -0.1], [0.0, 0.0, 1.0, 0.05]])
MATERIALS, OBJECTS = np.array([0, 0, 1, 0]), np.array([0, 0, 0, 1])
SHAPE, SAME = (7, 9), 0.05


@pytest.mark.parametrize("seed", range(4))
def test_samples_against_a_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangle = np.repeat(np.repeat(rng.integers(-1, 4, (4, 5)), 2, axis=0)[:7], 2, axis=1)[:, :9]
    depth = np.where(triangle >= 0, rng.choice([1.0, 2.0], SHAPE), np.inf).astype(np.float32)
    owner = np.where(triangle >= 0, OBJECTS[triangle] + 10 * rng.integers(0, 2, SHAPE), -1)
    z = rng.choice([-1.0, 0.95, 1.0, 1.95], 300)
    points = np.stack([rng.uniform(-0.9, 0.9, 300) * z, rng.uniform(-0.7, 0.7, 300) * z, z], axis=1)
    faces, light = rng.integers(0, 4, 300), rng.random((300, 3)).astype(np.float32)
    owners = OBJECTS[faces] + 10 * rng.integers(0, 2, 300)  # one object by several names: other things lie before it
    wanted, out = rng.random(SHAPE) < 0.8, np.zeros((*SHAPE, 3), np.float32)
    expected, left = out.copy(), wanted.copy()
    for point, face, name, color in zip(points, faces, owners, light, strict=True):  # later ones replace earlier ones
        place = CAMERA[:, :3] @ point + CAMERA[:, 3]
        if place[2] <= 0:
            continue
        i, j = (int(np.floor(v)) for v in place[:2] / place[2])
        if not (0 <= j < SHAPE[0] and 0 <= i < SHAPE[1] and wanted[j, i] and triangle[j, i] >= 0):
            continue
        own = triangle[j, i]
        if name != owner[j, i]:
            continue
        alike = MATERIALS[own] == MATERIALS[face]
        inverse = (1 / place[2], 1 / depth[j, i])
        near = abs(inverse[0] - inverse[1]) <= SAME * max(inverse)
        if own == face or (alike and near):
            expected[j, i], left[j, i] = color, False
    seen = (depth, triangle, owner)
    place_samples((points, faces, owners, light), CAMERA, seen, MATERIALS, SAME, wanted, out)
    assert np.array_equal(wanted, left) and np.allclose(out, expected)
    assert left.any() and expected.any()
