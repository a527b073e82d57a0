"""Points moved out of their triangles against a loop in float64."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.shading.simd import MOST_BENT
from torchrender.kernels.shadows.receivers import FLAT, move_out

CORNERS, TRIANGLES, POINTS = 40, 30, 1500


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=-1, keepdims=True)


def loop(
    mesh: tuple[np.ndarray, ...], t: int, weights: np.ndarray, place: np.ndarray, face: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """One point, by the definition."""
    vertices, faces, normals = mesh
    share = np.array([1.0 - weights.sum(), *weights])
    smooth = unit(share @ normals[faces[t]])
    smooth = -smooth if smooth @ face < 0 else smooth
    if not FLAT < 1.0 - smooth @ face < 1.0 - MOST_BENT:
        return place, face
    moved = place.copy()
    for k, corner in enumerate(faces[t]):
        normal = unit(normals[corner])
        normal = -normal if normal @ smooth < 0 else normal
        moved += share[k] * max((vertices[corner] - place) @ normal, 0.0) * normal
    return moved, smooth


@pytest.mark.parametrize("tilt", [0.0, 0.3, 2.0])
def test_equals_the_loop(tilt: float) -> None:
    """Flat triangles, smooth ones, and normals of which some lean too far or away; runs of one triangle and none."""
    rng = np.random.default_rng(7)
    vertices = rng.normal(size=(CORNERS, 3))
    faces = np.stack([rng.permutation(CORNERS)[:3] for _ in range(TRIANGLES)]).astype(np.int32)
    own = unit(np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2))))
    vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * TRIANGLES, dtype=np.int32).reshape(-1, 3)
    normals = unit(np.repeat(own, 3, axis=0) + tilt * rng.normal(size=(3 * TRIANGLES, 3))).astype(np.float32)
    triangle = np.repeat(rng.integers(-1, TRIANGLES, POINTS // 3), 3)
    weights = rng.dirichlet((1.0, 1.0, 1.0), POINTS)[:, 1:].astype(np.float32)
    share = np.concatenate([1.0 - weights.astype(float).sum(-1, keepdims=True), weights], axis=1)
    position = np.einsum("nk,nkc->nc", share, vertices[faces[triangle]])
    geometric = (own[triangle] * rng.choice([-1.0, 1.0], (POINTS, 1))).astype(np.float32)
    position[triangle < 0], geometric[triangle < 0] = 0.0, 0.0
    moved, normal = np.empty_like(position), np.empty_like(geometric)
    mesh = (vertices, faces, normals)
    move_out(mesh, triangle, weights, (position, geometric), (moved, normal))
    seen = triangle >= 0
    assert np.array_equal(moved[~seen], position[~seen]) and np.array_equal(normal[~seen], geometric[~seen])
    rows, doubles = np.flatnonzero(seen), weights.astype(float)
    wanted = [loop(mesh, triangle[i], doubles[i], position[i], geometric[i]) for i in rows]
    np.testing.assert_allclose(moved[seen], [place for place, _ in wanted], rtol=0, atol=1e-6)
    np.testing.assert_allclose(normal[seen], [facing for _, facing in wanted], rtol=0, atol=1e-6)
    changed = (moved != position).any(-1)
    assert changed.any() == (tilt > 0.0)
