"""The tree and its watertight triangle test against loops over all triangles."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.raster.records import NO_HOLES
from torchrender.kernels.rays import bvh as bvh_kernels
from torchrender.kernels.rays.bvh_build import STACK, Bvh, build_bvh
from torchrender.kernels.rays.watertight import TIE, Rays


def trace(bvh: Bvh, rays: Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The kernel, without holes."""
    found: tuple[np.ndarray, np.ndarray, np.ndarray] = bvh_kernels.trace(
        bvh, rays, np.zeros((0, 3), np.int32), NO_HOLES
    )
    return found


def rays_of(origins, directions, *, low=0.0, high=np.inf, ignore=-1, cull=False, any_hit=False) -> Rays:
    n = len(origins)
    span = np.stack([np.full(n, low), np.full(n, high)], axis=1)
    return Rays(
        np.ascontiguousarray(origins, np.float64), np.ascontiguousarray(directions, np.float64), span,
        np.full(n, ignore, np.int32), cull, any_hit,
    )  # fmt: skip


def brute(vertices, faces, rays: Rays) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Moeller and Trumbore against every triangle."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    t_out, id_out, w_out = (
        np.full(len(rays.origins), np.inf),
        np.full(len(rays.origins), -1),
        np.zeros((len(rays.origins), 2)),
    )
    for r, (o, d) in enumerate(zip(rays.origins, rays.directions, strict=True)):
        p = np.cross(d, c - a)
        det = ((b - a) * p).sum(1)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((o - a) * p).sum(1) / det
            q = np.cross(o - a, b - a)
            v = q @ d / det
            t = (q * (c - a)).sum(1) / det
            ok = (det != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > rays.span[r, 0]) & (t < rays.span[r, 1])
        ok &= np.arange(len(faces)) != rays.ignore[r]
        if rays.cull:
            ok &= det > 0
        if ok.any():
            best = t[ok].min()
            id_out[r] = np.flatnonzero(ok & (t <= best + TIE * abs(best)))[0]
            t_out[r], w_out[r] = t[id_out[r]], (u[id_out[r]], v[id_out[r]])
    return t_out, id_out, w_out


def soup(count: int, seed: int, size: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    corners = rng.random((count, 1, 3)) + size * rng.standard_normal((count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 2**31), count=st.integers(1, 300), cull=st.booleans(), low=st.sampled_from([0.0, 0.4]))
def test_first_hits_equal_a_loop_over_all_triangles(seed: int, count: int, cull: bool, low: float) -> None:
    vertices, faces = soup(count, seed)
    rng = np.random.default_rng(seed + 1)
    rays = rays_of(
        rng.random((40, 3)), rng.standard_normal((40, 3)), low=low, high=3.0, ignore=int(rng.integers(count)), cull=cull
    )
    t, triangle, weights = trace(build_bvh(vertices, faces), rays)
    t_loop, id_loop, w_loop = brute(vertices, faces, rays)
    np.testing.assert_array_equal(triangle, id_loop)
    np.testing.assert_allclose(t, t_loop, rtol=1e-10)
    np.testing.assert_allclose(weights, w_loop, atol=1e-6)
    np.testing.assert_array_equal(trace(build_bvh(vertices, faces), rays._replace(any_hit=True))[1] >= 0, id_loop >= 0)


def test_large_tree_equals_the_loop() -> None:
    """More triangles than one subtree holds."""
    vertices, faces = soup(9000, 5, 0.02)
    rng = np.random.default_rng(6)
    rays = rays_of(rng.random((100, 3)), rng.standard_normal((100, 3)))
    t, triangle, _ = trace(build_bvh(vertices, faces), rays)
    t_loop, id_loop, _ = brute(vertices, faces, rays)
    np.testing.assert_array_equal(triangle, id_loop)
    np.testing.assert_allclose(t, t_loop, rtol=1e-11)


def leaves(bvh: Bvh) -> tuple[np.ndarray, int]:
    """How often each slot is in a leaf, and the depth of the tree; every child's box lies in its parent's."""
    seen, deepest, todo = np.zeros(len(bvh.order), int), 0, [(1, 1)]
    while todo:
        node, depth = todo.pop()
        deepest = max(deepest, depth)
        first, second = (int(x) for x in bvh.links[node])
        if first < 0:
            seen[-first - 1 : -first - 1 + second] += 1
            continue
        for child in (first, second):
            assert (bvh.boxes[child, :3] >= bvh.boxes[node, :3]).all()
            assert (bvh.boxes[child, 3:] <= bvh.boxes[node, 3:]).all()
            todo.append((child, depth + 1))
    return seen, deepest


@pytest.mark.parametrize("count", [1, 4, 5, 4095, 4096, 5001])
def test_each_triangle_is_in_one_leaf(count: int) -> None:
    bvh = build_bvh(*soup(count, count))
    assert (leaves(bvh)[0] == 1).all()
    np.testing.assert_array_equal(np.sort(bvh.order), np.arange(count))


def test_boxes_hold_their_triangles() -> None:
    vertices, faces = soup(500, 3)
    bvh = build_bvh(vertices * 1e3 + 1e6, faces)
    corners = bvh.corners.reshape(-1, 3, 3) - bvh.frame[:3]
    for node, (first, second) in enumerate(bvh.links):
        if first < 0:
            part = corners[-first - 1 : -first - 1 + second].reshape(-1, 3)
            assert (part >= bvh.boxes[node, :3]).all() and (part <= bvh.boxes[node, 3:]).all()


def test_a_million_coincident_triangles_build_and_answer() -> None:
    vertices = np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]])
    bvh = build_bvh(vertices, np.tile(np.arange(3, dtype=np.int32), (1_000_000, 1)))
    assert leaves_depth(bvh) < STACK
    t, triangle, _ = trace(bvh, rays_of([[0.2, 0.2, 0], [2, 2, 0]], [[0, 0, 1.0]] * 2))
    assert t[0] == 1 and triangle.tolist() == [0, -1]


def leaves_depth(bvh: Bvh) -> int:
    level, depth = np.array([1]), 0
    while len(level):
        depth += 1
        inner = level[bvh.links[level, 0] >= 0]
        level = bvh.links[inner].reshape(-1)
    return depth


def test_depth_stays_bounded_where_every_split_peels_one_triangle_off() -> None:
    place = 2.0 ** np.arange(-400, 400, 0.25)
    corners = place[:, None, None] * (1 + 0.01 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    bvh = build_bvh(corners.reshape(-1, 3), np.arange(3 * len(place), dtype=np.int32).reshape(-1, 3))
    seen, depth = leaves(bvh)
    assert (seen == 1).all() and depth < STACK


def test_triangles_without_area_are_left_out() -> None:
    vertices = np.array([[0.0, 0, 0], [1 / 8, 2 / 8, 3 / 8], [3 / 8, 6 / 8, 9 / 8], [1, 0, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 0, 3], [1, 1, 1], [0, 3, 4]], np.int32)
    assert build_bvh(vertices, faces).order.tolist() == [3]
    none = build_bvh(vertices, faces[:3])
    assert trace(none, rays_of([[1 / 8, 2 / 8, -1]], [[0, 0, 1.0]]))[1].tolist() == [-1]
    assert trace(build_bvh(np.zeros((0, 3)), np.zeros((0, 3), np.int32)), rays_of([[0, 0, 0]], [[0, 0, 1.0]]))[1] == [
        -1
    ]


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e30, 1e140])
def test_tiny_and_huge_scenes_do_not_underflow(scale: float) -> None:
    vertices, faces = soup(50, 9)
    rng = np.random.default_rng(1)
    rays = rays_of(rng.random((100, 3)), rng.standard_normal((100, 3)))
    t, triangle, _ = trace(build_bvh(vertices, faces), rays)
    scaled = trace(build_bvh(vertices * scale, faces), rays._replace(origins=rays.origins * scale))
    np.testing.assert_array_equal(scaled[1], triangle)
    np.testing.assert_allclose(scaled[0] / scale, t, rtol=1e-9)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 2**31))
def test_inside_is_never_missed_by_exact_arithmetic(seed: int) -> None:
    """A hit in rational arithmetic is a hit in float64, also on edges and with coordinates of any size."""
    rng = np.random.default_rng(seed)
    corners = 10.0 ** rng.uniform(-8, 8, (3, 3)) * rng.choice([-1, 1], (3, 3))
    weights = rng.dirichlet([0.3] * 3)
    target = corners[rng.integers(3)] if seed % 3 == 0 else weights @ corners
    d = np.zeros(3)
    d[rng.integers(3)] = 1.0  # axis-parallel: no shear, and a target's other coordinates stay exact
    o = target - d * 4e8
    exact = [[Fraction(float(x)) for x in row] for row in corners]
    axis = int(np.argmax(d))
    x, y = (axis + 1) % 3, (axis + 2) % 3
    p = [(c[x] - Fraction(float(o[x])), c[y] - Fraction(float(o[y]))) for c in exact]
    signs = [a[0] * b[1] - a[1] * b[0] for a, b in ((p[1], p[2]), (p[2], p[0]), (p[0], p[1]))]
    if min(signs) < 0 < max(signs) or sum(signs) == 0:
        return
    bvh = build_bvh(corners, np.array([[0, 1, 2]], np.int32))
    assert trace(bvh, rays_of(o[None], d[None]))[1].tolist() == ([0] if len(bvh.order) else [-1])
