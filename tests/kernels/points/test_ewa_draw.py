"""Records of points to pixels: a loop over points and pixels for both passes."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from torchrender.kernels.points import ewa
from torchrender.kernels.points.ewa import project_points
from torchrender.kernels.points.ewa_draw import (
    STEPS,
    TILE,
    Binned,
    Picture,
    Weights,
    draw_tiles,
    scan_tiles,
    sort_points,
)
from torchrender.kernels.points.records import Coloring, Filters, Lens, Nodes, Projected, Slices
from torchrender.numerics.ewa import kernel_polynomial, low_pass_stamps

SIZE, R_H, KAPPA = (70, 45), 1.0, 0.7
K = np.array([[60.0, 0.0, 35.0], [0.0, 62.0, 22.0], [0.0, 0.0, 1.0]])


def scene(rng: np.random.Generator, count: int, mode: int, lit: bool = False, eta: float = 1.3, by_axes: bool = False):
    z = rng.uniform(2, 12, count)
    position = np.column_stack([rng.uniform(-0.7, 0.7, count) * z, rng.uniform(-0.5, 0.5, count) * z, z])
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[::7] = 0.0
    radius = np.exp(rng.uniform(-5, -0.5, count))
    nodes = Nodes(*(a.astype(np.float32) for a in (position, normal, radius, rng.random((count, 3)))), True)
    rows, modes = np.array([[0, count // 2], [count // 2, count]]), np.full(2, mode)
    slices = Slices(rows, modes, np.array([0, count // 2]), np.zeros((2, 3)), np.array([[0, 1], [1, 2]]))
    lens = Lens(np.eye(3), K, 0.5, 11.0, *SIZE)
    filters = Filters(R_H, 1 / (2 * np.pi * KAPPA**2), 2.0, 0.01, False, 0.3, 3.0, eta, by_axes)
    light = Coloring(0.0, 0.6, -0.8, 0.2, lit, 0.8, False)
    tiles = -(-SIZE[0] // TILE) * -(-SIZE[1] // TILE)
    made = Projected(np.zeros((count, 16), np.float32), np.zeros((count, 5), np.int16),
                     np.zeros((2, tiles), np.int64), np.zeros((2, ewa.COUNTS), np.int64))  # fmt: skip
    project_points(nodes, slices, lens, filters, light, TILE, 2, made)
    return nodes, made


def drawn(made: Projected):
    across, chunks = -(-SIZE[0] // TILE), np.array([[0, len(made.boxes) // 2], [len(made.boxes) // 2, len(made.boxes)]])
    tiles, start = made.tiles.copy(), np.zeros(made.tiles.shape[1] + 1, np.int64)
    scan_tiles(tiles, start)
    entries = np.zeros(start[-1], np.int32)
    sort_points(made.boxes, chunks, tiles, across, 2, entries)
    for tile in range(len(start) - 1):
        x, y = tile % across * TILE, tile // across * TILE
        met = [
            n for n, (x0, x1, y0, y1, _) in enumerate(made.boxes)
            if x0 <= x1 and max(x0, 0) < x + TILE and x1 >= x and max(y0, 0) < y + TILE and y1 >= y
        ]  # fmt: skip
        assert entries[start[tile] : start[tile + 1]].tolist() == met
    out = Picture(np.zeros((*SIZE[::-1], 3), np.float32), np.zeros(SIZE[::-1], np.float32),
                  np.zeros(SIZE[::-1], np.float32), np.zeros(len(start) - 1, np.int64))  # fmt: skip
    weights = Weights(np.float32(R_H), low_pass_stamps(R_H, KAPPA, STEPS).numpy(), kernel_polynomial(KAPPA).numpy())
    draw_tiles(
        Binned(made.records, made.boxes, entries, start), weights, across, np.array([9, 8, 7], np.float32), 2, out
    )
    return out


def slow(made: Projected):
    """Weight and inverse depth of every point in every pixel, then the nearest, then what blends."""
    stamps, reach = low_pass_stamps(R_H, KAPPA, STEPS).numpy(), R_H
    pixels: dict[tuple[int, int], list[tuple[float, float, int]]] = {}
    for n, (box, record) in enumerate(zip(made.boxes, made.records.astype(float), strict=True)):
        x0, x1, y0, y1, mode = (int(v) for v in box)
        if x0 > x1:
            continue
        columns, rows = range(x0, x1 + 1), range(y0, y1 + 1)
        if mode == ewa.LOW_PASS:
            side = stamps.shape[2]
            columns, rows = range(x0, x0 + side), range(y0, y0 + side)
        for y, x in itertools.product(rows, columns):
            dx, dy = x - x0 - record[ewa.U], y - y0 - record[ewa.V]
            at = record[ewa.INVERSE_Z]
            if mode == ewa.SQUARE:
                weight = 1.0
            elif mode == ewa.LOW_PASS:
                j, i = (min(max(int((reach - record[k]) * STEPS), 0), STEPS - 1) for k in (ewa.V, ewa.U))
                weight = record[ewa.SCALE] * stamps[j, i, y - y0, x - x0]
                if weight == 0.0:
                    continue
            else:
                q = record[ewa.XX] * dx * dx + record[ewa.XY] * dx * dy + record[ewa.YY] * dy * dy
                if q > 1.0:
                    continue
                weight = record[ewa.SCALE] * np.exp(-q / (2 * KAPPA**2))
                at += record[ewa.SLOPE_X] * dx + record[ewa.SLOPE_Y] * dy
                at = min(max(at, record[ewa.INVERSE_LOW]), record[ewa.INVERSE_HIGH])
            if 0 <= x < SIZE[0] and 0 <= y < SIZE[1]:
                pixels.setdefault((y, x), []).append((at, weight, n))
    return pixels


@pytest.mark.parametrize("mode", [ewa.FULL, ewa.RECONSTRUCTION, ewa.LOW_PASS, ewa.SQUARE])
def test_pictures_against_a_loop(mode: int) -> None:
    rng = np.random.default_rng(mode)
    _, made = scene(rng, 260, mode)
    out, pixels = drawn(made), slow(made)
    differing = 0
    for y, x in np.ndindex(SIZE[::-1]):
        found = pixels.get((y, x), [])
        if not found:
            assert out.weight[y, x] == 0 or mode != ewa.SQUARE
            continue
        front = max(at for at, _, _ in found)
        total, color, depth = 0.0, np.zeros(3), 0.0
        for at, weight, n in found:
            record = made.records[n].astype(float)
            tolerance = 0.0 if mode == ewa.SQUARE else record[ewa.TOLERANCE]
            # Within its own tolerance behind the nearest: z <= front's z + tolerance.
            if 1.0 / at <= (1.0 / front + tolerance) * (1 + 1e-7):
                total += weight
                color += weight * record[ewa.RED : ewa.BLUE + 1]
                depth += weight / at
        drawn_here = [out.weight[y, x], *out.image[y, x], out.depth[y, x]]
        same = np.allclose(drawn_here, [total, *color / total, depth / total], rtol=2e-3, atol=1e-4)
        differing += not same
    assert differing <= 0.004 * len(pixels) and len(pixels) > 300
    nothing = out.weight == 0
    assert (out.depth[nothing] == np.inf).all() and (out.image[nothing] == [9, 8, 7]).all() and nothing.any()


def test_colours_follow_lambert_and_unknown_normals_face_the_light() -> None:
    rng = np.random.default_rng(9)
    nodes, made = scene(rng, 200, ewa.SQUARE, lit=True)
    kept = made.boxes[:, 0] <= made.boxes[:, 1]
    assert kept[::7].sum() > 5
    for n in np.flatnonzero(kept):
        normal, position = nodes.normal[n].astype(float), nodes.position[n].astype(float)
        facing = normal @ [0.0, 0.6, -0.8] * (-1 if normal @ position > 0 else 1) if normal.any() else 1.0
        shade = 0.2 + 0.8 * max(facing, 0.0)
        np.testing.assert_allclose(made.records[n, ewa.RED : ewa.BLUE + 1], shade * nodes.color[n], rtol=1e-5)


def test_depth_is_that_of_the_points_plane() -> None:
    """At its centre exactly 1/z, and beside it that of the plane through it: no bias is left in the record."""
    rng = np.random.default_rng(10)
    nodes, made = scene(rng, 200, ewa.RECONSTRUCTION)
    for n in np.flatnonzero((made.boxes[:, 0] <= made.boxes[:, 1]) & nodes.normal.any(axis=1)):
        record, (x0, _, y0, _, _) = made.records[n].astype(float), made.boxes[n]
        o, normal = nodes.position[n].astype(float), nodes.normal[n].astype(float)
        assert record[ewa.INVERSE_Z] == pytest.approx(1 / o[2], rel=1e-6)
        u, v = x0 + 0.5 + record[ewa.U], y0 + 0.5 + record[ewa.V]
        np.testing.assert_allclose([u, v], (K @ o)[:2] / o[2], atol=1e-3)
        d = np.linalg.inv(K) @ [u + 1.0, v - 2.0, 1.0]
        exact = (normal @ d) / (normal @ o)
        slope = record[ewa.INVERSE_Z] + record[ewa.SLOPE_X] - 2 * record[ewa.SLOPE_Y]
        assert slope == pytest.approx(exact, rel=1e-3, abs=1e-4 * abs(record[ewa.SLOPE_X]))


@pytest.mark.parametrize("by_axes", [False, True])
def test_each_point_gets_the_filter_of_its_own_size(by_axes: bool) -> None:
    rng = np.random.default_rng(11)
    nodes, made = scene(rng, 400, ewa.EACH_POINT, eta=1.3, by_axes=by_axes)
    seen = set()
    for n in np.flatnonzero(made.boxes[:, 0] <= made.boxes[:, 1]):
        o, normal, r = nodes.position[n].astype(float), nodes.normal[n].astype(float), float(nodes.radius[n])
        normal = normal if normal.any() else -o / np.linalg.norm(o)
        cosine = abs(normal @ o) / np.linalg.norm(o)
        area = r * r * K[0, 0] * K[1, 1] * cosine / o[2] ** 2
        xx, xy, yy, _ = ewa.screen_covariance(*o, tuple(normal), K)
        least, most = r * r * np.linalg.eigvalsh([[xx, xy], [xy, yy]])
        low, high = (most, least) if by_axes else (1.3 * area, area)
        wanted = ewa.RECONSTRUCTION if high > 3.0 else ewa.LOW_PASS if low < 0.3 else ewa.FULL
        if min(abs(high - 3.0), abs(low - 0.3)) > 1e-4:
            assert made.boxes[n, 4] == wanted
        seen.add(wanted)
    assert seen == {ewa.FULL, ewa.RECONSTRUCTION, ewa.LOW_PASS}
