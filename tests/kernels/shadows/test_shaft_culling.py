"""Shafts never lose a triangle that lies between a receiver and the light, and leave out most of the others."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.rays.bvh_build import STACK, build_bvh
from torchrender.kernels.shadows.shaft_culling import ABOVE, NONE, SHAFT, Receivers, collect, make_shaft
from torchrender.kernels.shadows.soft_shadow import LightViews

OUTLINE = np.array([[-0.6, 3.0, -0.6], [1.2, 0.0, 0.0], [0.0, 0.0, 1.2]])


def light_views() -> LightViews:
    """A horizontal light above; rays aim at the receivers themselves, so its pictures do not matter."""
    place = OUTLINE[:1] + 0.5 * (OUTLINE[1] + OUTLINE[2])
    one = np.ones(1)
    runs = np.array([[0, 0], [0, 1]])
    return LightViews(
        place, np.eye(3)[None, None].copy(), 32.0 * one, np.zeros(1, np.int64), 64, 1e-3, 1e-3, 0.2, 10.0, False,
        OUTLINE, OUTLINE[None], runs,
    )  # fmt: skip


def receivers(rng: np.random.Generator, count: int, slope: float) -> tuple[np.ndarray, np.ndarray]:
    points = rng.uniform(-0.4, 0.4, (count, 3)) * (1.0, 2.5 * slope, 1.0)
    normals = np.array([0.0, 1.0, 0.0]) + rng.normal(0, 1, (count, 3)) * slope
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def blocks(corners: np.ndarray, points: np.ndarray, light: np.ndarray, rng: np.random.Generator) -> bool:
    """A segment from a receiver to the light meets the triangle: many of them, at random."""
    a, b, c = corners
    shares = rng.random((400, 2))
    ends = light[0] + shares[:, :1] * light[1] + shares[:, 1:] * light[2]
    starts = points[rng.integers(0, len(points), 400)]
    matrix = np.stack([np.broadcast_to(b - a, (400, 3)), np.broadcast_to(c - a, (400, 3)), starts - ends], axis=2)
    whole = np.abs(np.linalg.det(matrix)) > 1e-12
    u, v, t = np.linalg.solve(matrix[whole], (starts[whole] - a)[..., None])[..., 0].T
    return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-6) & (t < 1 - 1e-6)).any())


@pytest.mark.parametrize(("slope", "kind"), [(0.0, ABOVE), (0.3, SHAFT)])
@pytest.mark.parametrize("seed", range(3))
def test_every_blocker_is_listed(seed: int, slope: float, kind: int) -> None:
    rng = np.random.default_rng(seed)
    points, normals = receivers(rng, 30, slope)
    centre = rng.uniform(-3, 3, (150, 1, 3))
    centre[..., 1] += 2.0
    vertices = (centre + rng.normal(0, 0.6, (150, 3, 3))).reshape(-1, 3)
    tree = build_bvh(vertices, np.arange(450, dtype=np.int32).reshape(-1, 3))
    views = light_views()
    shaft = np.zeros((8, 4))
    first, members = 4, 20
    assert make_shaft(Receivers(points, normals, first, members), views.outline, views, shaft) == kind
    found = np.full(200, -1, np.int32)
    count = collect(tree, shaft, np.zeros(STACK, np.int32), found, 150)
    listed = set(tree.order[found[:count]].tolist())
    own = points[first : first + members]
    needed = {t for t in range(150) if blocks(vertices[3 * t : 3 * t + 3], own, views.outline, rng)}
    if kind == ABOVE:  # what lies below the receivers' plane is left out on purpose
        needed = {t for t in needed if (vertices[3 * t : 3 * t + 3, 1] > 1e-3).any()}
    assert needed <= listed and len(needed) > 1
    assert len(listed) < 120
    if count > 2:
        assert collect(tree, shaft, np.zeros(STACK, np.int32), found, count - 1) == count


def test_a_light_seen_edge_on_has_no_shaft() -> None:
    rng = np.random.default_rng(5)
    points, normals = receivers(rng, 8, 0.0)
    light = np.array([[5.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    points[:] = [[0.0, 0.0, 0.3]]
    assert make_shaft(Receivers(points, normals, 0, 8), light, light_views(), np.zeros((8, 4))) == NONE
