"""Quads between pixel centres: every pair of samples tested on its own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from torchrender.kernels.warp.corners import ALONE, DIAGONAL, EDGE_ON, FIRST, SECOND
from torchrender.kernels.warp.depth_grid import fit_blocks

PLACES = ((0, 0), (1, 0), (1, 1), (0, 1))  # row and column of the four samples of a block


@pytest.mark.parametrize("match", [False, True])
@pytest.mark.parametrize("adaptive", [False, True])
def test_blocks_against_a_loop(adaptive: bool, match: bool) -> None:
    rng = np.random.default_rng(2 * adaptive + match)
    height, width = 12, 14
    matrix = np.linalg.inv(np.array([[9.0, 0, 7], [0, 9.0, 6], [0, 0, 1]])).T
    depth = (3.0 + rng.choice([0.0] * 7 + [0.01, 0.5], (1, height, width))).astype(np.float32)
    depth[rng.random(depth.shape) < 0.05] = np.inf
    normal = rng.normal(0, 0.08, (1, height, width, 3)) - [0, 0, 1.0]
    normal = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
    ids = rng.choice([1, 1, 1, 2], (1, height, width)) if match else np.zeros((1, 0, 0), np.int64)
    limits = np.array([[0.02, 0.1, 2.0, 0.1]])
    corners = np.full((1, height - 1, 4, width - 1), np.nan, np.float32)
    shape, joined = np.zeros((1, height - 1, width - 1), np.uint8), np.full((1, height + 1, width + 1), -1, np.int32)
    fit_blocks((depth, normal, ids), matrix[None], limits, adaptive, corners, shape, joined)

    def on_plane(a: tuple[int, int], b: tuple[int, int]) -> bool:
        """Sample b lies on the tangent plane of sample a."""
        z, other = float(depth[(0, *a)]), float(depth[(0, *b)])
        m = matrix @ normal[(0, *a)].astype(float)
        here, there = (m @ [p[1] + 0.5, p[0] + 0.5, 1.0] for p in (a, b))
        target = z * here / there if abs(there) >= EDGE_ON and z * here / there > 0 else z
        return abs(other - target) <= 0.02 * z + 0.1 * abs(target - z)

    seen = set()
    for j, i in np.ndindex(height - 1, width - 1):
        block = [(j + y, i + x) for y, x in PLACES]
        zs = [float(depth[(0, *p)]) for p in block]
        np.testing.assert_array_equal(corners[0, j, :, i], np.array(zs, np.float32))

        def linked(a: int, b: int) -> bool:
            p, q = block[a], block[b]  # noqa: B023
            if not (np.isfinite(zs[a]) and np.isfinite(zs[b])):  # noqa: B023
                return False
            return (not match or ids[(0, *p)] == ids[(0, *q)]) and on_plane(p, q) and on_plane(q, p)

        options = []
        flatter = abs(zs[1] - zs[3]) < abs(zs[0] - zs[2])
        for diagonal in [flatter, not flatter] if adaptive else [False]:
            triangles = ((1, 2, 3), (3, 0, 1)) if diagonal else ((0, 1, 2), (2, 3, 0))
            present = [all(linked(a, b) for a, b in itertools.combinations(t, 2)) for t in triangles]
            options.append((present, diagonal, triangles))
        whole = [o for o in options if all(o[0])]
        some = [o for o in options if any(o[0])]
        present, diagonal, triangles = (whole or some or options)[0]
        bits = (FIRST if present[0] else 0) | (SECOND if present[1] else 0)
        bits |= DIAGONAL if bits and diagonal else 0
        assert shape[0, j, i] == bits
        used = {k for t, ok in zip(triangles, present, strict=True) if ok for k in t}
        word = int(joined[0, j + 1, i + 1])
        if not used:
            assert word == ALONE
        else:  # pixel k of the block is the one around its corner that is numbered (k + 2) % 4
            labels = [(word >> (2 * ((k + 2) % 4))) & 3 for k in range(4)]
            assert len({labels[k] for k in used}) == 1
            assert all(labels[k] != labels[min(used)] for k in range(4) if k not in used)
            leaders = {k for k in range(4) if (word >> (8 + k)) & 1}
            assert labels[min(used)] in leaders
        seen.add(bits)
    assert {0, FIRST, SECOND, FIRST | SECOND} <= seen and adaptive == any(b & DIAGONAL for b in seen)
