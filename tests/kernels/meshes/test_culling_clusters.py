"""Orders, boxes and vertex blocks of clusters, in sets and sorts."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.meshes.culling_clusters import (
    BITS,
    cluster_boxes,
    first_use,
    morton_codes,
    radix_order,
    spatial_order,
    spread,
    vertex_blocks,
)
from torchrender.kernels.raster.project import BLOCK, needed_blocks, visible_clusters


def test_bits_are_spread_three_places_apart() -> None:
    for value in (*range(70), 511, 512, 1023):
        assert spread(value) == sum(1 << (3 * k) for k in range(10) if (value >> k) & 1)


@pytest.mark.parametrize("count", [0, 1, 7, 3000])
def test_the_order_is_stable(count: int) -> None:
    rng = np.random.default_rng(count)
    codes = rng.integers(0, 1 << 23, count) & ~0xFF0
    np.testing.assert_array_equal(radix_order(codes, 23), np.argsort(codes, kind="stable"))


def test_codes_follow_runs_and_cells() -> None:
    rng = np.random.default_rng(1)
    vertices, faces = rng.normal(size=(90, 3)), rng.integers(0, 90, (40, 3)).astype(np.int32)
    faces[25:30, 0] = 3  # no extent
    starts = np.array([0, 25, 30, 40])
    codes = np.zeros(40, np.int64)
    morton_codes(vertices, faces, starts, codes)
    for run in range(3):
        first = vertices[faces[starts[run] : starts[run + 1], 0]]
        low, size = first.min(axis=0), np.ptp(first, axis=0)
        for k, point in enumerate(first):
            share = np.divide(point - low, size, out=np.zeros(3), where=size > 0)
            cell = (share * ((1 << BITS) - 1)).astype(int)
            code = 0
            for bit in range(BITS):
                for axis in range(3):
                    code |= ((int(cell[axis]) >> bit) & 1) << (3 * bit + 2 - axis)
            assert codes[starts[run] + k] == (run << (3 * BITS)) | code
    order = spatial_order(vertices, faces, starts)
    assert sorted(order[:25].tolist()) == list(range(25)) and sorted(order[30:].tolist()) == list(range(30, 40))


def test_vertices_are_numbered_as_they_are_first_used() -> None:
    rng = np.random.default_rng(4)
    faces, order = rng.integers(0, 40, (25, 3)).astype(np.int32), rng.permutation(25).astype(np.int32)
    used, renamed, listed = first_use(faces, order, 50)
    assert used.tolist() == list(dict.fromkeys(faces[order].reshape(-1).tolist()))
    np.testing.assert_array_equal(used[renamed], faces)
    np.testing.assert_array_equal(listed, renamed[order])
    assert [len(a) for a in first_use(faces[:0], order[:0], 5)] == [0, 0, 0]


def test_boxes_and_blocks_against_sets() -> None:
    rng = np.random.default_rng(2)
    vertices, faces = rng.normal(size=(5 * BLOCK + 3, 3)), rng.integers(0, 5 * BLOCK + 3, (60, 3)).astype(np.int32)
    faces[:20] = faces[:20] % BLOCK
    order = rng.permutation(60).astype(np.int32)
    clusters = np.array([[0, 20], [20, 21], [21, 60]])
    boxes = np.zeros((3, 2, 3))
    cluster_boxes(vertices, faces, order, clusters, boxes)
    starts, blocks = vertex_blocks(faces, order, clusters, len(vertices))
    for c, (first, end) in enumerate(clusters):
        used = faces[order[first:end]].reshape(-1)
        np.testing.assert_array_equal(boxes[c], [vertices[used].min(axis=0), vertices[used].max(axis=0)])
        own = blocks[starts[c] : starts[c + 1]]
        assert sorted(own.tolist()) == sorted(set((used // BLOCK).tolist()))
    for chosen in ([], [0], [1, 2]):
        wanted = sorted({int(b) for c in chosen for b in blocks[starts[c] : starts[c + 1]]})
        assert needed_blocks(np.array(chosen, np.int64), starts, blocks, len(vertices)).tolist() == wanted


def test_clusters_in_view_are_those_with_a_corner_inside_every_plane() -> None:
    rng = np.random.default_rng(3)
    centre, half = rng.uniform(-3, 3, (200, 1, 3)), rng.uniform(0.01, 0.5, (200, 1, 3))
    bounds = np.concatenate([centre - half, centre + half], axis=1)
    planes = np.concatenate([rng.normal(size=(6, 3)), rng.uniform(0, 2, (6, 1))], axis=1)
    chosen, distance = visible_clusters(bounds, planes)
    picks = np.array(np.meshgrid(*[[0, 1]] * 3)).reshape(3, 8).T
    corners = np.stack([bounds[:, p, range(3)] for p in picks], axis=1)
    values = corners @ planes[:, :3].T + planes[:, 3]  # (C,8,6)
    wanted = np.flatnonzero((values.max(axis=1) >= 0).all(axis=1))
    assert 0 < len(wanted) < 200
    np.testing.assert_array_equal(chosen, wanted)
    np.testing.assert_allclose(distance, values[wanted, :, 4].min(axis=1), rtol=1e-12, atol=1e-12)
