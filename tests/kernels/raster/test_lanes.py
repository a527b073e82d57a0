"""Eight pixels at a time, against loops in Python's integers and floats."""

from __future__ import annotations

import numba
import numpy as np
import pytest

from torchrender.kernels.raster.fragments import has_triangle
from torchrender.kernels.raster.lanes.pixels import (
    covered_window,
    keep_nearest,
    least_of,
    reaches,
    same_lanes,
    unseen_lanes,
)
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH, find_rows
from torchrender.kernels.raster.lanes.seen import write_mixed, write_seen
from torchrender.kernels.raster.lanes.vectors import LANES


@numba.njit
def window(edges, tall):
    return covered_window(edges, tall)


@numba.njit
def kept(keys, ids, place, mask, plane, t):
    keep_nearest(keys, ids, np.uintp(place), np.uint64(mask), plane, np.int32(t))


@numba.njit
def reached(keys, place, mask, high):
    return reaches(keys, np.uintp(place), np.uint64(mask), high)


@numba.njit
def alike(ids, place, t):
    return same_lanes(ids, np.uintp(place), np.int32(t))


@numba.njit
def written(images, place, lanes, owner, planes, depths, source):
    spot = (np.uintp(place[0]), np.uintp(place[1]))
    here = (np.uintp(source[0]), source[1])
    write_seen(images, spot, (np.uint64(lanes[0]), lanes[1]), owner, planes, depths, here)


@numba.njit
def written_mixed(images, place, lanes, known, planes, objects, depths, spot):
    here = (known[0], np.uintp(known[1]), np.int32(known[2]))
    to = (np.uintp(place[0]), np.uintp(place[1]))
    write_mixed(images, to, (np.uint64(lanes[0]), lanes[1]), here, (planes, objects), depths, spot)


@numba.njit
def unseen(keys, ids, place, mask, plane, t, spot, earlier):
    return unseen_lanes(keys, ids, np.uintp(place), np.uint64(mask), plane + spot, np.int32(t), earlier)


@numba.njit
def least(values, place, rows, step):
    return least_of(values, np.uintp(place), rows, step)


@numba.njit
def rows_of(first, last, edges, rows, width):
    return find_rows(first, last, edges, rows, width)


def set_bits(mask: int) -> set[int]:
    return {k for k in range(64) if (int(mask) >> k) & 1}


def test_a_window_is_inside_where_all_three_edges_are_not_negative() -> None:
    rng = np.random.default_rng(0)
    for scale in (4, 1 << 40):
        for _ in range(200):
            e, dx, dy = (rng.integers(-scale, scale, 3) * f for f in (6, 1, 1))
            inside = {
                8 * y + x
                for y in range(8)
                for x in range(8)
                if all(e[k] + dx[k] * x + dy[k] * y >= 0 for k in range(3))
            }
            assert set_bits(window((*e, *dx, *dy), True)) == inside
            assert set_bits(window((*e, *dx, *dy), False)) == {k for k in inside if k < 32}


def test_the_least_of_rows_is_found() -> None:
    rng = np.random.default_rng(3)
    for _ in range(200):
        values, place, rows = rng.normal(size=90), int(rng.integers(0, 14)), int(rng.integers(1, 4))
        wanted = min(values[place + 30 * k : place + 30 * k + 2 * LANES].min() for k in range(rows))
        assert least(values, place, rows, 30) == wanted


@pytest.mark.parametrize("size", [1 << 16, 1 << 24, 1 << 30])
def test_rows_are_those_within_all_three_edges(size: int) -> None:
    """Exact up to the largest triangles: edges near and far, level, steep, and through pixel centres."""
    rng = np.random.default_rng(size)
    kinds = set()
    for _ in range(400):
        rows, width = int(rng.integers(1, TILE_HEIGHT + 1)), int(rng.integers(1, TILE_WIDTH + 1))
        steps = rng.integers(-size, size + 1, (2, 3)) * rng.choice([0, 1, 1, 1], (2, 3))
        dx, dy = (steps * 32768).tolist()
        through = rng.integers(-2, [[width + 2], [rows + 2]], (2, 3)).tolist()
        e = [-dx[k] * through[0][k] - dy[k] * through[1][k] - int(rng.integers(0, 2)) for k in range(3)]
        e = [e[k] if rng.random() < 0.8 else int(rng.integers(-(1 << 61), 1 << 61)) for k in range(3)]
        first, last = np.full(TILE_HEIGHT, 99), np.full(TILE_HEIGHT, -99)
        count = rows_of(first, last, (*e, *dx, *dy), rows, width)
        inside = [
            [x for x in range(width) if all(e[k] + dx[k] * x + dy[k] * y >= 0 for k in range(3))] for y in range(rows)
        ]
        assert [list(range(first[y], last[y] + 1)) for y in range(rows)] == inside
        assert count == sum(map(len, inside))
        kinds.add((count > 0, count == rows * width))
    assert len(kinds) == 3


def test_the_nearest_of_masked_pixels_is_kept_and_others_stay() -> None:
    rng = np.random.default_rng(1)
    for _ in range(300):
        keys, ids = rng.integers(0, 4, 24) / 4, rng.integers(0, 3, 24).astype(np.int32)
        base, step, column = 0.25 * rng.integers(-3, 4), 0.25 * rng.integers(-1, 2), float(rng.integers(0, 3))
        place, mask, t = int(rng.integers(0, 17)), int(rng.integers(0, 256)), int(rng.integers(0, 3))
        wanted, owners = keys.copy(), ids.copy()
        for k in set_bits(mask):
            key = min(max(base + step * (column + k), 0.125), 0.75)
            if (key, -t) > (wanted[place + k], -owners[place + k]):
                wanted[place + k], owners[place + k] = key, t
        high = rng.integers(0, 4) / 4
        assert reached(keys, place, mask, high) == any(keys[place + k] <= high for k in set_bits(mask))
        assert set_bits(alike(ids, place, t)) == {k for k in range(LANES) if ids[place + k] == t}
        kept(keys, ids, place, mask, (base, step, column, 0.125, 0.75), t)
        np.testing.assert_array_equal(keys, wanted)
        np.testing.assert_array_equal(ids, owners)


def test_masked_pixels_of_an_image_are_written_and_no_others() -> None:
    rng = np.random.default_rng(2)
    for weighted in (False, True):
        for _ in range(200):
            owners, weights = np.full((3, 9), -7), np.full((3, 9, 2), -7, np.float32)
            depths, planes = rng.uniform(0.5, 2, 12), (*rng.uniform(-0.5, 0.6, 4), 3.5)
            row, column, source = rng.integers(0, 3), rng.integers(0, 9), int(rng.integers(0, 5))
            inside = 0xFF >> max(column + LANES - 9, 0)
            mask = int(rng.choice([rng.integers(0, 256), 0xFF])) & inside
            lanes = (mask, bool(inside == 0xFF and rng.integers(0, 2)))
            written((owners, weights), (row, column), lanes, 5, planes, depths, (source, weighted))
            for y in range(3):
                for x in range(9):
                    k = x - column
                    if y != row or k not in set_bits(mask):
                        assert owners[y, x] == -7 and (weights[y, x] == -7).all()
                        continue
                    scale = depths[source + k] if weighted else 1.0
                    u = min(max((planes[0] * (3.5 + k) + planes[1]) * scale, 0.0), 1.0)
                    v = min(max((planes[2] * (3.5 + k) + planes[3]) * scale, 0.0), 1.0 - u)
                    assert owners[y, x] == 5 and tuple(weights[y, x]) == (np.float32(u), np.float32(v))


@pytest.mark.parametrize("weighted", [False, True])
def test_pixels_of_different_triangles_each_get_their_own_object_and_weights(weighted: bool) -> None:
    """Ids share the bits that tell their rows; pixels without a triangle, and those beside the masked ones."""
    rng = np.random.default_rng(4)
    for _ in range(100):
        whole = bool(rng.integers(0, 2))
        mask, row, column, source = 255 if rng.integers(0, 2) else int(rng.integers(0, 256)), 1, 1, 5
        ids = rng.integers(-1, 12, 16).astype(np.int32)
        planes, objects = rng.normal(0, 0.3, (4, 6)), rng.integers(0, 99, 12)
        planes[3, rng.integers(0, 6)] = np.nan  # of pixels without a triangle it does not count
        ids[ids % 4 == 3] = -1
        depths = rng.uniform(0.5, 2, 16)
        owners, weights = np.full((3, 9), -7), np.full((3, 9, 2), -7, np.float32)
        written_mixed(
            (owners, weights), (row, column), (mask, whole), (ids, source, 3), planes, objects, depths,
            (3.5, 2.5, weighted),
        )  # fmt: skip
        for y in range(3):
            for x in range(9):
                k = x - column
                if y != row or k not in set_bits(mask):
                    assert owners[y, x] == -7 and (weights[y, x] == -7).all()
                    continue
                t, u, v = ids[source + k], 0.0, 0.0
                if t >= 0:
                    ux, uy, uc, vx, vy, vc = planes[t & 3]
                    scale = depths[source + k] if weighted else 1.0
                    u = min(max((ux * (3.5 + k) + (uy * 2.5 + uc)) * scale, 0.0), 1.0)
                    v = min(max((vx * (3.5 + k) + (vy * 2.5 + vc)) * scale, 0.0), 1.0 - u)
                assert owners[y, x] == (objects[t] if t >= 0 else -1)
                assert tuple(weights[y, x]) == (np.float32(u), np.float32(v))


@pytest.mark.parametrize("images", [0, 1, 3])
def test_unseen_pixels_are_nearer_and_in_no_earlier_image(images: int) -> None:
    """Of fragments that project outside of the images, before their near planes, and on pixels of the same triangle."""
    rng = np.random.default_rng(8)
    kinds = set()
    for _ in range(300):
        keys, ids = rng.choice([0.2, 0.5, 0.9], 24), rng.integers(-1, 9, 24).astype(np.int32)
        place, mask, t = int(rng.integers(0, 17)), int(rng.integers(0, 256)), int(rng.integers(0, 3))
        plane = (0.5, float(rng.choice([0.0, 0.03])), float(rng.integers(0, 5)), 0.3, 0.7)
        spot = tuple(rng.uniform(-4, 4, 2))
        pixels = np.zeros((images, 3, 4))
        pixels[:, 0, 0] = pixels[:, 1, 1] = pixels[:, 2, 2] = 1.0
        pixels[:, :2, 2] = 4.0
        pixels += rng.normal(0, 0.3, pixels.shape)
        near = rng.choice([0.1, 2.0], images)
        known = rng.integers(-1, 3, (images, 7, 9))
        found = set_bits(unseen(keys, ids, place, mask, plane, t, spot, (known, pixels, near)))
        for n in range(LANES):
            base, step, column, low, high = plane
            key = min(max(base + step * (column + n), low), high)
            here, held = keys[place + n], ids[place + n]
            wins = bool(mask >> n & 1) and (key > here or (key == here and t < held))
            seen = has_triangle(t, spot[0] + n, spot[1], key, known, pixels, near)
            assert (n in found) == (wins and not seen)
            kinds.add((wins, bool(seen)))
    assert len(kinds) == (4 if images else 2)
