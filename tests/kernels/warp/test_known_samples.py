"""What another depth image holds, against a slow twin."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.kernels.warp.known_samples import find_known
from torchrender.raster import rasterize_visibility
from torchrender.reconstruct.reproject import pixel_matrices
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load

TOLERANCE = 2e-3


def slow(seen, other) -> np.ndarray:
    """Every sample by itself, through world space."""
    height, width = seen.depth.shape[1:]
    known = np.zeros((height, width), bool)
    points = seen.cameras.unproject(seen.cameras.pixel_centres(), seen.depth)[0]
    for j in range(height):
        for i in range(width):
            if not bool(seen.covered[0, j, i]):
                continue
            pixel, z = other.cameras.project(points[j, i][None, None])
            x, y, z = float(pixel[0, 0, 0]) - 0.5, float(pixel[0, 0, 1]) - 0.5, float(z[0, 0])
            rows, columns = other.depth.shape[1:]
            if not (z > 0 and -0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
                continue
            corners = [(int(np.floor(y)) + a, int(np.floor(x)) + b) for a in (0, 1) for b in (0, 1)]
            corners = [(a, b) for a, b in corners if 0 <= a < rows and 0 <= b < columns]
            same = any(int(other.triangle[0, a, b]) == int(seen.triangle[0, j, i]) for a, b in corners)
            inverse = [1.0 / float(other.depth[0, a, b]) for a, b in corners]
            known[j, i] = same or min(inverse) * (1 - TOLERANCE) <= 1 / z <= max(inverse) * (1 + TOLERANCE)
    return known


def test_known_samples_are_those_of_the_slow_twin():
    scene = load("cornell_box")
    eyes = ((0.278, 0.273, -0.8), (0.38, 0.3, -0.75))
    target = (0.278, 0.25, 0.2)
    views = [Cameras.look_at(eye, target, width=40, height=28, fov_deg=40.0) for eye in eyes]
    other, seen = (rasterize_visibility(scene.geometry, view) for view in views)
    known = np.zeros((28, 40), bool)
    matrix = pixel_matrices(seen.cameras, other.cameras)[0]
    arrays = [t[0].numpy() for t in (other.depth, other.triangle)]
    find_known(seen.depth[0].numpy(), seen.triangle[0].numpy(), matrix, *arrays, TOLERANCE, known)
    wanted = slow(seen, other)
    assert 0.5 < wanted.mean() < 0.99
    assert np.array_equal(known, wanted)


def test_marks_stay_and_empty_pixels_are_not_known():
    depth = np.array([[1.0, np.inf, 2.0]], np.float32)
    ids = np.array([[0, -1, 1]])
    known = np.array([[False, False, True]])
    matrix = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    far, none = np.full((1, 3), 50.0, np.float32), np.full((1, 3), 7)
    find_known(depth, ids, matrix, far, none, TOLERANCE, known)
    assert known.tolist() == [[False, False, True]]
    assert torch.isinf(torch.from_numpy(depth))[0, 1]


def test_what_lies_behind_the_other_camera_is_not_in_its_picture():
    """Lines through its eye meet the picture's plane: on the wrong side."""
    depth, ids = np.full((2, 3), 2.0, np.float32), np.arange(6).reshape(2, 3)
    for side, held in ((1.0, True), (-1.0, False), (0.0, False)):
        matrix = np.concatenate([side * np.eye(3), np.zeros((3, 1))], axis=1)
        known = np.zeros((2, 3), bool)
        find_known(depth, ids, matrix, depth, ids, TOLERANCE, known)
        assert bool((known == held).all())
