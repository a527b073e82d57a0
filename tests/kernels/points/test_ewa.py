"""The projection of surfels: closed forms, finite differences, and a convolution done by numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.points import ewa
from torchrender.kernels.points.records import Filters


def random_surfels(count: int, seed: int = 0):
    """Centres in view, unit normals and tangents, and a matrix of intrinsics with fx != fy and skew."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(0.5, 20, count)
    centre = np.stack([rng.uniform(-0.5, 0.5, count) * z, rng.uniform(-0.5, 0.5, count) * z, z], axis=1)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    s = np.cross(normal, rng.normal(size=(count, 3)))
    s /= np.linalg.norm(s, axis=1, keepdims=True)
    return centre, normal, s, np.cross(normal, s)


K = np.array([[400.0, 15.0, 130.0], [0.0, 270.0, 90.0], [0.0, 0.0, 1.0]])


def project(p, k=K):
    return np.array([(k[0, 0] * p[0] + k[0, 1] * p[1]) / p[2] + k[0, 2], k[1, 1] * p[1] / p[2] + k[1, 2]])


def jacobian(o, s, t, k=K):
    """Published form, with skew."""
    fx, skew, fy = k[0, 0], k[0, 1], k[1, 1]
    columns = []
    for a in (s, t):
        x = fx * (a[0] * o[2] - o[0] * a[2]) + skew * (a[1] * o[2] - o[1] * a[2])
        columns.append([x / o[2] ** 2, fy * (a[1] * o[2] - o[1] * a[2]) / o[2] ** 2])
    return np.array(columns).T


def test_the_jacobian_is_that_of_finite_differences():
    for o, _, s, t in zip(*random_surfels(50)):
        h = 1e-6 * o[2]
        found = [(project(o + h * a) - project(o - h * a)) / (2 * h) for a in (s, t)]
        np.testing.assert_allclose(jacobian(o, s, t), np.array(found).T, rtol=1e-7, atol=1e-6)


def test_covariance_and_determinant_identities():
    for o, n, s, t in zip(*random_surfels(500)):
        xx, xy, yy, det = ewa.screen_covariance(*o, tuple(n), K)
        j = jacobian(o, s, t)
        outer = j @ j.T
        scale = np.abs(outer).max()
        np.testing.assert_allclose([xx, xy, yy], [outer[0, 0], outer[0, 1], outer[1, 1]], atol=1e-9 * scale, rtol=0)
        assert det == pytest.approx(abs(np.linalg.det(j)), abs=1e-9 * scale)
        cosine = abs(o @ n) / np.linalg.norm(o)
        ratio = math.sqrt(1 + (o[0] / o[2]) ** 2 + (o[1] / o[2]) ** 2)
        assert det == pytest.approx(K[0, 0] * K[1, 1] * cosine / o[2] ** 2 * ratio, rel=1e-9)


def test_convolution_of_the_projected_kernel_with_the_low_pass():
    """rho(x) = |det J| G_H(x - x_k): a Gaussian on the surface, seen in the image, smoothed by numerical summation."""
    o, n, s, t = (a[3] for a in random_surfels(10, seed=4))
    r, r_h = 0.02 * o[2], 1.3
    j = jacobian(o, s, t)
    inverse = np.linalg.inv(j)
    step = 0.02
    axis = np.arange(-12, 12, step)
    y, x = np.meshgrid(axis, axis, indexing="ij")
    offset = np.stack([x, y], axis=-1) @ inverse.T
    surface = np.exp(-0.5 * (offset**2).sum(-1) / r**2) / (2 * np.pi * r**2)
    for target in ([0.0, 0.0], [0.7, -1.1]):
        low_pass = np.exp(-0.5 * ((x - target[0]) ** 2 + (y - target[1]) ** 2) / r_h**2) / (2 * np.pi * r_h**2)
        summed = (surface * low_pass).sum() * step**2
        xx, xy, yy, det = ewa.screen_covariance(*o, tuple(n), K)
        h = np.array([[r * r * xx + r_h**2, r * r * xy], [r * r * xy, r * r * yy + r_h**2]])
        q = np.array(target) @ np.linalg.inv(h) @ np.array(target)
        formula = det * math.exp(-0.5 * q) / (2 * np.pi * math.sqrt(np.linalg.det(h)))
        assert formula == pytest.approx(summed, rel=1e-6)


def test_areas_bound_the_geometric_mean_of_the_axes():
    """S_proj / pi <= sqrt(l0 l1) <= C_eta S_proj / pi for everything in view."""
    rng = np.random.default_rng(1)
    k = np.array([[300.0, 0.0, 150.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]])
    size, r = (320, 200), 0.03
    far_x, far_y = max(150, 320 - 150) / 300, max(60, 200 - 60) / 200
    c_eta = math.sqrt(1 + far_x**2 + far_y**2)
    for _ in range(500):
        z = rng.uniform(0.5, 9)
        u, v = rng.uniform(0, size[0]), rng.uniform(0, size[1])
        o = np.array([(u - k[0, 2]) / k[0, 0] * z, (v - k[1, 2]) / k[1, 1] * z, z])
        n = rng.normal(size=3)
        n /= np.linalg.norm(n)
        *_, det = ewa.screen_covariance(*o, tuple(n), k)
        share = r * r * k[0, 0] * k[1, 1] * abs(o @ n) / np.linalg.norm(o) / z**2
        assert share * (1 - 1e-12) <= r * r * det <= c_eta * share * (1 + 1e-12)


@pytest.mark.parametrize("eigen", [False, True])
def test_the_choice_of_one_point(eigen):
    choice = Filters(1.0, 1.0, 1.0, 1.0, False, 0.3, 3.0, 1.2, eigen)
    for a, b in ((10.0, 10.0), (0.1, 0.1), (1.0, 1.0), (50.0, 0.01), (4.0, 3.5)):
        area = math.sqrt(a * b)
        mode = ewa.choose_mode(a, 0.0, b, area, 1.0, area, choice)
        if eigen:
            wanted = ewa.RECONSTRUCTION if min(a, b) > 3 else ewa.LOW_PASS if max(a, b) < 0.3 else ewa.FULL
        else:
            wanted = ewa.RECONSTRUCTION if area > 3 else ewa.LOW_PASS if 1.2 * area < 0.3 else ewa.FULL
        assert mode == wanted


def test_an_ellipse_without_low_pass_has_a_floor_and_an_exact_determinant():
    record = np.zeros(ewa.RECORD, np.float32)
    for o, n, _, _ in zip(*random_surfels(200, seed=2)):
        xx, xy, yy, det = ewa.screen_covariance(*o, tuple(n), K)
        r2 = (0.01 * o[2]) ** 2
        rx, ry, area = ewa.put_ellipse(xx, xy, yy, det, r2, 0.0, record)
        a, b, c = (float(record[i]) for i in (ewa.XX, ewa.XY, ewa.YY))
        h = np.linalg.inv(np.array([[a, b / 2], [b / 2, c]]))
        values = np.linalg.eigvalsh(h)
        assert values[0] >= ewa.FLOOR * (1 - 0.02)
        assert area == pytest.approx(np.linalg.det(h), rel=0.02)
        assert (rx, ry) == pytest.approx((math.sqrt(h[0, 0]), math.sqrt(h[1, 1])), rel=0.02)


def test_a_wide_point_stays_within_the_image_of_its_sphere():
    rng = np.random.default_rng(5)
    k = np.array([[50.0, 4.0, 40.0], [0.0, 60.0, 30.0], [0.0, 0.0, 1.0]])
    for _ in range(300):
        o, r = rng.normal(size=3) * [2, 2, 0] + [0, 0, rng.uniform(0.2, 3)], rng.uniform(0.1, 1.5)
        on_sphere = rng.normal(size=(4000, 3))
        on_sphere = o + r * on_sphere / np.linalg.norm(on_sphere, axis=1, keepdims=True)
        on_sphere = on_sphere[on_sphere[:, 2] > 1e-9]
        box = np.array([0, 79, 0, 59, 0], np.int16)
        kept = ewa.clip_to_sphere(tuple(o), r, k, 1.0, box)
        y = on_sphere[:, 1] / on_sphere[:, 2]
        u = (k[0, 0] * on_sphere[:, 0] / on_sphere[:, 2] + k[0, 1] * y + k[0, 2]) - 0.5
        v = k[1, 1] * y + k[1, 2] - 0.5
        inside = (u > 0) & (u < 79) & (v > 0) & (v < 59)
        if inside.any():
            assert kept
            assert box[0] - 1 <= u[inside].min() and u[inside].max() <= box[1] + 1
            assert box[2] - 1 <= v[inside].min() and v[inside].max() <= box[3] + 1
    # Beside the eye, far outside the view: nothing is left of an ellipse that would cover the image.
    assert not ewa.clip_to_sphere((1.0, 0.0, 0.1), 0.067, k, 1.0, np.array([0, 79, 0, 59, 0], np.int16))
