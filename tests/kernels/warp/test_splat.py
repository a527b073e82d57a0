"""Discs against a loop over all samples and pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.warp.splat import EDGE_ON, Disc, Samples, Target, box, draw_splats
from torchrender.kernels.warp.warp import Canvas

SIZE = (23, 19)


@pytest.mark.parametrize("near", [0.3, 2.0])
def test_discs_against_a_loop(near: float) -> None:
    """Also through the near plane; the image whose bias is less goes behind, at the bias of 1/depth only."""
    rng = np.random.default_rng(int(near))
    k, own = np.array([[18.0, 0.6, 11.0], [0, 20.0, 9.0], [0, 0, 1.0]]), np.array([[8.0, 0, 4], [0, 8.0, 4], [0, 0, 1]])
    turn = 0.2
    rotation = np.array([[math.cos(turn), 0, math.sin(turn)], [0, 1, 0], [-math.sin(turn), 0, math.cos(turn)]])
    shift = rng.normal(0, 0.3, (2, 3, 1))
    depth = rng.uniform(1.5, 4, (2, 8, 8)).astype(np.float32)
    depth[0, :3, :3] = np.inf
    normal = rng.normal(size=(2, 8, 8, 3)) - [0, 0, 2.0]
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
    rays = np.broadcast_to(np.linalg.inv(own), (2, 3, 3)).copy()
    poses = np.concatenate([rotation @ rays, shift], axis=2)
    samples = Samples(depth, normal, poses, rays, np.full(2, 1 / 8), np.array([1.0, 0.9]))
    keys = np.zeros(SIZE[0] * SIZE[1], np.uint64)
    draw_splats(samples, Target(rotation, k, near), 1.2, 2, Canvas(keys, *SIZE))
    best, owner = np.zeros(SIZE[::-1]), np.full(SIZE[::-1], -1)
    for b, j, i in np.ndindex(2, 8, 8):
        z = float(depth[b, j, i])
        if not np.isfinite(z):
            continue
        ray = rays[b] @ [i + 0.5, j + 0.5, 1.0]
        n = normal[b, j, i].astype(float)
        facing = max(abs(ray @ n) / np.linalg.norm(ray), EDGE_ON)
        radius = math.sqrt(0.5) / 8 * z * 1.2 / facing
        centre, n = rotation @ (z * ray) + shift[b, :, 0], rotation @ n
        if n @ centre >= 0:
            continue
        for y, x in np.ndindex(SIZE[::-1]):
            d = np.linalg.inv(k) @ [x + 0.5, y + 0.5, 1.0]
            if n @ d >= 0:
                continue
            at = (n @ centre) / (n @ d)
            if at < near or np.linalg.norm(at * d - centre) > radius:
                continue
            q = float(np.float32(samples.bias[b] / at))
            if q > best[y, x]:
                best[y, x], owner[y, x] = q, (b * 8 + j) * 8 + i
    keys = keys.reshape(SIZE[::-1])
    found = np.where(keys > 0, 0xFFFFFFFF - (keys & np.uint64(0xFFFFFFFF)).astype(np.int64), -1)
    assert (found == owner).mean() > 0.99  # rounding may move a pixel that lies on a rim
    assert len(np.unique(found)) > 8
    same = (found == owner) & (owner >= 0)
    inverse = (keys >> np.uint64(32)).astype(np.uint32).view(np.float32)
    np.testing.assert_allclose(inverse[same], best[same], rtol=1e-6)


def test_boxes_hold_all_pixels_that_see_the_sphere_around_a_disc() -> None:
    """However far beside the axis, where spheres look long, and at a near plane that cuts them."""
    rng = np.random.default_rng(3)
    k = np.array([[6.0, 0.9, 11.0], [0, 5.0, 9.0], [0, 0, 1.0]])
    target = Target(np.eye(3), k, 0.3)
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]] + 0.5
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(k).T
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    seen = 0
    for _ in range(300):
        centre = rng.uniform(-1, 1, 3) * (4.0, 4.0, 0.0) + (0.0, 0.0, rng.uniform(0.4, 3.0))
        radius = rng.uniform(0.05, 0.95) * centre[2]
        along = rays @ centre
        hit = (centre @ centre - along**2 <= radius**2) & (along > 0)
        x0, y0, x1, y1 = box(Disc(tuple(centre), (0.0, 0.0, -1.0), radius), target, *SIZE)
        inside = np.zeros_like(hit)
        inside[max(y0, 0) : y1 + 1, max(x0, 0) : x1 + 1] = True
        assert not (hit & ~inside).any()
        seen += hit.any() and not inside.all()
    assert seen > 100
