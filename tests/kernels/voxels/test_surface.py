"""Cells that triangles meet, against clipping every triangle by every cell; dominant axes; marked words; windings."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from torchrender.kernels.voxels.cells import Soup, cell_number
from torchrender.kernels.voxels.surface import classify, mark_surface
from torchrender.kernels.voxels.winding import FAR, gather_clusters, winding_slice

DIMS = (7, 5, 6)


def clipped(corners: np.ndarray, low: np.ndarray, high: np.ndarray) -> int:
    """Corners that are left of a triangle after six planes."""
    polygon = list(corners)
    for axis, (sign, limit) in itertools.product(range(3), ((1.0, 0), (-1.0, 1))):
        bound = sign * (low, high)[limit][axis]
        kept = []
        for k, here in enumerate(polygon):
            there = polygon[(k + 1) % len(polygon)]
            a, b = sign * here[axis] - bound, sign * there[axis] - bound
            if a >= 0:
                kept.append(here)
            if (a > 0 > b) or (a < 0 < b):
                kept.append(here + a / (a - b) * (there - here))
        polygon = kept
    return len(polygon)


def marked(vertices: np.ndarray, faces: np.ndarray, thin: bool) -> tuple[np.ndarray, np.ndarray]:
    soup = Soup(vertices, faces, np.array([-1.0, 0.5, 2.0]), 2.0, np.array([*DIMS, 64]), thin)
    words, tally = np.zeros(DIMS[2] * DIMS[1], np.uint64), np.zeros(3, np.int64)
    mark_surface(soup, 6 * 64 + 64, 2, words, tally)
    bits = np.unpackbits(words.view(np.uint8), bitorder="little").reshape(DIMS[2], DIMS[1], 64)
    assert not bits[:, :, DIMS[0] :].any()
    return bits[:, :, : DIMS[0]].astype(bool), tally


@pytest.mark.parametrize("size", [0.3, 1.0, 4.0])
def test_closed_boxes_against_clipping(size: float) -> None:
    rng = np.random.default_rng(int(10 * size))
    centre = rng.uniform(-1, 7, (25, 1, 3))
    cells = (centre + rng.normal(0, size, (25, 3, 3))).reshape(-1, 3)
    faces = np.arange(75, dtype=np.int32).reshape(25, 3)
    faces[24] = faces[24, 0]
    bits, tally = marked(cells / 2.0 + [-1.0, 0.5, 2.0], faces, False)
    wanted, pairs = np.zeros(DIMS[::-1], bool), 0
    for t in faces[:24]:
        for k, j, i in np.ndindex(DIMS[::-1]):
            low = np.array([i, j, k], float)
            met = clipped(cells[t], low, low + 1) > 0
            wanted[k, j, i] |= met
            pairs += met
    np.testing.assert_array_equal(bits, wanted)
    assert tally[1:].tolist() == [pairs, 1]


def test_thin_cells_are_those_at_the_centres_of_columns() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        cells = rng.uniform(-1, 8, (3, 3))
        bits, _ = marked(cells / 2.0 + [-1.0, 0.5, 2.0], np.array([[0, 1, 2]], np.int32), True)
        normal = np.cross(cells[1] - cells[0], cells[2] - cells[0])
        axis = int(np.abs(normal).argmax())
        u, v = (axis + 1) % 3, (axis + 2) % 3
        wanted = np.zeros(DIMS[::-1], bool)
        for a, b in itertools.product(range(DIMS[u]), range(DIMS[v])):
            matrix = np.stack([cells[1] - cells[0], cells[2] - cells[0]], axis=1)[[u, v]]
            s, t = np.linalg.solve(matrix, np.array([a + 0.5, b + 0.5]) - cells[0, [u, v]])
            if s < 0 or t < 0 or s + t > 1:
                continue
            at = (cells[0] + s * (cells[1] - cells[0]) + t * (cells[2] - cells[0]))[axis]
            if 0 <= at < DIMS[axis]:
                place = [0, 0, 0]
                place[axis], place[u], place[v] = int(at), a, b
                wanted[place[2], place[1], place[0]] = True
        np.testing.assert_array_equal(bits, wanted)


def test_dominant_axes_and_numbers() -> None:
    rng = np.random.default_rng(4)
    vertices, faces = rng.normal(size=(60, 3)), rng.integers(0, 60, (90, 3)).astype(np.int32)
    vertices[:4] = [[0, 0, 0], [1, 0, 1], [0, 1, 1], [1, 1, 0]]
    faces[:2] = [[0, 1, 2], [0, 0, 1]]  # a tie, which the lowest axis wins; no area
    axes = np.zeros(90, np.int8)
    classify(vertices, faces, axes)
    for t, (a, b, c) in enumerate(vertices[faces]):
        normal = np.abs(np.cross(b - a, c - a))
        assert axes[t] == (normal.argmax() if normal.any() else -1)
    dims = np.array([*DIMS, 64])
    for axis, (i, j, k) in itertools.product(range(3), np.ndindex(DIMS)):
        turned = np.roll([i, j, k], -1 - axis)
        assert cell_number(axis, *turned, dims) == (k * DIMS[1] + j) * 64 + i


def solid_angle(corners: np.ndarray) -> float:
    a, b, c = corners
    la, lb, lc = (np.linalg.norm(v) for v in corners)
    return 2 * math.atan2(a @ np.cross(b, c), la * lb * lc + (a @ b) * lc + (b @ c) * la + (c @ a) * lb)


def test_windings_are_sums_of_solid_angles_and_of_dipoles_far_away() -> None:
    rng = np.random.default_rng(5)
    corners = rng.normal(0, 0.4, (10, 3, 3)) + rng.uniform(0, 5, (10, 1, 3))
    dipoles = np.zeros((4, 7))
    gather_clusters(corners, 3, dipoles)
    out = np.zeros((4, 5))
    winding_slice(corners, 3, dipoles, 1.3, out)
    used = np.zeros(2, int)
    for n in range(4):
        part = corners[3 * n : 3 * n + 3]
        centre = part.mean(axis=(0, 1))
        np.testing.assert_allclose(dipoles[n, :3], centre, rtol=1e-12)
        assert dipoles[n, 3] == pytest.approx(np.linalg.norm(part - centre, axis=2).max(), rel=1e-12)
        area = 0.5 * np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]).sum(axis=0)
        np.testing.assert_allclose(dipoles[n, 4:], area, rtol=1e-12, atol=1e-14)
    for j, i in np.ndindex(4, 5):
        x, total = np.array([i + 0.5, j + 0.5, 1.3]), 0.0
        for n in range(4):
            away = dipoles[n, :3] - x
            far = np.linalg.norm(away) > FAR * dipoles[n, 3]
            used[int(far)] += 1
            if far:
                total += away @ dipoles[n, 4:] / np.linalg.norm(away) ** 3
            else:
                total += sum(solid_angle(c - x) for c in corners[3 * n : 3 * n + 3])
        assert out[j, i] == pytest.approx(total / (4 * math.pi), rel=1e-9, abs=1e-12)
    assert used.min() > 5
