"""Which lights reach which tiles, and where receivers stand in a light's image, against loops over pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.shadows.light_reach import (
    COUNT,
    HIGH_A,
    HIGH_B,
    HIGH_Z,
    LOW_A,
    LOW_B,
    LOW_Z,
    PARALLEL,
    POINT,
    RECTANGLE,
    SPOT,
    Lamps,
    Points,
    bound_receivers,
    mark_tiles,
)

HEIGHT, WIDTH = 22, 37


def random_points(rng: np.random.Generator) -> Points:
    """A rough surface with holes and black parts."""
    row, column = np.mgrid[:HEIGHT, :WIDTH]
    position = np.stack([column * 0.3, rng.random((HEIGHT, WIDTH)), row * 0.3], axis=-1)
    normal = rng.normal(size=(HEIGHT, WIDTH, 3)) + np.array([0.0, 1.5, 0.0])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    takes = rng.random((HEIGHT, WIDTH)) < 0.7
    takes[:8, :8] = False
    normal[:4] = 0.0
    return Points(position, normal.astype(np.float32), rng.uniform(0.5, 60, (HEIGHT, WIDTH)).astype(np.float32), takes)


def random_lamps(rng: np.random.Generator, count: int) -> Lamps:
    kind = rng.integers(0, 4, count)
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    edges = rng.normal(size=(count, 2, 3))
    for i in np.flatnonzero(kind == RECTANGLE):
        axis[i] = np.cross(edges[i, 0], edges[i, 1])
        axis[i] /= np.linalg.norm(axis[i])
    place = rng.uniform((-4, -2, -4), (14, 8, 10), (count, 3))
    reach = np.where(rng.random(count) < 0.5, np.inf, rng.uniform(0.5, 6, count))
    return Lamps(kind, place, axis, reach, np.cos(rng.uniform(0.01, 1.5, count)), edges)


def reaches(points: Points, j: int, i: int, lamps: Lamps, k: int) -> bool:
    """By the definition: before the surface, within range, cone and emitting side."""
    normal = points.normal[j, i].astype(float)
    if not points.takes[j, i] or not normal.any():
        return False
    place, position = lamps.place[k], points.position[j, i]
    if lamps.kind[k] == PARALLEL:
        return bool(normal @ place > 0)
    corners = [place]
    if lamps.kind[k] == RECTANGLE:
        u, v = lamps.edges[k]
        corners = [place, place + u, place + v, place + u + v]
    if not any(normal @ (c - position) > 0 for c in corners):
        return False
    away = position - place
    if lamps.kind[k] == RECTANGLE:
        return bool(away @ lamps.axis[k] > 0)
    if np.linalg.norm(away) > lamps.reach[k]:
        return False
    return bool(lamps.kind[k] == POINT or away @ lamps.axis[k] >= lamps.cosine[k] * np.linalg.norm(away))


@pytest.mark.parametrize("side", [1, 5, 16])
def test_tiles_equal_the_loop(side: int) -> None:
    rng = np.random.default_rng(side)
    points, lamps = random_points(rng), random_lamps(rng, 60)
    rows, columns = math.ceil(HEIGHT / side), math.ceil(WIDTH / side)
    marks = np.zeros((rows * columns, 60), np.bool_)
    mark_tiles(points, lamps, side, 3, marks)
    wanted = np.zeros_like(marks)
    for j in range(HEIGHT):
        for i in range(WIDTH):
            for k in range(60):
                wanted[(j // side) * columns + i // side, k] |= reaches(points, j, i, lamps, k)
    assert np.array_equal(marks, wanted)
    assert 0.02 < marks.mean() < 0.9 and set(lamps.kind[wanted.any(axis=0)]) == {PARALLEL, POINT, SPOT, RECTANGLE}


@pytest.mark.parametrize("orthographic", [False, True])
def test_bounds_equal_the_loop(orthographic: bool) -> None:
    rng = np.random.default_rng(5)
    points = random_points(rng)
    kind = PARALLEL if orthographic else POINT
    place = np.array([[0.3, 0.9, 0.1] if orthographic else [5.0, 3.0, 3.0]])
    lamps = Lamps(np.array([kind]), place, np.zeros((1, 3)), np.array([np.inf]), np.array([-1.0]), np.zeros((1, 2, 3)))
    frames = []
    for _ in range(1 if orthographic else 4):
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        frames.append(np.concatenate([turn, -(turn @ place[0])[:, None]], axis=1).ravel())
    steps, first = 9, -2
    table = np.zeros((16, len(frames), steps, 7))
    bound_receivers(points, lamps, 0, np.array(frames), orthographic, first, table)
    found = {}
    for j in range(HEIGHT):
        for i in range(WIDTH):
            if not reaches(points, j, i, lamps, 0):
                continue
            local = [f.reshape(3, 4)[:, :3] @ points.position[j, i] + f.reshape(3, 4)[:, 3] for f in frames]
            view = int(np.argmax([p[2] for p in local]))
            x, y, z = local[view]
            if not orthographic:
                if z <= 0:
                    continue
                x, y = x / z, y / z
            step = min(max(math.floor(2 * math.log2(float(points.depth[j, i]))) - first, 0), steps - 1)
            found.setdefault((view, step), []).append((x, y, z))
    assert len(found) > 6
    for view in range(len(frames)):
        for step in range(steps):
            rows = np.array(found.get((view, step), np.zeros((0, 3))))
            cell = table[:, view, step]
            assert cell[:, COUNT].sum() == len(rows)
            if len(rows):
                for axis, (low, high) in enumerate(((LOW_A, HIGH_A), (LOW_B, HIGH_B), (LOW_Z, HIGH_Z))):
                    assert cell[:, low].min() == pytest.approx(rows[:, axis].min())
                    assert cell[:, high].max() == pytest.approx(rows[:, axis].max())
