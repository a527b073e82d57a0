"""Planes of keys and weights over the image, against exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numba
import numpy as np
import pytest

from torchrender.kernels.raster.lanes.vectors import LANES
from torchrender.kernels.raster.lanes.vertices import project_lanes
from torchrender.kernels.raster.project import (
    BLOCK,
    GUARD,
    NEEDS_CLIP,
    SUBPIXEL,
    area_in_view,
    barycentric_planes,
    key_plane,
    project_vertices,
    snapped_x,
    snapped_y,
)
from torchrender.kernels.raster.records import Frame

FACES = np.array([[0, 1, 2]], np.int32)


def weights_at(points: np.ndarray, x: Fraction, y: Fraction, orthographic: bool) -> list[Fraction]:
    """Perspective-correct weights of the three corners at a pixel: the point of the plane on the pixel's ray."""
    q = [[Fraction(v) for v in row[:3]] for row in points]
    w = [Fraction(1) if orthographic else row[2] for row in q]
    lines = []
    for k in range(3):
        a, b = (k + 1) % 3, (k + 2) % 3
        lines.append(
            (q[a][1] * w[b] - w[a] * q[b][1]) * x
            + (w[a] * q[b][0] - q[a][0] * w[b]) * y
            + q[a][0] * q[b][1] - q[a][1] * q[b][0]
        )  # fmt: skip
    total = sum(lines)
    return [value / total for value in lines]


@pytest.mark.parametrize("orthographic", [False, True])
def test_planes_are_the_exact_ones(orthographic: bool) -> None:
    rng = np.random.default_rng(0)
    frame = Frame(64, 48, 0.1, 100.0, orthographic)
    for _ in range(200):
        z = rng.uniform(0.5, 9, 3)
        place = rng.uniform(-40, 40, (3, 2))
        points = np.column_stack([place * (1.0 if orthographic else z[:, None]), z, z])
        kx, ky, kc, low, high = key_plane(points, FACES, 0, frame)
        ux, uy, uc, vx, vy, vc = barycentric_planes(points, FACES, 0, orthographic)
        keys = -z if orthographic else 1.0 / z
        assert low == pytest.approx(keys.min(), rel=1e-15) and high == pytest.approx(keys.max(), rel=1e-15)
        for x, y in rng.uniform(-30, 30, (4, 2)):
            a, b, c = weights_at(points, Fraction(x), Fraction(y), orthographic)
            exact = sum(w * Fraction(k) for w, k in zip((a, b, c), z, strict=True))
            key = float(-exact) if orthographic else float(1 / exact) if exact else np.inf
            scale = np.abs([kx * x, ky * y, kc]).sum()
            assert kx * x + ky * y + kc == pytest.approx(key, abs=1e-11 * scale)
            # Planes hold weight times key: weight / z, or the weight itself.
            share = 1 if orthographic else 1 / exact
            for found, weight in ((ux * x + uy * y + uc, b), (vx * x + vy * y + vc, c)):
                size = max(abs(ux * x), abs(uy * y), abs(uc), abs(vx * x), abs(vy * y), abs(vc))
                assert found == pytest.approx(float(weight * share), abs=1e-10 * size)


@pytest.mark.parametrize("orthographic", [False, True])
def test_a_triangle_seen_edge_on_has_its_mean_key(orthographic: bool) -> None:
    points = np.array([[1.0, 1.0, 2.0, 0], [1.0, 1.0, 2.0, 0], [3.0, 3.0, 4.0, 0]])
    kx, ky, kc, low, high = key_plane(points, FACES, 0, Frame(64, 48, 0.1, 100.0, orthographic))
    assert (kx, ky) == (0.0, 0.0) and kc == 0.5 * (low + high)
    found = barycentric_planes(points, FACES, 0, orthographic)
    assert found[:2] == (0.0, 0.0) and found[2] == pytest.approx(1 / 3 if orthographic else 1 / 6)


def test_what_lies_before_the_near_plane_is_no_nearer_than_it() -> None:
    points = np.array([[-1.0, 0, 0.05, 0], [1.0, 0, 2.0, 0], [0.0, 1.0, 3.0, 0]])
    assert key_plane(points, FACES, 0, Frame(64, 48, 0.5, 100.0, False))[4] == 2.0


@pytest.mark.parametrize("orthographic", [False, True])
def test_area_in_view_is_that_of_squares_over_the_diagonals(orthographic: bool) -> None:
    rng = np.random.default_rng(7)
    bounds = np.sort(rng.uniform(-3, 3, (20, 2, 3)), axis=1)
    runs = np.stack([np.arange(20) * 10, np.arange(20) * 10 + rng.integers(1, 10, 20)], axis=1)
    chosen, distance = rng.permutation(20)[:12], rng.uniform(-1, 9, 12)
    frame = Frame(640, 480, 0.25, 100.0, orthographic)
    area, triangles = area_in_view(bounds, runs, (chosen, distance), 300.0, frame)
    size = np.linalg.norm(bounds[chosen, 1] - bounds[chosen, 0], axis=1)
    depth = 1.0 if orthographic else 0.25 + np.maximum(distance, 0) + size / 2
    assert area == pytest.approx(((300.0 * size / depth) ** 2).sum(), rel=1e-12)
    assert triangles == (runs[chosen, 1] - runs[chosen, 0]).sum()


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("count", [3, 8, 2 * BLOCK + 13])
def test_vertices_are_where_a_loop_puts_them(count: int, orthographic: bool) -> None:
    """Before the near plane, outside of the guard band and not finite, too; bit for bit."""
    rng = np.random.default_rng(count)
    matrix = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    matrix[:2] *= 900
    eye, near = rng.uniform(-5, 5, 3), 0.5
    vertices = eye + rng.uniform(-9, 9, (count, 3)) * rng.choice([0.1, 1, 40], (count, 1))
    vertices[1] = np.nan
    blocks = np.arange(-(-count // BLOCK))[-2:]
    out = np.full((count, 4), -7.0)
    project_vertices(vertices, blocks, matrix, eye, near, orthographic, out, out.view(np.int64))
    kinds = set()
    for v in range(count):
        if v // BLOCK not in blocks:
            assert (out[v] == -7).all()
            continue
        d = vertices[v] - eye
        x, y, w = (row[0] * d[0] + row[1] * d[1] + row[2] * d[2] for row in matrix)
        np.testing.assert_array_equal(out[v, :3], [x, y, w])
        px, py = (x, y) if orthographic else (x / w, y / w)
        inside = w >= near and abs(px) < GUARD and abs(py) < GUARD
        kinds.add(bool(inside))
        packed = int(out[v : v + 1].view(np.int64)[0, 3])
        if not inside:
            assert packed == NEEDS_CLIP
            continue
        assert snapped_x(packed) == np.floor(px * SUBPIXEL + 0.5) and snapped_y(packed) == np.floor(py * SUBPIXEL + 0.5)
    assert count < 9 or kinds == {False, True}


@numba.njit
def eight(vertices, first, pose, limits, out, fixed):
    project_lanes(vertices, np.uintp(first), pose, limits, out, fixed)


@pytest.mark.parametrize("orthographic", [False, True])
def test_eight_vertices_are_those_of_the_loop(orthographic: bool) -> None:
    """Of the same numbers one by one, which fewer than eight vertices take; their neighbours stay as they were."""
    rng = np.random.default_rng(3)
    vertices = rng.uniform(-6, 6, (3 * LANES, 3))
    pose, limits = (np.diag([700.0, 700.0, 1.0]), rng.uniform(-1, 1, 3)), (0.5, orthographic)
    found = np.full((len(vertices), 4), -7.0)
    eight(vertices, LANES, pose, limits, found, (float(GUARD), float(SUBPIXEL), NEEDS_CLIP))
    assert (found[:LANES] == -7).all() and (found[2 * LANES :] == -7).all()
    for v in range(LANES, 2 * LANES):
        alone = np.zeros((1, 4))
        project_vertices(vertices[v : v + 1], np.zeros(1, np.int64), *pose, *limits, alone, alone.view(np.int64))
        np.testing.assert_array_equal(found[v].view(np.int64), alone[0].view(np.int64))
