"""Clusters that are drawn straight into tiles: what they may touch, and which of them are hidden."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.raster import direct, many_views
from torchrender.kernels.raster.records import Frame
from torchrender.kernels.raster.tiles import BLOCKS

SIZE = (150, 70)  # three tiles by three, of which some are cut


def canvas_of(frame: Frame) -> direct.Canvas:
    columns, rows = -(-frame.width // 64), -(-frame.height // 32)
    count = columns * rows << direct.PIXEL_BITS
    rooms = np.zeros(count), np.zeros(count, np.int32), np.zeros(columns * rows * BLOCKS)
    canvas = direct.Canvas(*rooms, columns, 0, 0, frame.width - 1, frame.height - 1)
    direct.clear_canvas(canvas, frame)
    return canvas


def place_of(canvas: direct.Canvas, x: int, y: int) -> int:
    return ((y // 32 * canvas.columns + x // 64) << direct.PIXEL_BITS) + y % 32 * 64 + x % 64


@pytest.mark.parametrize("orthographic", [False, True])
def test_an_empty_canvas_hides_nothing_but_what_lies_outside(orthographic: bool) -> None:
    frame = Frame(*SIZE, 0.25, 50.0, orthographic)
    canvas = canvas_of(frame)
    inside = {place_of(canvas, x, y) for y in range(SIZE[1]) for x in range(SIZE[0])}
    farthest = -50.0 if orthographic else 1 / 50.0
    for place, key in enumerate(canvas.keys):
        assert key < farthest if place in inside else key == np.inf
    assert (canvas.ids == -1).all()


@pytest.mark.parametrize("share", [1.0, 0.5, 0.0])
def test_a_box_is_hidden_where_every_pixel_is_nearer(share: float) -> None:
    """Also where the least keys of blocks were found when less was drawn, of a ``share`` of the picture."""
    frame = Frame(*SIZE, 0.25, 50.0, False)
    canvas = canvas_of(frame)
    rng = np.random.default_rng(5)
    keys = np.where(rng.random(SIZE[::-1]) < 0.02, 0.3, rng.uniform(0.5, 1, SIZE[::-1]))
    for late in (False, True):
        for y in range(SIZE[1]):
            for x in range(SIZE[0]):
                if late == (x >= share * SIZE[0]):
                    canvas.keys[place_of(canvas, x, y)] = keys[y, x]
        if not late:
            direct.refresh_lows(canvas, (0, 0, *(n - 1 for n in SIZE)))
    answers = []
    for _ in range(300):
        (x0, x1), (y0, y1) = (np.sort(rng.integers(0, n, 2)) for n in SIZE)
        x1, y1 = min(x1, x0 + rng.integers(1, 20)), min(y1, y0 + rng.integers(1, 6))
        hidden = bool((keys[y0 : y1 + 1, x0 : x1 + 1] > 0.4).all())
        assert direct.is_box_hidden(canvas, (x0, y0, x1, y1), 0.4) == hidden
        answers.append(hidden)
    assert 30 < sum(answers) < 270


def test_the_least_keys_of_a_box_are_found_and_no_others() -> None:
    frame = Frame(*SIZE, 0.25, 50.0, False)
    canvas = canvas_of(frame)
    canvas.keys[:] = np.random.default_rng(7).uniform(0.5, 1, canvas.keys.shape)
    canvas.lows[:] = 0.0
    direct.refresh_lows(canvas, (20, 6, 70, 33))
    blocks = canvas.keys.reshape(-1, 4, 8, 4, 16).min(axis=(2, 4))  # (tiles, rows, columns) of blocks
    places = {(x // 16, y // 8) for x in range(20, 71) for y in range(6, 34)}
    for n, low in enumerate(canvas.lows):
        tile, j, i = n // BLOCKS, n % BLOCKS // 4, n % 4
        known = (tile % canvas.columns * 4 + i, tile // canvas.columns * 4 + j) in places
        assert low == (blocks[tile, j, i] if known else 0.0)


def test_boxes_are_cut_by_the_canvas() -> None:
    canvas = canvas_of(Frame(*SIZE, 0.25, 50.0, False))._replace(left=64, top=32, right=100, bottom=60)
    assert direct.box_within(canvas, (5, 40, 99, 99)) == (64, 40, 99, 60)
    x0, _, x1, _ = direct.box_within(canvas, (5, 40, 60, 99))
    assert x0 > x1


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_reach_of_a_cluster_holds_its_points(orthographic: bool) -> None:
    frame = Frame(*SIZE, 0.25, 50.0, orthographic)
    rng = np.random.default_rng(6)
    crossing = 0
    for _ in range(200):
        matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix[:2] *= 1 if orthographic else 60
        eye = rng.uniform(-1e3, 1e3, 3)
        middle = eye + np.linalg.solve(matrix, [rng.uniform(-90, 90), rng.uniform(-50, 50), rng.uniform(0.2, 9)])
        corners = middle + rng.uniform(-1, 1, (2, 3)) * rng.choice([0.01, 2.0])
        bounds = np.sort(corners, axis=0)[None]
        x0, y0, x1, y1, high = direct.cluster_reach(bounds, 0, matrix, eye, frame)
        points = rng.uniform(*bounds[0], (40, 3))
        px, py, w = matrix @ (points - eye).T
        if high == np.inf:
            crossing += 1
            assert (x0, y0, x1, y1) == (0, 0, SIZE[0] - 1, SIZE[1] - 1)
            continue
        assert (w > frame.near).all()
        assert ((-w if orthographic else 1 / w) <= high).all()
        scale = 1 if orthographic else w
        x, y = px / scale + SIZE[0] // 2 - 0.5, py / scale + SIZE[1] // 2 - 0.5  # pixel centres at integers
        for axis, low, up, count in ((x, x0, x1, SIZE[0]), (y, y0, y1, SIZE[1])):
            held = np.arange(count)[(np.arange(count) >= axis.min()) & (np.arange(count) <= axis.max())]
            assert all(low <= n <= up for n in held)
    assert 10 < crossing < 190


def test_regions_are_loaded_with_the_triangles_of_all_clusters_that_may_touch_them() -> None:
    rng = np.random.default_rng(9)
    runs = np.stack([np.arange(30) * 10, np.arange(30) * 10 + rng.integers(1, 10, 30)], axis=1)
    low = rng.integers(0, 100, (20, 2))
    boxes = np.concatenate([low, low + rng.integers(-1, 60, (20, 2))], axis=1)  # some hold no pixel
    chosen = rng.permutation(30)[:20]
    found = many_views.Found(chosen, boxes, np.zeros(20), np.zeros(0, bool))
    loads = np.zeros((6, 4), np.int64)
    many_views.region_loads(found, runs, (50, 30), loads)
    wanted = np.zeros_like(loads)
    for c, (x0, y0, x1, y1) in zip(chosen, boxes, strict=True):
        touched = {(y // 30, x // 50) for y in range(y0, y1 + 1) for x in range(x0, x1 + 1)}
        for j, i in touched:
            wanted[j, i] += runs[c, 1] - runs[c, 0]
    assert (loads == wanted).all() and (boxes[:, 0] > boxes[:, 2]).any()
