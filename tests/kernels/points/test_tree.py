"""Splits, merges and headers of point trees, point by point."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.points.records import Nodes
from torchrender.kernels.points.tree import (
    Headers,
    Limits,
    cone,
    fill_nodes,
    flatness,
    levels_of,
    moments,
    select,
    size_of,
    split_segments,
)


def cloud(rng: np.random.Generator, count: int) -> Nodes:
    normal = rng.normal(size=(count, 3)) * 0.1 + [0, 0, 1.0]
    normal = (normal / np.linalg.norm(normal, axis=1, keepdims=True)).astype(np.float32)
    position = rng.normal(size=(count, 3)) * [3, 1, 0.2] + [50.0, 0, 0]
    return Nodes(position, normal, rng.uniform(0.1, 0.3, count).astype(np.float32),
                 rng.random((count, 3)).astype(np.float32), True)  # fmt: skip


def matrix(c: tuple[float, ...]) -> np.ndarray:
    xx, xy, xz, yy, yz, zz = c
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@pytest.mark.parametrize("count", [1, 2, 40])
def test_moments_flatness_and_cone(count: int) -> None:
    rng = np.random.default_rng(count)
    points = cloud(rng, 50)
    order = rng.permutation(50)
    own = order[5 : 5 + count]
    mean, covariance = moments(points.position, order, 5, 5 + count)
    np.testing.assert_allclose(mean, points.position[own].mean(axis=0), rtol=1e-12)
    centred = points.position[own] - points.position[own].mean(axis=0)
    np.testing.assert_allclose(matrix(covariance), centred.T @ centred / count, atol=1e-12)
    values = np.linalg.eigvalsh(centred.T @ centred)
    assert flatness(covariance) == pytest.approx(values[0] / values.sum() if count > 1 else 0.0, abs=1e-7)
    *axis, half = cone(points.normal, order, 5, 5 + count)
    total = points.normal[own].astype(float).sum(axis=0)
    np.testing.assert_allclose(axis, total / np.linalg.norm(total), rtol=1e-6)
    widest = np.arccos(np.clip(points.normal[own].astype(float) @ (total / np.linalg.norm(total)), -1, 1)).max()
    assert widest <= half <= widest + 2e-3
    points.normal[own[0]] = 0.0
    assert cone(points.normal, order, 5, 5 + count)[3] == math.pi


def test_quickselect() -> None:
    rng = np.random.default_rng(1)
    for count in (2, 3, 30):
        for _ in range(30):
            key = rng.integers(0, 6, count).astype(float)
            order, before = np.arange(count), key.copy()
            middle = int(rng.integers(1, count))
            select(key, order, 0, count, middle)
            assert key[:middle].max() <= key[middle:].min()
            np.testing.assert_array_equal(before[order], key)


def test_segments_become_patches_or_are_halved_across_the_longest_axis() -> None:
    rng = np.random.default_rng(2)
    points = cloud(rng, 120)
    points.normal[100:] = rng.normal(size=(20, 3))  # too wide a cone
    order = np.arange(120)
    segments = np.array([[0, 8], [8, 40], [40, 100], [100, 120]])
    sigma = [flatness(moments(points.position, order, a, b)[1]) for a, b in segments]
    limits = Limits(10, 50, max(sigma) * 1.01, 1.0)
    middle = np.zeros(4, np.int64)
    split_segments(points, order, np.zeros(120), segments, limits, 2, middle)
    assert middle.tolist() == [-1, -1, 70, 110]  # few; flat; too many; normals apart
    for low, at, high in ((40, 70, 100), (100, 110, 120)):
        assert sorted(order[low:high]) == list(range(low, high))
        own = points.position[order[low:high]]
        axis = np.linalg.eigh(np.cov(own.T))[1][:, 2]
        along = own @ axis
        along = along if along[: at - low].mean() < along[at - low :].mean() else -along
        assert along[: at - low].max() <= along[at - low :].min() + 0.05 * np.ptp(along)
    tight = limits._replace(sigma_max=min(sigma) * 0.5)
    split_segments(points, np.arange(120), np.zeros(120), segments, tight, 1, middle)
    assert middle.tolist() == [-1, 24, 70, 110]


@pytest.mark.parametrize("count", [1, 2, 5, 8, 13])
def test_nodes_of_a_patch(count: int) -> None:
    """Every level holds all the points; parents are means by squared radius and enclose their children."""
    rng = np.random.default_rng(count)
    points = cloud(rng, count)
    levels = levels_of(count)
    assert levels == math.ceil(math.log2(count)) + 1
    width = [1 << k for k in range(levels - 1)] + [count]
    starts = np.concatenate([[0], np.cumsum(width), [0] * 2])[None].astype(np.int64)
    starts[0, levels + 1 :] = starts[0, levels]
    total = int(starts[0, levels])
    nodes = Nodes(*(np.zeros((total, 3), np.float32) for _ in range(2)), np.zeros(total, np.float32),
                  np.zeros((total, 3), np.float32), True)  # fmt: skip
    headers = Headers(starts, np.zeros((1, levels + 1, 3)), np.zeros((1, 2, 3)), np.zeros((1, 4)), np.zeros(1))
    order = np.arange(count)
    fill_nodes(points, order, np.zeros(count), np.array([[0, count]]), 1, nodes, np.zeros(total), headers)
    box = np.stack([points.position.min(axis=0), points.position.max(axis=0)])
    np.testing.assert_array_equal(headers.boxes[0], box)
    centre, weight = box.mean(axis=0), points.radius.astype(float) ** 2
    for level in range(levels):
        first, low = starts[0, level], 0
        for k in range(width[level]):
            size = 1 if level == levels - 1 else size_of(count, level, k)
            own = order[low : low + size]
            low += size
            row, share = first + k, weight[own] / weight[own].sum()
            np.testing.assert_allclose(nodes.position[row], share @ points.position[own] - centre, atol=1e-5)
            np.testing.assert_allclose(nodes.color[row], share @ points.color[own], atol=1e-5)
            normal = share @ points.normal[own]
            np.testing.assert_allclose(nodes.normal[row], normal / np.linalg.norm(normal), atol=2e-2)
            away = np.linalg.norm(points.position[own] - centre - nodes.position[row], axis=1)
            assert nodes.radius[row] >= (away + points.radius[own]).max() * (1 - 1e-5)
            if size == 1:
                assert nodes.radius[row] == points.radius[own[0]]
        assert low == count
        radius = nodes.radius[first : first + width[level]].astype(float)
        np.testing.assert_allclose(headers.table[0, level], [radius.min(), radius.mean(), radius.max()], rtol=1e-12)
    np.testing.assert_array_equal(headers.table[0, levels], headers.table[0, levels - 1])
