"""Carrying light against plain loops."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.warp.carrying import CLOSE, STEPS, carry_mirrors, carry_surfaces

MATERIALS = np.array([0, 1, 1, 0])
LIMITS = (0.05, 0.25)


def pixels(rng: np.random.Generator, height: int, width: int):
    """Depth, triangle and object of random pixels, some of them empty."""
    triangle = rng.integers(-1, 4, (height, width))
    depth = np.where(triangle >= 0, rng.choice([2.0, 2.04, 5.0], (height, width)), np.inf).astype(np.float32)
    owner = np.where(triangle >= 0, triangle // 2, -1) + 10 * (rng.random((height, width)) < 0.2)
    return depth, triangle, owner  # one object by several names: other things lie before it


def matrices(rng: np.random.Generator):
    """From one pixel and depth to the other, and back, of two cameras beside each other."""
    intrinsics = np.array([[9.0, 0.0, 4.5], [0.0, 9.0, 3.5], [0.0, 0.0, 1.0]])
    shift = rng.uniform(-0.2, 0.2, 3)
    there = np.concatenate([np.eye(3), (intrinsics @ shift)[:, None]], axis=1)
    back = np.concatenate([np.eye(3), (intrinsics @ -shift)[:, None]], axis=1)
    return there, back


def projected(matrix: np.ndarray, u: float, v: float, z: float) -> tuple[float, float, float]:
    """Place and depth in the other camera."""
    point = matrix[:, :3] @ (u, v, 1.0) if math.isinf(z) else z * matrix[:, :3] @ (u, v, 1.0) + matrix[:, 3]
    return point[0] / point[2], point[1] / point[2], point[2]


def around(x: float, y: float, shape: tuple[int, int]):
    """Pixels around a place with their bilinear weights."""
    for row in range(math.floor(y), math.floor(y) + 2):
        for column in range(math.floor(x), math.floor(x) + 2):
            if 0 <= row < shape[0] and 0 <= column < shape[1]:
                yield (row, column), (1 - abs(x - column)) * (1 - abs(y - row))


@pytest.mark.parametrize("seed", range(4))
def test_surfaces_against_a_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, source, (there, _) = pixels(rng, 7, 9), pixels(rng, 6, 8), matrices(rng)
    light = rng.random((6, 8, 3)).astype(np.float32)
    before = rng.random((7, 9)) < 0.1
    known, out = before.copy(), np.zeros((7, 9, 3), np.float32)
    carry_surfaces(seen, source, light, MATERIALS, there, LIMITS, known, out)
    for j, i in np.ndindex(7, 9):
        if before[j, i]:
            assert known[j, i] and not out[j, i].any(), "what is known stays"
            continue
        face = seen[1][j, i]
        x, y, w = projected(there, i + 0.5, j + 0.5, float(seen[0][j, i]))
        total, color = 0.0, np.zeros(3)
        if -0.5 <= x - 0.5 <= 7.5 and -0.5 <= y - 0.5 <= 5.5:
            for at, share in around(x - 0.5, y - 0.5, (6, 8)):
                found = source[1][at]
                if source[2][at] != seen[2][j, i]:
                    continue
                if found != face:
                    if min(found, face) < 0 or MATERIALS[found] != MATERIALS[face]:
                        continue
                    apart = abs(1 / w - 1 / source[0][at]) / max(1 / w, 1 / source[0][at])
                    share *= math.exp(-((apart / LIMITS[0]) ** 2))
                total, color = total + share, color + share * light[at]
        assert known[j, i] == (total >= LIMITS[1])
        assert np.allclose(out[j, i], color / total if total >= LIMITS[1] else 0.0, atol=1e-5)
    assert known.any() and not known.all()


@pytest.mark.parametrize("seed", range(4))
def test_mirrors_against_a_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, (there, back) = pixels(rng, 7, 9), matrices(rng)
    source = np.repeat(np.repeat(rng.integers(0, 2, (2, 2)), 3, axis=0), 4, axis=1)
    virtual = rng.choice([4.0, 7.0, np.inf], (6, 8)).astype(np.float32)
    light, mirrors = rng.random((6, 8, 3)).astype(np.float32), rng.random((6, 8)) < 0.8
    wanted, reach = rng.random((7, 9)) < 0.9, 0.3
    depth, out, state = np.full((7, 9), np.inf, np.float32), np.zeros((7, 9, 3), np.float32), np.zeros((7, 9), np.uint8)
    carry_mirrors(seen, source, (virtual, light, mirrors), there, back, reach, wanted, (depth, out, state))
    for j, i in np.ndindex(7, 9):
        expected = _mirrored(seen, source, virtual, mirrors, (there, back), reach, (j, i)) if wanted[j, i] else None
        if expected is None:
            assert state[j, i] == 0 and not out[j, i].any()
            continue
        weights, far, kind = expected
        assert state[j, i] == kind
        assert np.isclose(depth[j, i], far, rtol=1e-5)
        color = sum(share * light[at] for at, share in weights) / sum(share for _, share in weights)
        assert np.allclose(out[j, i], color, atol=1e-4)
    assert {1, 2} <= set(state.ravel())


def _mirrored(seen, source, virtual, mirrors, matrices, reach, pixel):
    """Weights of the pixels whose light is taken, depth of the virtual point, and state."""
    (j, i), (there, back) = pixel, matrices
    if seen[1][j, i] < 0:
        return None

    def fits(at) -> bool:
        return bool(mirrors[at] and source[at] == seen[2][j, i])

    x, y, _ = projected(there, i + 0.5, j + 0.5, float(seen[0][j, i]))
    near = [(share, at) for at, share in around(x - 0.5, y - 0.5, (6, 8)) if fits(at)]
    if not near:
        return None
    at = max(near, key=lambda one: one[0])[1]
    made, best = ([(at, 1.0)], float(seen[0][j, i]), 2), reach
    for _ in range(STEPS):
        u, v, ahead = projected(back, at[1] + 0.5, at[0] + 0.5, float(virtual[at]))
        du, dv = i + 0.5 - u, j + 0.5 - v
        error = max(abs(du), abs(dv))
        if error < best:
            place = at[1] + min(max(du, -1.0), 1.0), at[0] + min(max(dv, -1.0), 1.0)
            weights = [(one, share + 1e-9) for one, share in around(*place, (6, 8)) if fits(one)]
            kept = weights if weights else made[0]
            made, best = (kept, ahead if np.isfinite(virtual[at]) else np.inf, 1), error
        at = math.floor(at[0] + 0.5 + dv), math.floor(at[1] + 0.5 + du)
        if error < CLOSE or not (0 <= at[0] < 6 and 0 <= at[1] < 8) or not fits(at):
            break
    return made
