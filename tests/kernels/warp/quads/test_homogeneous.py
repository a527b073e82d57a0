"""Homogeneous corners: products and boxes against what points on the triangle say."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.warp.quads.homogeneous import cross, point, visible_box


def test_points_and_products() -> None:
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(3, 4))
    wanted = 2.5 * (matrix[:, :3] @ [3 + 1.0, 4.0 + 0.5, 1.0]) + matrix[:, 3]
    np.testing.assert_allclose(point(3, 4.0, 1.0, 0.5, 2.5, matrix), wanted)
    a, b = rng.normal(size=(2, 3))
    np.testing.assert_allclose(cross(tuple(a), tuple(b)), np.cross(a, b))


def test_the_box_holds_what_lies_before_the_near_plane() -> None:
    rng = np.random.default_rng(1)
    near, width, height, cut = 0.5, 40, 30, 0
    for _ in range(200):
        corners = rng.uniform(-1, 1, (3, 3)) * (40, 30, 2) + (20, 15, 1.0)
        if (corners[:, 2] < near).all():
            continue
        cut += int((corners[:, 2] < near).any())
        x0, y0, x1, y1 = visible_box(*(tuple(c) for c in corners), near, width, height)
        assert x0 >= 0 and y0 >= 0 and x1 < width and y1 < height
        share = rng.dirichlet((1, 1, 1), 500)
        inside = share @ corners
        inside = inside[inside[:, 2] >= near]
        x, y = inside[:, 0] / inside[:, 2], inside[:, 1] / inside[:, 2]
        u, v = np.floor(x), np.floor(y)
        at_centre = (np.abs(x - u - 0.5) < 0.05) & (np.abs(y - v - 0.5) < 0.05)
        shown = at_centre & (u >= 0) & (v >= 0) & (u < width) & (v < height)
        assert (u[shown] >= x0 - 1).all() and (u[shown] <= x1 + 1).all()
        assert (v[shown] >= y0 - 1).all() and (v[shown] <= y1 + 1).all()
        low, high = np.ceil([x.min() - 0.5, y.min() - 0.5]), np.floor([x.max() - 0.5, y.max() - 0.5])
        assert x0 <= max(low[0], 0) and y0 <= max(low[1], 0)
        assert x1 >= min(high[0], width - 1) and y1 >= min(high[1], height - 1)
    assert cut > 30
