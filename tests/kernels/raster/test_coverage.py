"""Which pixels triangles cover and which of them wins, pixel by pixel in Python's integers and floats."""

from __future__ import annotations

import itertools

import numba
import numpy as np
import pytest

from torchrender.kernels.raster.coverage import (
    WINDOW,
    are_hidden,
    edge,
    fill_samples,
    fill_unseen,
    fill_unseen_window,
    fill_window,
    is_hidden,
    misses,
    move_bits,
    row_ends,
    window_bits,
    window_start,
)
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH, fill_rows, rows_reach
from torchrender.kernels.raster.project import SUBPIXEL, snap
from torchrender.kernels.raster.records import NO_EARLIER, Buffers, Frame


def ends_of(packed: list[int], pixel: tuple[int, int], size: tuple[int, int]) -> tuple[int, np.ndarray, np.ndarray]:
    """Pixels that a triangle covers in a box from ``pixel`` on, columns by rows, and the spans of its rows."""
    (ax, ay), (bx, by), (cx, cy) = (((p >> 32), ((p & 0xFFFFFFFF) ^ (1 << 31)) - (1 << 31)) for p in packed)
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    first, last = np.full(TILE_HEIGHT, 99, np.int64), np.full(TILE_HEIGHT, -99, np.int64)
    centre = tuple(p * SUBPIXEL + SUBPIXEL // 2 for p in pixel)
    count = row_ends(tuple(packed), area, centre, size, first, last)
    return count, first[: size[1]], last[: size[1]]


@numba.njit
def filled(keys, ids, ends, box, plane, t):
    fill_rows(keys, ids, ends, box, plane, np.int32(t))


@numba.njit
def reached(keys, ends, box, high):
    return rows_reach(keys, ends[0], ends[1], box, high)


def position(x: float, y: float) -> int:
    return int(np.floor(x * SUBPIXEL + 0.5)), int(np.floor(y * SUBPIXEL + 0.5))


def covers(corners: list[tuple[int, int]], x: int, y: int) -> bool:
    """The pixel's centre is inside, or on an edge that belongs to the triangle: a left edge, or a horizontal top."""
    (ax, ay), (bx, by), (cx, cy) = corners
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if area < 0:
        corners = [corners[0], corners[2], corners[1]]
    px, py = x * SUBPIXEL + SUBPIXEL // 2, y * SUBPIXEL + SUBPIXEL // 2
    for k in range(3):
        (ax, ay), (bx, by) = corners[k], corners[(k + 1) % 3]
        value = (bx - ax) * (py - ay) - (by - ay) * (px - ax)
        dx, dy = bx - ax, by - ay
        if value < 0 or (value == 0 and not (dy > 0 or (dy == 0 and dx < 0))):
            return False
    return area != 0


def edges_of(packed: list[int], corners: list[tuple[int, int]], x0: int, y0: int):
    (ax, ay), (bx, by), (cx, cy) = corners
    sign = 1 if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) > 0 else -1
    px, py = x0 * SUBPIXEL + SUBPIXEL // 2, y0 * SUBPIXEL + SUBPIXEL // 2
    pairs = ((0, 1), (1, 2), (2, 0))
    return [edge(packed[a], packed[b], sign, px, py) for a, b in pairs]


def random_corners(rng: np.random.Generator, step: float, size: int) -> list[tuple[float, float]]:
    """Often with corners and edges on pixel centres."""
    return [tuple(np.round(rng.uniform(-4, size, 2) / step) * step) for _ in range(3)]


@pytest.mark.parametrize("step", [0.5, 0.25, 1 / 4096, 1 / 32768])
def test_spans_and_bits_are_the_covered_pixels(step: float) -> None:
    rng = np.random.default_rng(int(1 / step))
    for _ in range(300):
        places = random_corners(rng, step, 12)
        corners = [position(*p) for p in places]
        packed = [snap(*p) for p in places]
        (ax, ay), (bx, by), (cx, cy) = corners
        if (bx - ax) * (cy - ay) == (by - ay) * (cx - ax):
            continue
        wanted = np.array([[covers(corners, x, y) for x in range(8)] for y in range(7)])
        found = np.zeros((7, 8), bool)
        count, first, last = ends_of(packed, (0, 0), (8, 7))
        for y in range(7 if count else 0):
            found[y, first[y] : last[y] + 1] = first[y] <= last[y]
        assert count == wanted.sum()
        np.testing.assert_array_equal(found, wanted)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        pixel = (2 * SUBPIXEL + SUBPIXEL // 2, SUBPIXEL + SUBPIXEL // 2)
        bits = window_bits(*packed, area, pixel, WINDOW)  # also where the window cuts the triangle
        part = [(x, y) for y, x in itertools.product(range(WINDOW), repeat=2) if covers(corners, x + 2, y + 1)]
        assert {n for n in range(64) if (bits >> n) & 1} == {WINDOW * y + x for x, y in part}
        rows = max((y for _, y in part), default=0) + 1
        assert window_bits(*packed, area, pixel, rows) == bits
        outside = [misses(*e, 5, 4) for e in edges_of(packed, corners, 2, 1)]
        assert not (any(outside) and any(x < 5 and y < 4 for x, y in part))


def test_two_triangles_share_no_pixel_and_leave_none_out() -> None:
    rng = np.random.default_rng(1)
    for _ in range(200):
        a, b = (0.5, 0.5), tuple(np.round(rng.uniform(4, 9, 2) * 2) / 2)
        left, right = (a[0], b[1]), (b[0], a[1])
        count = np.zeros((10, 10), int)
        for corners in ([a, b, left], [b, a, right]):
            count += [[covers([position(*p) for p in corners], x, y) for x in range(10)] for y in range(10)]
        assert count.max() <= 1
        total = sum(
            ends_of([snap(*p) for p in corners], (0, 0), (10, 10))[0] for corners in ([a, b, left], [b, a, right])
        )
        assert total == count.sum() == int(b[0] - 0.5) * int(b[1] - 0.5)


@pytest.mark.parametrize("right", [6, 40])
@pytest.mark.parametrize("small", [False, True])
@pytest.mark.parametrize("window", [False, True])
def test_the_nearest_wins_and_of_equal_ones_the_lowest_id(window: bool, small: bool, right: int) -> None:
    """Coincident triangles, in every order, and planes that cross."""
    right = min(right, 10) if window else right
    planes = [
        (0.0, 0.0, 0.5, 0.1, 0.9),
        (0.0, 0.0, 0.5, 0.1, 0.9),  # coincident
        (0.02, -0.01, 0.47, 0.1, 0.9),
        (0.2, 0.0, -0.3, 0.35, 0.6),  # held within its limits
    ]
    wanted_keys = np.full((TILE_HEIGHT, TILE_WIDTH), 0.05)
    wanted = np.full((TILE_HEIGHT, TILE_WIDTH), -1)
    for y, x in itertools.product(range(2, 6), range(3, right + 1)):
        start = 0 if small else y * TILE_WIDTH  # from where columns count: planes that cross may round to equal keys
        keys_of = ((kc + ky * y - kx * start + kx * (start + x), low, high) for kx, ky, kc, low, high in planes)
        values = [min(max(key, low), high) for key, low, high in keys_of]
        wanted[y, x] = max(range(4), key=lambda k: (values[k], -k))
        wanted_keys[y, x] = max(values)
    for order in itertools.permutations(range(4)):
        keys, ids = np.full(TILE_WIDTH * TILE_HEIGHT, 0.05), np.full(TILE_WIDTH * TILE_HEIGHT, -1, np.int32)
        for t in order:
            if window:
                rows = sum(((1 << (right - 2)) - 1) << (WINDOW * y) for y in range(4))
                fill_window(t, planes[t], (3, 2, 0), np.uint64(rows), small, keys, ids)
            else:
                ends = np.zeros(TILE_HEIGHT, np.int64), np.full(TILE_HEIGHT, right - 3, np.int64)
                filled(keys, ids, ends, (3, 2, 4, 0, int(small)), planes[t], t)
        np.testing.assert_array_equal(ids.reshape(wanted.shape), wanted)
        np.testing.assert_allclose(keys.reshape(wanted.shape), wanted_keys, rtol=1e-14)
    assert set(np.unique(wanted)) == {-1, 0, 2, 3}


def test_few_pixels_are_drawn_as_a_window_is() -> None:
    """In a tile that others stand before, with ties; hidden are those that nothing of the triangle exceeds."""
    rng = np.random.default_rng(7)
    pixels = TILE_WIDTH * TILE_HEIGHT
    answers = set()
    for _ in range(400):
        bits = np.uint64(sum(int(b) << (k % 2 + WINDOW * (k // 2)) for k, b in enumerate(rng.random(4) < 0.6)))
        x, y = rng.integers(0, TILE_WIDTH - WINDOW), rng.integers(0, TILE_HEIGHT - WINDOW)
        spot, high = (int(x), int(y), pixels), float(rng.choice([0.4, 0.6]))
        plane = (*rng.choice([0.0, 0.01, -0.02], 2), 0.5, 0.3, high)
        keys = rng.choice([0.3, 0.5, 0.7], 2 * pixels)
        ids = rng.integers(-1, 9, 2 * pixels).astype(np.int32)
        hidden = are_hidden(high, spot, bits, keys)
        assert hidden == is_hidden(high, spot, bits, keys)
        one, other = (keys.copy(), ids.copy()), (keys.copy(), ids.copy())
        fill_window(4, plane, spot, bits, True, *one)
        fill_samples(4, plane, spot, bits, *other)
        for a, b, before in zip(one, other, (keys, ids), strict=True):
            np.testing.assert_array_equal(a, b)
            assert not hidden or (a == before).all()
        answers.add((hidden, bool((one[0] != keys).any())))
    assert answers == {(True, False), (False, False), (False, True)}


def test_windows_of_new_pixels_are_spans_of_them() -> None:
    """A small triangle's rows, as a window and as spans, beside one earlier image; some of both pass."""
    rng = np.random.default_rng(9)
    pixels = TILE_WIDTH * TILE_HEIGHT
    frame = Frame(90, 70, 0.1, 100.0, False)
    earlier = NO_EARLIER._replace(
        ids=rng.integers(3, 5, (1, 70, 90)), pixels=np.array([np.eye(3, 4)]), near=np.array([0.1])
    )
    earlier.pixels[0, :2, 2] = 45, 35
    kept = 0
    for _ in range(100):
        width, rows = rng.integers(1, 5, 2)
        x, y = int(rng.integers(0, TILE_WIDTH - WINDOW)), int(rng.integers(0, TILE_HEIGHT - WINDOW))
        plane = (0.01, -0.02, 0.9, 0.1, 0.7)
        keys, ids = rng.choice([0.2, 0.5, 0.7], pixels), rng.integers(0, 9, pixels).astype(np.int32)
        first, last = rng.integers(0, width, rows), rng.integers(0, width, rows)
        bits = sum(1 << (WINDOW * j + i) for j in range(rows) for i in range(first[j], last[j] + 1))
        one = Buffers(0, keys.copy(), ids.copy(), *(np.zeros((0,)),), np.zeros((2, 0), np.int64), ids, keys)
        fill_unseen(4, plane, (x, y, y + int(rows) - 1, 0, 32), frame, first, last, earlier, one)
        other = keys.copy(), ids.copy()
        fill_unseen_window(4, plane, (x, y, 0), np.uint64(bits), (0.5 - 45, 32.5 - 35), earlier, *other)
        np.testing.assert_array_equal(one.keys, other[0])
        np.testing.assert_array_equal(one.ids, other[1])
        changed = int((one.keys != keys).sum())
        assert changed <= bits.bit_count()
        kept += changed
    assert kept > 50


def test_spans_that_cut_groups_of_pixels_touch_no_others() -> None:
    for begin, end in itertools.combinations_with_replacement(range(TILE_WIDTH), 2):
        keys, ids = np.zeros(TILE_WIDTH * TILE_HEIGHT), np.full(TILE_WIDTH * TILE_HEIGHT, -1, np.int32)
        last = TILE_HEIGHT - 1  # beyond which there is nothing
        ends = np.array([begin]), np.array([end])
        filled(keys, ids, ends, (0, last, 1, 0, 1), (0.0, 0.0, 0.5, 0.1, 0.9), 7)
        hit = np.zeros((TILE_HEIGHT, TILE_WIDTH), bool)
        hit[last, begin : end + 1] = True
        np.testing.assert_array_equal(keys.reshape(hit.shape), np.where(hit, 0.5, 0.0))
        np.testing.assert_array_equal(ids.reshape(hit.shape), np.where(hit, 7, -1))


def test_spans_of_all_kinds_of_triangles_are_exact() -> None:
    """Slivers, large ones, edges along rows and columns, and boxes that only meet a part, up to a whole tile."""
    rng = np.random.default_rng(11)
    for _ in range(300):
        step, size = (
            rng.choice([0.5, 1 / 4096]),
            (int(rng.integers(1, TILE_WIDTH + 1)), int(rng.integers(1, TILE_HEIGHT + 1))),
        )
        places = rng.uniform(-30, 90, (3, 2))
        places[1] = np.where(rng.random(2) < 0.3, places[0], places[1])
        places[2] = np.where(rng.random() < 0.4, places[0] + (places[1] - places[0]) * 0.7 + 0.4, places[2])
        places = np.round(places / step) * step
        corners, packed = [position(*p) for p in places], [snap(*p) for p in places]
        (ax, ay), (bx, by), (cx, cy) = corners
        if (bx - ax) * (cy - ay) == (by - ay) * (cx - ax):
            continue
        x0, y0 = (int(v) for v in rng.integers(0, 20, 2))
        wanted = np.array([[covers(corners, x0 + x, y0 + y) for x in range(size[0])] for y in range(size[1])])
        count, first, last = ends_of(packed, (x0, y0), size)
        assert count == wanted.sum()
        for y in range(size[1] if count else 0):
            np.testing.assert_array_equal(np.nonzero(wanted[y])[0], np.arange(first[y], last[y] + 1))


def test_rows_are_reached_where_one_of_their_pixels_is_no_nearer() -> None:
    rng = np.random.default_rng(12)
    answers = []
    for _ in range(400):
        rows, x0, y0 = int(rng.integers(1, 20)), int(rng.integers(0, 40)), int(rng.integers(0, 12))
        first, last = rng.integers(0, 12, rows), rng.integers(-1, TILE_WIDTH - x0, rows)
        keys = np.where(rng.random((TILE_HEIGHT, TILE_WIDTH)) < 0.005, 0.4, 0.7)
        wanted = any((keys[y0 + y, x0 + first[y] : x0 + last[y] + 1] <= 0.4).any() for y in range(rows))
        assert reached(keys.reshape(-1), (first, last), (x0, rows, y0 * TILE_WIDTH), 0.4) == wanted
        answers.append(wanted)
    assert 50 < sum(answers) < 350


def test_windows_stay_within_their_tile() -> None:
    for x, y in itertools.product(range(2 * TILE_WIDTH), range(2 * TILE_HEIGHT)):
        for last in range(x, min(x + WINDOW, (x // TILE_WIDTH + 1) * TILE_WIDTH)):
            left, top = window_start(x, y, last)
            assert left <= x and last < left + WINDOW and top <= y < top + WINDOW
            assert left // TILE_WIDTH == (left + WINDOW - 1) // TILE_WIDTH == x // TILE_WIDTH
            assert top // TILE_HEIGHT == (top + WINDOW - 1) // TILE_HEIGHT == y // TILE_HEIGHT
            assert left % 4 == 0 or last - x // 4 * 4 >= WINDOW


def test_few_bits_move_with_the_window() -> None:
    """To where vectors may begin; those of 2 x 2 pixels stay."""
    rng = np.random.default_rng(13)
    for x in range(2 * TILE_WIDTH):
        wide = min(4, TILE_WIDTH - x % TILE_WIDTH)
        bits = sum(int(rng.integers(0, 1 << wide)) << (WINDOW * y) for y in range(4))
        moved, start = move_bits(np.uint64(bits), x)
        pixels = {(x + k % WINDOW, k // WINDOW) for k in range(64) if bits >> k & 1}
        assert {(start + k % WINDOW, k // WINDOW) for k in range(64) if int(moved) >> k & 1} == pixels
        few = all(k in (0, 1, WINDOW, WINDOW + 1) for k in range(64) if bits >> k & 1)
        assert start == x if few else start % 4 == 0 and start % TILE_WIDTH <= TILE_WIDTH - WINDOW


def test_a_small_triangle_is_hidden_where_all_its_pixels_are_nearer() -> None:
    keys = np.full(TILE_WIDTH * TILE_HEIGHT, 0.5)
    keys[4 * TILE_WIDTH + 7] = 0.2
    inside, every = np.uint64(1 << (WINDOW * 2 + 2)), np.uint64(2**64 - 1)  # that pixel, in a window from (5, 2)
    assert is_hidden(0.4, (5, 2, 0), every & ~inside, keys) and not is_hidden(0.4, (5, 2, 0), every, keys)
    assert not is_hidden(0.4, (5, 2, 0), inside, keys) and is_hidden(0.1, (5, 2, 0), inside, keys)
    assert not is_hidden(0.5, (5, 2, 0), np.uint64(1), keys), "of equal keys the id decides"
