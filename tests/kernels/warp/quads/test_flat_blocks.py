"""Blocks of quads in a plane: the planes, and that what is left out for them is hidden."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.warp.corners import FIRST, SECOND
from torchrender.kernels.warp.quads.flat_blocks import COLUMNS, ROWS, UNEVEN, find_planes, is_block_hidden
from torchrender.kernels.warp.warp import Canvas, Pose, Poses, Quads, draw_quads, key_of

OFFSETS = ((0, 0), (0, 1), (1, 1), (1, 0))


def quads_of(inverse_depth: np.ndarray, start: float, size: tuple[int, int]) -> np.ndarray:
    """Corner depths (h,4,w) of a plane 1/z = n.(u,v,1)."""
    rows, columns = size
    v, u = np.mgrid[:rows, :columns] + start
    a, b, c = inverse_depth
    return np.stack([1.0 / (a * (u + du) + b * (v + dv) + c) for du, dv in OFFSETS], axis=1).astype(np.float32)


def planes_of(corners: np.ndarray, shape: np.ndarray, start: float) -> np.ndarray:
    planes = np.full((len(shape), -(-shape.shape[1] // ROWS), -(-shape.shape[2] // COLUMNS), 4), np.nan)
    find_planes(corners, shape, start, planes)
    return planes


@pytest.mark.parametrize("start", [0.0, 0.5])
def test_planes_against_a_loop(start: float) -> None:
    """Flat, uneven and empty blocks, and those that the image cuts."""
    rng = np.random.default_rng(int(2 * start))
    size = (2 * ROWS + 3, 3 * COLUMNS + 5)
    truth = np.array([2e-4, -1e-4, 0.3])
    corners = quads_of(truth, start, size)
    shape = np.full(size, FIRST | SECOND, np.uint8)
    corners *= 1.0 + rng.uniform(-1e-5, 1e-5, corners.shape).astype(np.float32)
    corners[3, 2, COLUMNS + 4] *= 1.01  # uneven: block (0,1)
    corners[ROWS + 2, 1, 7] *= 1.01  # of a quad that is not there: block (1,0)
    shape[ROWS + 2, 7] = 0
    shape[ROWS : 2 * ROWS, COLUMNS : 2 * COLUMNS] = 0  # empty: block (1,1)
    corners[:ROWS, :, 2 * COLUMNS] = np.inf  # no outermost corners: block (0,2)
    shape[:ROWS, 2 * COLUMNS] = 0
    planes = planes_of(corners[None], shape[None], start)[0]
    assert planes.shape == (3, 4, 4)
    for j, i in np.ndindex(3, 4):
        a, b, c, off = planes[j, i]
        if (j, i) in ((0, 1), (0, 2)):
            assert off == np.inf
        elif (j, i) == (1, 1):
            assert off == -1.0
        else:
            np.testing.assert_allclose((a, b, c), truth, atol=5e-5)
            worst = 0.0
            for y in range(j * ROWS, min((j + 1) * ROWS, size[0])):
                for x in range(i * COLUMNS, min((i + 1) * COLUMNS, size[1])):
                    for k, (du, dv) in enumerate(OFFSETS):
                        n = a * (x + start + du) + b * (y + start + dv) + c
                        worst = max(worst, abs(1.0 - float(corners[y, k, x]) * n) if shape[y, x] else 0.0)
            assert worst <= off < worst + 1e-5 < UNEVEN


def turned(rng: np.random.Generator, scale: float) -> np.ndarray:
    """A target matrix (3,4): a little turned and moved beside the source."""
    k = np.array([[60.0 * scale, 0, 24.0 * scale], [0, 60.0 * scale, 16.0 * scale], [0, 0, 1.0]])
    source = np.array([[60.0, 0, 24.0], [0, 60.0, 16.0], [0, 0, 1.0]])
    x, y, z = rng.uniform(-0.05, 0.05, 3)
    rotation = np.array([[1, -z, y], [z, 1, -x], [-y, x, 1.0]])
    shift = rng.uniform(-0.2, 0.2, 3)
    return np.concatenate([k @ rotation @ np.linalg.inv(source), (k @ shift)[:, None]], axis=1)


@pytest.mark.parametrize("scale", [0.7, 1.0, 2.5])
def test_pictures_do_not_depend_on_planes(scale: float) -> None:
    """Images of one plane and of others before and behind it, uneven by less and more than images differ by."""
    rng = np.random.default_rng(int(10 * scale))
    size, target = (4 * ROWS, 3 * COLUMNS), (int(48 * scale), int(32 * scale))
    hidden = 0
    for _ in range(25):
        plane = np.array([*rng.uniform(-4e-3, 4e-3, 2), 0.5])
        corners = np.stack([quads_of(plane * (1 + k * rng.choice([0, 0, 1e-4, 0.2])), 0.0, size) for k in range(3)])
        corners *= 1.0 + rng.uniform(-1, 1, corners.shape).astype(np.float32) * rng.choice([0, 1e-5, 3e-4])
        shape = np.full((3, *size), FIRST | SECOND, np.uint8)
        shape[:, rng.integers(0, size[0], 3), rng.integers(0, size[1], 3)] = 0
        matrix = turned(rng, scale)
        matrices = np.stack([matrix] * 3)  # so that image 0, which goes first, has what the others have
        poses = Poses(matrices, 0.01, np.array([1.0, 0.9995, 0.999]))
        keys = [np.zeros(target[0] * target[1], np.uint64) for _ in range(2)]
        planes = planes_of(corners, shape, 0.0)
        draw_quads(Quads(corners, shape, 0.0), poses, 1, Canvas(keys[0], *target))
        draw_quads(Quads(corners, shape, 0.0, planes), poses, 1, Canvas(keys[1], *target))
        np.testing.assert_array_equal(keys[1], keys[0])
        for j, i in np.ndindex(planes.shape[1:3]):
            box = (i * COLUMNS, j * ROWS, (i + 1) * COLUMNS, (j + 1) * ROWS)
            pose = Pose(matrix, 0.01, 0.9995)
            hidden += is_block_hidden(planes[1, j, i], box, pose, 1e4, Canvas(keys[0], *target))
    assert 25 < hidden < 24 * 12


def test_one_open_pixel_shows_a_block() -> None:
    size, target = (ROWS, COLUMNS), (COLUMNS, ROWS)
    plane = np.array([1e-3, 2e-3, 0.5])
    corners, shape = quads_of(plane, 0.0, size)[None], np.full((1, *size), FIRST | SECOND, np.uint8)
    matrix = np.concatenate([np.eye(3), np.zeros((3, 1))], axis=1)
    known, box, pose = planes_of(corners, shape, 0.0)[0, 0, 0], (0, 0, COLUMNS, ROWS), Pose(matrix, 0.01, 1.0)
    y, x = np.mgrid[:ROWS, :COLUMNS] + 0.5
    there = (plane[0] * x + plane[1] * y + plane[2]).reshape(-1)
    nearer = np.array([key_of(q * (1 + 1e-4), 5) for q in there])
    assert is_block_hidden(known, box, pose, 1e4, Canvas(nearer, *target))
    for n in range(len(nearer)):
        keys = nearer.copy()
        keys[n] = key_of(there[n] * (1 - 1e-6), 5)
        assert not is_block_hidden(known, box, pose, 1e4, Canvas(keys, *target))
    assert not is_block_hidden(known, box, pose, 1e4, Canvas(np.zeros_like(nearer), *target))
    away = matrix.copy()
    away[0, 2] = 100.0
    assert is_block_hidden(known, box, Pose(away, 0.01, 1.0), 1e4, Canvas(np.zeros_like(nearer), *target))
    assert not is_block_hidden(known, box, Pose(matrix, 1.5, 1.0), 1e4, Canvas(nearer, *target))  # near plane
