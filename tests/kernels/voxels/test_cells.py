"""The voxel kernels against slow, obvious twins."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.voxels import columns as columns
from torchrender.kernels.voxels.bits import count_ones
from torchrender.kernels.voxels.fragments import CORNERS, clipped
from torchrender.voxels.grid import Voxels
from torchrender.voxels.solid import flood
from torchrender.voxels.soup import winding_numbers
from torchrender.voxels.surface import SurfaceOptions, dominant_axes, voxelize_surface
from voxel_shapes import ball_grid, box_test, cell_indices, column_test, icosphere, unit_grid

DIMS = (9, 7, 8)


def one(triangle: np.ndarray, mode: str) -> np.ndarray:
    faces = torch.tensor([[0, 1, 2]])
    found = voxelize_surface(torch.from_numpy(triangle)[None], faces, unit_grid(*DIMS), SurfaceOptions(mode=mode))
    return found.dense()[0].numpy()


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 100_000), size=st.sampled_from([0.3, 1.0, 3.0, 12.0]), flat=st.sampled_from([1.0, 1e-3, 0.0])
)
def test_one_triangle_equals_the_box_test(seed: int, size: float, flat: float) -> None:
    """Small and large triangles, slivers, in layers of cells, partly outside."""
    rng = np.random.default_rng(seed)
    triangle = rng.uniform(-1, 9, 3) + rng.uniform(-size, size, (3, 3)) * np.where(rng.random(3) < 0.7, 1.0, flat)
    found = one(triangle, "conservative")
    assert np.array_equal(found, box_test(triangle, DIMS))
    thin = one(triangle, "thin")
    assert np.array_equal(thin, column_test(triangle, DIMS))
    assert not (thin & ~found).any()


@settings(deadline=None, max_examples=60)
@given(corners=st.lists(st.integers(-2, 10), min_size=9, max_size=9))
def test_corners_on_cell_corners(corners: list[int]) -> None:
    """Whole coordinates: triangles lie exactly on the faces, edges and corners of cells."""
    triangle = np.array(corners, float).reshape(3, 3)
    assert np.array_equal(one(triangle, "conservative"), box_test(triangle, DIMS))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("beyond", [False, True], ids=["before", "beyond"])
@pytest.mark.parametrize("mode", ["conservative", "thin"])
def test_small_triangles_beside_the_grid_meet_nothing(axis: int, beyond: bool, mode: str) -> None:
    """Each within a single cell of the layer next to the grid: no other row, of another axis, gets it."""
    rng = np.random.default_rng(axis)
    for _ in range(20):
        place = rng.integers(0, DIMS)
        place[axis] = DIMS[axis] if beyond else -1
        triangle = place + rng.uniform(0.1, 0.9, (3, 3))
        assert not one(triangle, mode).any()
        triangle[:, axis] += -1 if beyond else 1
        found = one(triangle, "conservative")
        place[axis] += -1 if beyond else 1
        assert found.sum() == 1 and found[tuple(place[::-1])]


def test_many_triangles_are_the_union_and_each_is_met_once() -> None:
    rng = np.random.default_rng(3)
    points = rng.uniform(-1, 9, (40, 3))
    faces = rng.integers(0, 40, (300, 3))
    found = voxelize_surface(torch.from_numpy(points)[None], torch.from_numpy(faces), unit_grid(*DIMS))
    twins = np.stack([box_test(points[f], DIMS) for f in faces])
    assert np.array_equal(found.dense()[0].numpy(), twins.any(axis=0))
    assert found.stats["pairs"] == twins.sum()
    repeated = (faces == np.roll(faces, 1, axis=1)).any(axis=1)
    assert found.stats["flat"] == repeated.sum() > 0


def test_dominant_axis() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(30, 3))
    faces = rng.integers(0, 30, (200, 3))
    corners = points[faces]
    normal = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    wanted = np.where(normal.any(axis=1), normal.argmax(axis=1), -1)
    assert dominant_axes(torch.from_numpy(points), torch.from_numpy(faces)).tolist() == wanted.tolist()
    tie = torch.tensor([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    assert dominant_axes(tie, torch.tensor([[0, 1, 2]])).tolist() == [0]


def crossings_twin(snapped: np.ndarray, faces: np.ndarray, axis: int, bits: int, size: tuple[int, ...]) -> list[list]:
    """Crossings of every column, in Python's unbounded integers."""
    a, b = (k for k in range(3) if k != axis)
    half = 1 << (bits - 1)
    out: list[list] = [[] for _ in range(size[0] * size[1])]
    for face in faces:
        v = [[int(snapped[i][k]) for k in (a, b, axis)] for i in face]
        area = (v[1][0] - v[0][0]) * (v[2][1] - v[0][1]) - (v[2][0] - v[0][0]) * (v[1][1] - v[0][1])
        if area == 0:
            continue
        code = 2 if area > 0 else 0
        if area < 0:
            v[1], v[2], area = v[2], v[1], -area
        for ib in range(size[1]):
            for ia in range(size[0]):
                px, py = (ia << bits) + half, (ib << bits) + half
                weights, inside = [], True
                for e in range(3):
                    p, q = v[e], v[(e + 1) % 3]
                    dx, dy = q[0] - p[0], q[1] - p[1]
                    value = dx * (py - p[1]) - dy * (px - p[0])
                    inside &= value > 0 or (value == 0 and (dy < 0 or (dy == 0 and dx > 0)))
                    weights.append(value)
                if not inside:
                    continue
                depth = weights[1] * v[0][2] + weights[2] * v[1][2] + weights[0] * v[2][2]  # times the area
                k = -((half * area - depth) // (area << bits))
                out[ib * size[0] + ia].append(4 * min(max(k, 0), size[2]) + code)
    return out


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 100_000), axis=st.integers(0, 2), bits=st.integers(4, 10), step=st.sampled_from([1, 64, 8]))
def test_crossings_equal_exact_integers(seed: int, axis: int, bits: int, step: int) -> None:
    """Also where corners and edges run through the centres of columns."""
    rng = np.random.default_rng(seed)
    size = (*(DIMS[k] for k in range(3) if k != axis), DIMS[axis])
    snapped = rng.integers(-200, 1200, (12, 3)).astype(np.int64) // step * step << (bits - 4) >> 2
    faces = rng.integers(0, 12, (30, 3)).astype(np.int32)
    counts, hits = np.zeros(size[0] * size[1], np.int64), np.zeros(30, np.bool_)
    where = columns.Columns(snapped, faces, axis, bits, *size)
    columns.find_crossings(where, 2, hits, counts, np.zeros(0, np.int32), np.zeros(1, np.int64))
    starts = np.concatenate([[0], np.cumsum(counts)])
    events = np.zeros(starts[-1], np.int32)
    if len(events):
        columns.find_crossings(where, 2, hits, starts[:-1].copy(), events, np.zeros(1, np.int64))
    twin = crossings_twin(snapped, faces, axis, bits, size)
    assert [sorted(events[starts[n] : starts[n + 1]].tolist()) for n in range(len(counts))] == [sorted(c) for c in twin]


def test_huge_triangles_keep_their_depth() -> None:
    """Beyond the range of 64-bit products the depth is found in floats, not wrapped around."""
    far = 1 << 22
    snapped = np.array([[-far, -far, 1000], [far, -far, 1000], [0, far, 1000]], np.int64)
    assert far > columns.EXACT
    counts, hits = np.zeros(16, np.int64), np.zeros(1, np.bool_)
    where = columns.Columns(snapped, np.array([[0, 1, 2]], np.int32), 2, 8, 4, 4, 9)
    columns.find_crossings(where, 2, hits, counts, np.zeros(0, np.int32), np.zeros(1, np.int64))
    assert counts.tolist() == [1] * 16
    events = np.zeros(16, np.int32)
    columns.find_crossings(where, 2, hits, np.arange(16), events, np.zeros(1, np.int64))
    assert (events >> 2).tolist() == [4] * 16  # 1000 / 256 = 3.9: the first centre above is 4.5


def test_winding_numbers_equal_the_sum_of_solid_angles() -> None:
    """Against every triangle's angle on its own; dipoles are good to a hundredth."""
    vertices, faces = icosphere(3)
    grid, half = ball_grid(9, 1.6), faces[: len(faces) // 2]
    found = winding_numbers(vertices[0].numpy(), half.numpy().astype(np.int32), grid)
    centres = grid.centres(cell_indices(grid.dims))
    a, b, c = (vertices[0][half[:, k]] - centres[..., None, :] for k in range(3))
    la, lb, lc = (v.norm(dim=-1) for v in (a, b, c))
    det = (a * torch.linalg.cross(b, c)).sum(-1)
    angle = 2 * torch.atan2(det, la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb)
    wanted = angle.sum(-1) / (4 * torch.pi)
    assert float((found - wanted).abs().amax()) < 0.01
    assert float(wanted.amax()) > 0.4


def test_counting_bits() -> None:
    words = np.random.default_rng(0).integers(0, 2**64, 999, dtype=np.uint64)
    assert count_ones(words) == sum(int(w).bit_count() for w in words)


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), share=st.floats(0.3, 0.9))
def test_flood_equals_a_queue(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    nx, ny, nz = 70, 6, 5
    free = rng.random((nz, ny, nx)) < share
    grid = unit_grid(nx, ny, nz)
    packed = Voxels.from_dense(torch.from_numpy(free)[None], grid)
    found = Voxels(flood(packed.words[0], nx)[None], grid).dense()[0].numpy()
    reached = np.zeros_like(free)
    border = np.ones_like(free)
    border[1:-1, 1:-1, 1:-1] = False
    waiting = list(zip(*np.nonzero(free & border), strict=True))
    while waiting:
        cell = waiting.pop()
        if reached[cell]:
            continue
        reached[cell] = True
        for axis in range(3):
            for step in (-1, 1):
                near = list(cell)
                near[axis] += step
                if all(0 <= n < s for n, s in zip(near, free.shape, strict=True)) and free[tuple(near)]:
                    waiting.append(tuple(near))
    assert np.array_equal(found, reached)


@settings(deadline=None, max_examples=50)
@given(seed=st.integers(0, 100_000))
def test_clipped_area_equals_sampling(seed: int) -> None:
    """Share and centroid of the part of a triangle inside a cell, against a fine grid of points on the triangle."""
    rng = np.random.default_rng(seed)
    p, cell = rng.uniform(-1.0, 2.0, (3, 3)), np.zeros(3)
    u, v, share = clipped(p, cell, np.zeros((CORNERS, 2)), np.zeros((CORNERS, 2)))
    n = 300
    a, b = (np.arange(n)[:, None] + 0.5) / n, (np.arange(n) + 0.5) / n
    a, b = np.broadcast_arrays(a, b)
    points = p[0] + a[..., None] * (p[1] - p[0]) + b[..., None] * (p[2] - p[0])
    inside = (a + b <= 1) & ((points >= 0) & (points <= 1)).all(axis=-1)
    assert abs(inside.mean() - share / 2) < 0.01
    if inside.sum() > 500:
        assert abs(a[inside].mean() - u) < 0.02 and abs(b[inside].mean() - v) < 0.02
