"""One triangle added to the count of a row, pixel by pixel."""

from __future__ import annotations

import numba
import numpy as np

from torchrender.kernels.raster.count_layers import count_row, find_farthest, lies_behind
from torchrender.kernels.raster.lanes.counted import count_lanes
from torchrender.kernels.raster.records import Nearer, Stored
from torchrender.kernels.raster.tiles import BLOCKS


def test_a_row_against_a_loop() -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        n = 9
        base, step = rng.uniform(0.2, 0.6), rng.normal(0, 0.02)
        low, high, far = 0.15, 0.55, 5.0
        z = [np.float32(1.0 / min(max(base + step * x, low), high)) for x in range(n)]
        depth = np.where(rng.random(n) < 0.5, z, rng.uniform(1, 8, n)).astype(np.float32)  # often equal depths
        depth[0] = np.inf
        triangle = rng.integers(0, 9, n)
        worth = rng.integers(-(2**31), 2**31, 5 if rng.random() < 0.5 else 0).astype(np.int32)
        images = Nearer(np.zeros((3, n + 5), np.int32), np.zeros((3, n + 5), np.bool_), worth)
        stored = Stored(np.full((3, n + 5), np.inf, np.float32), np.zeros((3, n + 5), np.int64))
        stored.depth[1, 2 : n + 2], stored.triangle[1, 2 : n + 2] = depth, triangle
        relative, absolute = 0.1, 0.05
        count_row(4, (base, step, low, high), (relative, absolute, far), 1, (2, n + 2), stored, images)
        assert images.number.sum() == images.number[1, 2 : n + 2].sum(), "nothing else is counted"
        found = Nearer(*(image[1, 2 : n + 2] for image in images[:2]), worth)
        nearer = [
            z[x] <= far and (z[x] < depth[x] or (z[x] == depth[x] and triangle[x] > 4)) for x in range(n)
        ]  # of equal depths the lower id is in front
        np.testing.assert_array_equal(found.number, np.array(nearer) * (worth[4] if len(worth) else 1))
        touching = [ok and float(z[x]) * 1.1 + 0.05 >= float(depth[x]) for x, ok in enumerate(nearer)]
        np.testing.assert_array_equal(found.touching, touching)


@numba.njit
def counted(images, spot, mask, plane, limits, own):
    count_lanes(
        images, (np.uintp(spot[0]), np.uintp(spot[1])), np.uint64(mask), plane, limits, (own[0], np.int32(own[1]))
    )


def test_eight_pixels_together_are_counted_as_a_row_is() -> None:
    """With equal depths, empty pixels, and pixels that are not asked for; nothing beside them changes."""
    rng = np.random.default_rng(3)
    counts = []
    for _ in range(300):
        base, step, low, high, far = rng.uniform(0.2, 0.6), rng.normal(0, 0.02), 0.15, 0.55, 5.0
        begin, end = np.sort(rng.integers(0, 8, 2))
        z = np.float32(1.0 / np.clip(base + step * (np.arange(8) - begin), low, high))
        near = rng.random() < 0.3  # often all of them are hidden
        depth = np.full((3, 14), np.inf, np.float32)
        depth[1, 3:11] = np.where(rng.random(8) < 0.4, z, rng.choice([0.0, np.inf, 1.0, 3.0], 8))
        depth[1, 3:11] = rng.choice([0.0, 1.0], 8) if near else depth[1, 3:11]
        triangle = rng.integers(3, 6, (3, 14))
        one, other = ((np.zeros((3, 14), np.int32), np.zeros((3, 14), np.bool_)) for _ in range(2))
        own, limits = (4, int(rng.integers(-9, 9))), (0.1, 0.05, far)
        worth = np.full(5, own[1], np.int32)
        part = (3 + begin, 3 + end + 1)
        count_row(4, (base, step, low, high), limits, 1, part, Stored(depth, triangle), Nearer(*one, worth))
        mask = sum(1 << k for k in range(begin, end + 1))
        plane, least = (base, step, float(-begin), low, high), float(np.float32(1.0 / high))
        counted((depth, triangle, *other), (1, 3), mask, plane, (1.0 + limits[0], *limits[1:], least), own)
        for a, b in zip(one, other, strict=True):
            np.testing.assert_array_equal(a, b)
        counts.append((one[0] != 0).sum())
    assert 0 in counts and max(counts) > 5


def test_what_lies_behind_a_box_of_a_tile() -> None:
    """The greatest depth of each block, against all pixels; a part of the image, none of which may be asked for."""
    rng = np.random.default_rng(1)
    depth = rng.uniform(0, 5, (50, 90)).astype(np.float32)
    depth[17, 70] = np.inf
    left, top, right, bottom = 64, 16, 89, 47
    farthest = np.zeros(BLOCKS, np.float32)
    assert find_farthest(depth, left, top, right, bottom, farthest) == np.inf
    padded = np.zeros((32, 64), np.float32)
    padded[:, : right - left + 1] = depth[top : bottom + 1, left : right + 1]
    blocks = padded.reshape(4, 8, 4, 16).max(axis=(1, 3))
    np.testing.assert_array_equal(farthest, blocks.reshape(-1))
    answers = []
    for _ in range(200):
        (x0, x1), (y0, y1) = np.sort(rng.integers(0, 26, 2)), np.sort(rng.integers(0, 32, 2))
        own = blocks[y0 // 8 : y1 // 8 + 1, x0 // 16 : x1 // 16 + 1].max()
        nearest = np.float32(rng.choice([own, np.nextafter(own, np.float32(np.inf)), 4.9]))
        assert lies_behind(nearest, (x0, y0, x1, y1), farthest) == (nearest > own)
        answers.append(nearest > own)
    assert 20 < sum(answers) < 180
    assert find_farthest(np.zeros((3, 4), np.float32), 0, 0, 3, 2, farthest) == 0
