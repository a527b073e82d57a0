"""The packet kernels against a loop over receivers, samples and triangles."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.rays.bvh_build import build_bvh
from torchrender.kernels.rays.ray_packet import GROUP
from torchrender.kernels.shadows.soft_shadow import LightViews, light_bits


def light_views(rng: np.random.Generator, samples: int, *, texels: bool, probes: int = 0, height: float = 3.0):
    """Samples of a horizontal light that looks straight down with a field of view of 90 degrees."""
    outline = np.array([[-0.6, height, -0.6], [1.2, 0.0, 0.0], [0.0, 0.0, 1.2]])
    places = outline[0] + rng.random((samples, 1)) * outline[1] + rng.random((samples, 1)) * outline[2]
    down = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return LightViews(
        samples=places,
        rotations=np.broadcast_to(down, (samples, 1, 3, 3)).copy(),
        focal=np.full(samples, 32.0),
        names=np.arange(samples),
        size=64,
        near=1e-3,
        constant_bias=1e-3,
        slope_bias=0.2,
        largest_slope=10.0,
        texels=texels,
        outline=outline,
        tiles=outline[None],
        runs=np.array([[0, probes], [probes, samples]]),
    )


def receivers(rng: np.random.Generator, count: int, slope: float) -> tuple[np.ndarray, np.ndarray]:
    points = rng.uniform(-1, 1, (count, 3)) * (1.0, slope, 1.0)
    normals = np.array([0.0, 1.0, 0.0]) + rng.normal(0, 1, (count, 3)) * slope
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def solve(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Ray parameters (T,) of the hits of triangles (T,3,3); inf without one."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    matrix = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=2)
    flat = np.abs(np.linalg.det(matrix)) < 1e-14
    matrix[flat] = np.eye(3)
    u, v, t = np.linalg.solve(matrix, (origin - a)[:, :, None])[:, :, 0].T
    return np.where(~flat & (u >= 0) & (v >= 0) & (u + v <= 1), t, np.inf)


def slow_bits(corners: np.ndarray, points: np.ndarray, normals: np.ndarray, views: LightViews) -> np.ndarray:
    """(P,S) bool: visible, by the definition."""
    out = np.zeros((len(points), len(views.samples)), bool)
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        for s, light in enumerate(views.samples):
            toward = light - point
            if not normal @ toward > 0:
                continue
            x, y, z = views.rotations[s, 0] @ (point - light)
            u, v = (np.floor(views.focal[s] * q / z + views.size / 2) for q in (x, y)) if z > views.near else (-1, -1)
            if not (0 <= u < views.size and 0 <= v < views.size):
                out[i, s] = True
                continue
            cosine = normal @ toward / np.linalg.norm(toward)
            slope = min(np.sqrt(max(1 - cosine**2, 0)) / cosine, views.largest_slope)
            bias = views.constant_bias * z + views.slope_bias * slope * z / views.focal[s]
            ray = np.array([x / z, y / z, 1.0])
            if views.texels:
                ray[:2] = (np.array([u, v]) + 0.5 - views.size / 2) / views.focal[s]
            direction = views.rotations[s, 0].T @ ray
            depths = solve(corners, light, direction)
            nearest = min(depths[depths > views.near], default=np.inf)
            out[i, s] = z <= nearest + bias
    return out


def fast_bits(corners, points, normals, views, *, skip: bool) -> tuple[np.ndarray, int]:
    vertices = corners.reshape(-1, 3)
    tree = build_bvh(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))
    bits = np.zeros((len(points), (len(views.samples) + 63) // 64), np.int64)
    outside = np.zeros(2, np.int64)
    light_bits(tree, points, normals, views, skip, 2, bits, outside)
    flat = np.unpackbits(bits.view(np.uint8), axis=1, bitorder="little").astype(bool)
    return flat[:, : len(views.samples)], int(outside.sum())


@pytest.mark.parametrize("texels", [False, True])
@settings(deadline=None, max_examples=15)
@given(
    seed=st.integers(0, 2**31),
    triangles=st.integers(0, 25),
    count=st.integers(1, GROUP + 9),
    slope=st.sampled_from([0.0, 0.5]),
)
def test_same_as_the_loop(seed: int, triangles: int, count: int, slope: float, texels: bool) -> None:
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-1, 1, (triangles, 1, 3)) * (1.2, 0.9, 1.2) + (0.0, 1.2, 0.0)
    corners = centres + rng.normal(0, 0.3, (triangles, 3, 3))
    points, normals = receivers(rng, count, slope)
    views = light_views(rng, 7, texels=texels)
    expected = slow_bits(corners, points, normals, views)
    for skip in (False, True):
        found, _ = fast_bits(corners, points, normals, views, skip=skip)
        assert np.array_equal(found, expected)


def test_many_small_triangles_and_more_than_one_word() -> None:
    rng = np.random.default_rng(3)
    corners = rng.uniform(-1, 1, (60, 1, 3)) * (1.0, 0.4, 1.0) + (0.0, 1.0, 0.0) + rng.normal(0, 0.18, (60, 3, 3))
    points, normals = receivers(rng, GROUP + 2, 0.3)
    views = light_views(rng, 66, texels=False)
    found, _ = fast_bits(corners, points, normals, views, skip=True)
    expected = slow_bits(corners, points, normals, views)
    assert 0.05 < expected.mean() < 0.95
    assert np.array_equal(found, expected)


def test_pairs_outside_the_map_are_lit_and_counted() -> None:
    rng = np.random.default_rng(0)
    blocker = np.array([[[-9.0, 1.0, -9.0], [9.0, 1.0, -9.0], [0.0, 1.0, 9.0]]])
    points = np.array([[0.0, 0.0, 0.0], [30.0, 0.0, 0.0]])
    normals = np.array([[0.0, 1.0, 0.0]] * 2)
    found, outside = fast_bits(blocker, points, normals, light_views(rng, 5, texels=True), skip=True)
    assert not found[0].any() and found[1].all()
    assert outside == 5


def test_probes_end_the_work_in_umbra_only() -> None:
    rng = np.random.default_rng(1)
    blocker = np.array([[[-9.0, 1.0, -9.0], [9.0, 1.0, -9.0], [0.0, 1.0, 9.0]]])
    points, normals = receivers(rng, GROUP, 0.0)
    views = light_views(rng, 9, texels=False, probes=4)
    assert not fast_bits(blocker, points, normals, views, skip=True)[0].any()
    half = blocker * (0.05, 1.0, 0.05)
    assert np.array_equal(
        fast_bits(half, points, normals, views, skip=True)[0], slow_bits(half, points, normals, views)
    )


def test_one_lit_probe_of_a_group_is_no_umbra() -> None:
    """A pinhole: one receiver sees one probe, all others see none; the light's other samples are asked all the same."""
    rng = np.random.default_rng(4)
    views = light_views(rng, 12, texels=False, probes=3)
    views.samples[:, 0] = np.array([0.5, -0.4, -0.5, *np.linspace(0.3, 0.6, 9)])
    points = np.zeros((GROUP, 3)) + rng.uniform(-0.01, 0.01, (GROUP, 3))
    normals = np.tile([0.0, -1.0, 0.0], (GROUP, 1))  # see nothing, but for one that faces along x
    normals[2] = (1.0, 0.0, 0.0)
    far = np.array([[[50.0, 0.0, 50.0], [51.0, 0.0, 50.0], [50.0, 1.0, 50.0]]])
    found, _ = fast_bits(far, points, normals, views, skip=False)
    assert np.array_equal(found, slow_bits(far, points, normals, views))
    assert found.sum() == 10 and found[:, :3].sum() == 1


def test_receivers_on_both_sides_of_the_lights_plane() -> None:
    """No planes hold what lies between them and the light, so that nothing may be left out of what is searched."""
    rng = np.random.default_rng(5)
    views = light_views(rng, 6, texels=False, height=2.0)
    below = np.stack([rng.uniform(-0.2, 0.2, 8), np.full(8, 1.0), rng.uniform(-0.2, 0.2, 8)], axis=1)
    points = np.concatenate([below, below * (1.0, -1.0, 1.0) + (0.0, 4.0, 0.0)])  # their box is centred in the plane
    normals = np.array([[0.0, 1.0, 0.0]] * 8 + [[0.0, -1.0, 0.0]] * 8)
    blocker = np.array([[[-9.0, 1.5, -9.0], [0.0, 1.5, -9.0], [0.0, 1.5, 9.0]]])
    expected = slow_bits(blocker, points, normals, views)
    assert 0.1 < expected[:8].mean() < 0.9 and expected[8:].all()
    assert np.array_equal(fast_bits(blocker, points, normals, views, skip=True)[0], expected)
