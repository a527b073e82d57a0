"""Points settled by triangles against a loop over points and triangles."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.raster.records import NO_HOLES
from torchrender.kernels.shadows.exact_edges import Casters, Cells, hide


def soup(rng: np.random.Generator, count: int) -> Casters:
    """Triangles all around the origin, some behind the light, in clusters of seven."""
    centre = rng.uniform(-3, 3, (count, 1, 3))
    vertices = (centre + rng.normal(0, 0.7, (count, 3, 3))).reshape(-1, 3)
    faces = np.arange(3 * count, dtype=np.int32).reshape(count, 3)
    order = rng.permutation(count).astype(np.int32)
    clusters = np.array([(i, min(i + 7, count)) for i in range(0, count, 7)])
    bounds = np.array(
        [(vertices[faces[order[a:b]]].min((0, 1)), vertices[faces[order[a:b]]].max((0, 1))) for a, b in clusters]
    )
    return Casters(vertices, faces, order, clusters, bounds)


def blocked(corners: np.ndarray, start: np.ndarray, toward: np.ndarray, orthographic: bool) -> bool:
    """The segment (half line, for parallel light) from a point towards the light meets the triangle."""
    a, b, c = corners
    matrix = np.stack([b - a, c - a, -toward], axis=1)
    if abs(np.linalg.det(matrix)) < 1e-12:
        return False
    u, v, t = np.linalg.solve(matrix, start - a)
    return u >= 0 and v >= 0 and u + v <= 1 and t > 0 and (orthographic or t < 1)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("side", [1, 6])
def test_equals_the_loop(orthographic: bool, side: int) -> None:
    rng = np.random.default_rng(side)
    casters = soup(rng, 60)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shift = np.array([0.1, -0.2, 0.5])
    focal, texels = (20.0 if orthographic else 90.0), 128.0
    camera = [focal, focal * 1.1, 60.0, 70.0, 0.0, 100.0]
    view = np.concatenate([np.concatenate([turn, shift[:, None]], axis=1).ravel(), camera])
    uv = rng.uniform(0, texels, (400, 2))
    z = rng.uniform(0.5, 5.0, 400)
    flat = (uv - (60.0, 70.0)) / (focal, focal * 1.1)
    place = np.concatenate([flat, z[:, None]], axis=1)
    local = np.concatenate([flat * (1 if orthographic else z[:, None]), z[:, None]], axis=1)
    world = (local - shift) @ turn
    cell = (uv / (texels / side)).astype(int)
    key = np.clip(cell[:, 1], 0, side - 1) * side + np.clip(cell[:, 0], 0, side - 1)
    order = np.argsort(key, kind="stable")
    starts = np.searchsorted(key[order], np.arange(side * side + 1))
    deepest = np.full(side * side, -np.inf)
    np.maximum.at(deepest, key, z)
    far_off = np.arange(400) % 5 == 0  # all triangles are too far away to cast an edge there
    least = np.where(far_off, z[order], -np.inf)
    cells = Cells(place[order].copy(), starts, least, deepest, np.full(2, texels / side), np.array([side, side]))
    hidden = np.zeros((2, 400), np.uint8)
    hide(casters, view, orthographic, NO_HOLES, cells, 5, hidden)
    eye = -turn.T @ shift
    wanted = []
    for point in world[order]:
        toward = -turn[2] if orthographic else eye - point
        wanted.append(any(blocked(casters.vertices[f], point, toward, orthographic) for f in casters.faces))
    assert np.array_equal(hidden[far_off.astype(int), np.arange(400)].astype(bool), wanted)
    assert not hidden[1 - far_off.astype(int), np.arange(400)].any()
    assert 0.03 < hidden.mean() < 0.9
