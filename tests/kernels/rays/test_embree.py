"""The float32 stand-ins: grown triangles hold the true ones with a margin, aimed rays are the same lines."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.rays.bvh import build_bvh
from torchrender.kernels.rays.embree import BACK, GROW, aim, grown_triangles


@pytest.mark.parametrize("squeeze", [1.0, 1e-3, 1e-6, 1e-15])
def test_grown_triangles_hold_the_true_ones(squeeze: float) -> None:
    """In each grown triangle's own plane the true corners lie at least 0.9 GROW inside every edge."""
    rng = np.random.default_rng(0)
    corners = rng.standard_normal((300, 3, 3)) * 10.0 ** rng.uniform(-6, 0, (300, 1, 1))
    corners[:, 2] = corners[:, 0] + 0.3 * (corners[:, 1] - corners[:, 0]) + squeeze * (corners[:, 2] - corners[:, 0])
    bvh = build_bvh(corners.reshape(-1, 3), np.arange(900, dtype=np.int32).reshape(-1, 3))
    grown, thin = grown_triangles(bvh.corners, bvh.frame)
    true = bvh.corners.reshape(-1, 3, 3) - bvh.frame[:3]
    grown = grown.astype(float)
    normal = np.cross(grown[:, 1] - grown[:, 0], grown[:, 2] - grown[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for k in range(3):
        a, b = grown[:, k], grown[:, (k + 1) % 3]
        inward = np.cross(normal, b - a)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        assert ((true - a[:, None]) * inward[:, None]).sum(2).min() > 0.9 * GROW
    assert np.abs(((true - grown[:, :1]) * normal[:, None]).sum(2)).max() < 1e-6
    assert np.abs(grown - true).max() < 5
    assert thin.all() if squeeze < 1e-5 else not thin.all()


def test_aimed_rays_are_the_same_lines() -> None:
    rng = np.random.default_rng(1)
    corners = rng.random((50, 3, 3)) * 30 + 1e5
    bvh = build_bvh(corners.reshape(-1, 3), np.arange(150, dtype=np.int32).reshape(-1, 3))
    target = 1e5 + 30 * rng.random((400, 3))
    d = rng.standard_normal((400, 3)) * 10.0 ** rng.uniform(-5, 5, (400, 1))
    o = target - d * rng.uniform(0, 1e4, (400, 1)) / np.linalg.norm(d, axis=1, keepdims=True)
    span = np.tile([0.0, np.inf], (400, 1))
    start, toward, reach, unit = aim(bvh.frame, o, d, span)
    assert (reach > 0).all() and np.abs(start).max() < 1.1
    np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1, rtol=1e-6)
    s = bvh.frame[3]
    expected = o * s - bvh.frame[:3] + unit[:, :1] * d * s
    np.testing.assert_allclose(start, expected, atol=2e-7)
    np.testing.assert_allclose(unit[:, 1] * np.linalg.norm(d * s, axis=1), 1, rtol=1e-12)
    assert (unit[:, 0] >= -BACK * unit[:, 1] * 1.001).all()
    away = aim(bvh.frame, o - 2e5 * d / np.linalg.norm(d, axis=1, keepdims=True), -d, span)[2]
    assert (away == -1).all()
