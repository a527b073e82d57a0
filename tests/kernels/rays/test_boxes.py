"""Frames, groups, records and boxes against loops."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.rays.boxes import (
    IDS,
    LINE,
    SCALE,
    WIDE,
    count_pieces,
    cut_boxes,
    frame_of,
    group_triangles,
    has_area,
    pack_groups,
)

PAD = 1e-6


def grid(n: int) -> tuple[np.ndarray, np.ndarray]:
    """A rough height field with a few triangles without area among the others."""
    x, z = np.meshgrid(np.linspace(-3, 3, n), np.linspace(-1, 1, n), indexing="ij")
    y = 0.3 * np.sin(3 * x) + 0.2 * z
    i = np.arange(n * n).reshape(n, n)
    a, b, c, d = i[:-1, :-1].ravel(), i[1:, :-1].ravel(), i[1:, 1:].ravel(), i[:-1, 1:].ravel()
    faces = np.stack([a, b, c, a, c, d], 1).reshape(-1, 3).astype(np.int32)
    faces[::17, 1] = faces[::17, 0]
    return np.stack([x, y, z], -1).reshape(-1, 3) + 5.0, faces


def soup(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    corners = rng.random((count, 1, 3)) + 10.0 ** rng.uniform(-3, 0, (count, 1, 1)) * rng.standard_normal((count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count, dtype=np.int32).reshape(-1, 3)


SCENES = pytest.mark.parametrize("scene", [grid(20), soup(500), soup(1)], ids=["grid", "soup", "one"])


def packed_of(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, ...]:
    frame = frame_of(vertices, faces)
    points, starts = vertices * frame[SCALE], np.zeros(len(faces), np.int32)
    first = group_triangles(points, faces, starts)
    packed, waste = np.zeros((first[-1], LINE)), np.zeros(first[-1], np.float32)
    sums = pack_groups((points, faces), starts, first, packed, waste, PAD).sum(axis=0)
    return frame, points, packed, waste, np.array(sums)


@SCENES
def test_the_frame_is_the_scaled_box(scene: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = scene
    frame, used = frame_of(vertices, faces), vertices[faces.ravel()]
    half = (used.max(0) - used.min(0)).max() / 2
    assert 0.5 < half * frame[SCALE] <= 1 and np.log2(frame[SCALE]) % 1 == 0
    np.testing.assert_allclose(frame[4:7] + frame[:3], used.min(0) * frame[SCALE], rtol=1e-15)
    np.testing.assert_allclose(frame[7:] + frame[:3], used.max(0) * frame[SCALE], rtol=1e-15)


@SCENES
def test_each_triangle_with_an_area_is_in_one_group(scene: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = scene
    _, points, packed, _, _ = packed_of(vertices, faces)
    ids = packed.view(np.int64)[:, IDS:]
    corners = vertices[faces]
    wanted = [i for i, (a, b, c) in enumerate(corners) if has_area(*(b - a), *(c - a))]
    assert ids[ids >= 0].tolist() == wanted
    kept = packed[:, :IDS].reshape(-1, 3, 3, WIDE).transpose(0, 3, 1, 2)
    np.testing.assert_array_equal(kept[ids >= 0], points[faces[wanted]])


def test_neighbours_share_groups_and_strangers_do_not() -> None:
    assert len(packed_of(*grid(20))[2]) < 0.5 * len(grid(20)[1])
    assert len(packed_of(*soup(500))[2]) > 0.8 * 500


@SCENES
def test_sums_equal_a_loop(scene: tuple[np.ndarray, np.ndarray]) -> None:
    vertices, faces = scene
    _, points, packed, waste, sums = packed_of(vertices, faces)
    wanted = np.zeros(4)
    for row, own in zip(packed, waste, strict=True):
        t = row.view(np.int64)[IDS:]
        p = points[faces[t[t >= 0]]]
        x, y, z = p.max(axis=(0, 1)) - p.min(axis=(0, 1))
        box = 2 * (x * y + y * z + z * x)
        shadow = np.abs(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])).sum()
        excess = max(box - 2 * shadow, 0) ** 0.5
        np.testing.assert_allclose(own, excess, atol=1e-4)
        wanted += box, 8 * PAD * (x + y + z) + 24 * PAD**2 > 3 * box, min(shadow, box / 2), own
    np.testing.assert_allclose(sums, wanted, rtol=1e-5)


@SCENES
def test_boxes_cover_their_triangles_and_no_more_than_needed(scene: tuple[np.ndarray, np.ndarray]) -> None:
    """Random points of every triangle lie in a box of its group, half the padding inside."""
    vertices, faces = scene
    frame, points, packed, waste, sums = packed_of(vertices, faces)
    first = np.zeros(len(waste) + 1, np.int32)
    count_pieces(waste, 2.0 * len(waste) / max(sums[3], 1e-300), first)
    boxes, owner = np.zeros((first[-1], 6), np.float32), np.zeros(first[-1], np.int32)
    cut_boxes(packed, frame, first, PAD, boxes, owner)
    rng = np.random.default_rng(1)
    for g in range(len(waste)):
        t = packed[g].view(np.int64)[IDS:]
        p = points[faces[t[t >= 0]]] - frame[:3]
        samples = np.einsum("nk,tkj->tnj", rng.dirichlet([0.5] * 3, 40), p).reshape(-1, 3)
        own = boxes[first[g] : first[g + 1]].astype(float)
        assert (owner[first[g] : first[g + 1]] == g).all() and 1 <= len(own) <= 16
        inside = (samples[:, None] >= own[:, :3] + PAD / 2) & (samples[:, None] <= own[:, 3:] - PAD / 2)
        assert inside.all(axis=2).any(axis=1).all()
        own = own[np.isfinite(own).all(axis=1)]
        assert (own[:, :3].min(0) >= p.min(axis=(0, 1)) - 2 * PAD).all()
        assert (own[:, 3:].max(0) <= p.max(axis=(0, 1)) + 2 * PAD).all()
    assert len(boxes) >= len(waste)


def test_long_slanted_triangles_are_cut_and_square_ones_are_not() -> None:
    first = np.zeros(4, np.int32)
    count_pieces(np.array([0.0, 1.0, 100.0], np.float32), 3.5, first)
    assert first.tolist() == [0, 1, 5, 21]
