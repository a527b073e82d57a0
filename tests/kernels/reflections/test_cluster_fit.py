"""Sums and boxes of chunks of rays, ray by ray."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.reflections import cluster_fit
from torchrender.kernels.reflections.cluster_fit import Bundle, Pictures

COUNT, CLUSTERS = 40, 3


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def bundle(rng: np.random.Generator) -> Bundle:
    """Two chunks for each of the clusters but the last, which has one."""
    order = rng.permutation(COUNT)
    chunks = np.array([[0, 9], [9, 17], [17, 20], [20, 31], [31, COUNT]])
    position = rng.normal(size=(COUNT, 3))
    position[:, 2] += 4.0
    return Bundle(chunks, np.array([0, 0, 1, 1, 2]), order, position, *unit(rng.normal(size=(2, COUNT, 3))))


def members(b: Bundle, chunk: int) -> np.ndarray:
    return b.order[b.chunks[chunk, 0] : b.chunks[chunk, 1]]


def run(kernel, b: Bundle, *arguments, columns: int) -> np.ndarray:
    out = np.full((len(b.chunks), columns), np.nan)
    kernel(b, *arguments, out)
    return out


def frames(rng: np.random.Generator, count: int) -> np.ndarray:
    """(C,3,3) orthonormal rows."""
    return np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]


def test_moments_and_spread_against_numpy() -> None:
    rng = np.random.default_rng(0)
    b = bundle(rng)
    column, row = rng.uniform(0, 99, (2, COUNT))
    centre, axis = rng.normal(size=(CLUSTERS, 3)), unit(rng.normal(size=(CLUSTERS, 3)))
    sums = run(cluster_fit.moments, b, column, row, columns=cluster_fit.SUMS + cluster_fit.BOX)
    spread = run(cluster_fit.plane_spread, b, centre, axis, columns=4)
    for c in range(len(b.chunks)):
        i, g = members(b, c), b.owner[c]
        p, n, d = b.position[i], b.normal[i], b.direction[i]
        flat = np.eye(3) - d[:, :, None] * d[:, None, :]
        upper = flat.sum(axis=0)[np.triu_indices(3)]
        moved = (flat @ p[..., None])[..., 0].sum(axis=0)
        box = [column[i].min(), row[i].min(), column[i].max(), row[i].max()]
        wanted = [len(i), *p.sum(axis=0), *n.sum(axis=0), *d.sum(axis=0), *upper, *moved, *box]
        np.testing.assert_allclose(sums[c], wanted, rtol=1e-12, atol=1e-12)
        height = (p - centre[g]) @ axis[g]
        reach = ((p - centre[g]) ** 2).sum(axis=1).max()
        wanted = [height.max(), -height.min(), -(n @ axis[g]).min(), reach]
        np.testing.assert_allclose(spread[c], wanted, rtol=1e-12, atol=1e-12)


def test_deviation_of_rays_from_eyes() -> None:
    rng = np.random.default_rng(1)
    b, eyes = bundle(rng), rng.normal(size=(CLUSTERS, 2, 3))
    out = run(cluster_fit.ray_deviation, b, eyes, columns=2)
    for c in range(len(b.chunks)):
        i = members(b, c)
        for e in range(2):
            away = unit(b.position[i] - eyes[b.owner[c], e])
            assert out[c, e] == pytest.approx((1 - (away * b.direction[i]).sum(axis=1)).sum(), rel=1e-10)


def test_boxes_from_the_mirrored_eye() -> None:
    rng = np.random.default_rng(2)
    b, turn = bundle(rng), frames(rng, CLUSTERS)
    frame = np.concatenate([rng.normal(size=(CLUSTERS, 1, 3)), turn], axis=1)
    eye = frame[:, 0] - 3.0 * turn[:, 2] + rng.normal(0, 0.2, (CLUSTERS, 3))
    reach = np.column_stack([eye, np.full(CLUSTERS, 2.5), np.full(CLUSTERS, 4.0), np.full(CLUSTERS, 0.2)])
    out = run(cluster_fit.eye_boxes, b, frame, reach, columns=15)
    used = 0
    for c in range(len(b.chunks)):
        g = b.owner[c]
        centre, right, down, normal = frame[g]
        h = (centre - eye[g]) @ normal
        starts, ends, both = [], [], []
        for i in members(b, c):
            x = b.position[i] - eye[g]
            if x @ normal <= 0:
                continue
            start = h * np.array([x @ right, x @ down]) / (x @ normal)
            starts.append(start)
            climb = b.direction[i] @ normal
            if climb < 0.2:
                continue
            t = min((2.5 - (x @ normal - h)) / climb, 4.0)
            x = x + t * b.direction[i]
            ends.append(h * np.array([x @ right, x @ down]) / (x @ normal))
            both.append((start, ends[-1]))
        used += len(ends)
        for k, points in ((0, starts), (4, ends)):
            low = np.min(points, axis=0) if points else [math.inf] * 2
            high = np.max(points, axis=0) if points else [-math.inf] * 2
            np.testing.assert_allclose(out[c, k : k + 4], [*low, *high], rtol=1e-10)
        sums = [len(both), *sum((s for s, _ in both), np.zeros(2)), *sum((e for _, e in both), np.zeros(2))]
        sums += [sum(s @ e for s, e in both), sum(s @ s for s, _ in both)]
        np.testing.assert_allclose(out[c, 8:], sums, rtol=1e-9, atol=1e-12)
    assert used > 5


@pytest.mark.parametrize("sine", [0.0, 0.3])
def test_boxes_in_the_image(sine: float) -> None:
    rng = np.random.default_rng(3)
    b, turn = bundle(rng), frames(rng, CLUSTERS)
    width = 7
    pixel = np.sort(rng.choice(8 * width, COUNT, replace=False))
    place = np.full(8 * width, -1)
    place[pixel] = np.arange(COUNT)
    cluster = np.zeros(COUNT, np.int64)
    for c, g in enumerate(b.owner):
        cluster[members(b, c)] = g
    frame = np.concatenate(
        [rng.normal(size=(CLUSTERS, 1, 3)), turn, unit(turn[:, 2:] + rng.normal(0, 0.3, (CLUSTERS, 1, 3)))], axis=1
    )
    eye, slope = -5.0 * turn[:, 2] + [0, 0, 4], 0.8
    reach = np.column_stack([eye, np.full(CLUSTERS, 2.0), np.full(CLUSTERS, 3.0), np.full(CLUSTERS, slope)])
    lens = np.broadcast_to([sine, math.sqrt(1 - sine * sine)], (CLUSTERS, 2)).copy()
    out = run(cluster_fit.image_boxes, b, lens, frame, reach, Pictures(place, pixel, cluster, width), columns=8)
    for c in range(len(b.chunks)):
        g = b.owner[c]
        centre, axes, normal = frame[g, 0], frame[g, 1:4], frame[g, 4]
        tangents, outside, least, apart = [], 0, math.inf, []
        for i in members(b, c):
            x = axes @ (b.position[i] - eye[g])
            least = min(least, x[2])
            points = [x]
            d = axes @ b.direction[i]
            across = np.array([d[2], 0, -d[0]]) / math.hypot(d[0], d[2])
            sides = [np.zeros(3)]
            if sine:
                other = np.cross(d, across)
                sides += [across, -across, other, -other]
            height = (b.position[i] - centre) @ normal
            for side in sides:
                a = lens[g, 1] * d + sine * side if side.any() else d
                climb = a @ (axes @ normal)
                points.append(x + (min((2.0 - height) / climb, 3.0) if climb > 0 else 3.0) * a)
            held = [p[:2] / p[2] for p in points if p[2] > 0]
            tangents += [np.clip(h, -slope, slope) for h in held]
            outside += len(held) < len(points) or any((np.abs(h) > slope).any() for h in held)
            for step in (1, width):
                if step == 1 and pixel[i] % width == width - 1:
                    continue
                j = place[pixel[i] + step] if pixel[i] + step < len(place) else -1
                if j < 0 or cluster[j] != g or x[2] <= 0:
                    continue
                y = axes @ (b.position[j] - eye[g])
                if y[2] > 0:
                    apart.append(np.linalg.norm(y[:2] / y[2] - x[:2] / x[2]))
        wanted = [*np.min(tangents, axis=0), *np.max(tangents, axis=0), outside, sum(apart), len(apart), least]
        np.testing.assert_allclose(out[c], wanted, rtol=1e-8, atol=1e-10)
