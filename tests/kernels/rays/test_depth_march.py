"""Marches through depth images against a loop over every step, without blocks, in plain Python."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.rays.depth_march import (
    BLOCK,
    CLEAR,
    EDGE,
    GROUP,
    HIT,
    UNKNOWN,
    DepthImage,
    MarchedHits,
    march_rays,
    nearest_depths,
)

SIZE = (40, 26)  # columns, rows
K = np.array([[20.0, 0.5, 20.0], [0.0, 22.0, 13.0], [0.0, 0.0, 1.0]])
NEAR, FOOTPRINT, EPSILON = 0.2, 0.004, 1e-5


def crossing(vertices: np.ndarray, face: np.ndarray, p: np.ndarray, d: np.ndarray) -> tuple[float, float, float]:
    a, b, c = vertices[face]
    matrix = np.stack([-d, b - a, c - a], axis=1)
    if abs(np.linalg.det(matrix)) < 1e-15:
        return math.inf, 0.0, 0.0
    return tuple(np.linalg.solve(matrix, p - a))


def image_of(vertices: np.ndarray, faces: np.ndarray) -> DepthImage:
    """Ray traced, pixel by pixel; the camera is at the origin and looks along z."""
    width, height = SIZE
    depth, triangle = np.full((height, width), np.inf, np.float32), np.full((height, width), -1)
    inverse = np.linalg.inv(K)
    for y in range(height):
        for x in range(width):
            d = inverse @ [x + 0.5, y + 0.5, 1.0]
            for k, face in enumerate(faces):
                t, u, v = crossing(vertices, face, np.zeros(3), d)
                if NEAR < t < depth[y, x] and u >= 0 and v >= 0 and u + v <= 1:
                    depth[y, x], triangle[y, x] = t, k
    blocks = np.zeros((-(-height // BLOCK), -(-width // BLOCK)), np.float32)
    nearest_depths(depth, blocks)
    for y in range(blocks.shape[0]):
        for x in range(blocks.shape[1]):
            part = depth[y * BLOCK : (y + 1) * BLOCK, x * BLOCK : (x + 1) * BLOCK]
            assert blocks[y, x] == part.min()
    return DepthImage(depth, triangle, blocks, np.concatenate([K, np.zeros((3, 1))], axis=1), NEAR, FOOTPRINT)


def march(vertices: np.ndarray, faces: np.ndarray, image: DepthImage, p: np.ndarray, d: np.ndarray, last: float):
    """What the text of algorithm 7 says, one texel step after the other."""
    t0, t1 = 0.0, last
    z0, z1 = p[2] + t0 * d[2], p[2] + t1 * d[2]
    known = z1 >= NEAR
    if z0 < NEAR and z1 <= NEAR:
        return UNKNOWN, math.inf, -1
    if z0 < NEAR:
        t0, z0 = t0 + (NEAR - z0) / d[2], NEAR
    elif z1 < NEAR:
        t1, z1 = (NEAR - p[2]) / d[2], NEAR

    def pixel(t: float, z: float) -> np.ndarray:
        return (K @ (p + t * d))[:2] / z

    start, change = pixel(t0, z0), pixel(t1, z1) - pixel(t0, z0)
    first, end = 0.0, 1.0
    for axis in range(2):
        if change[axis] == 0.0:
            if not 0 <= start[axis] <= SIZE[axis]:
                return UNKNOWN, math.inf, -1
            continue
        a, b = sorted([-start[axis] / change[axis], (SIZE[axis] - start[axis]) / change[axis]])
        first, end = max(first, a), min(end, b)
    if end < first:
        return UNKNOWN, math.inf, -1
    known = known and first <= 0.0 and end >= 1.0
    count = max(1.0, math.ceil(np.abs(change).max()))

    def depth_at(share: float) -> float:
        return 1.0 / (1.0 / z0 + share * (1.0 / z1 - 1.0 / z0))

    def length_at(share: float) -> float:
        return t0 + (depth_at(share) - z0) / d[2] if abs(d[2]) > 1e-9 else t0 + (t1 - t0) * share

    before, behind = first, False
    m = max(1.0, math.ceil(first * count))
    while m <= math.floor(end * count + 1e-9):
        share = m / count
        m += 1.0
        x, y = (int(min(max(start[a] + share * change[a], 0), SIZE[a] - 1)) for a in range(2))
        z, surface = depth_at(share), float(image.depth[y, x])
        if z < surface * (1.0 + EPSILON):
            before, behind = share, False
            continue
        around = image.triangle[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        best, which = math.inf, -1
        for k in np.unique(around[around >= 0]):
            t, u, v = crossing(vertices, faces[k], p, d)
            if t0 < t < best and u >= -EDGE and v >= -EDGE and u + v <= 1 + EDGE:
                best, which = t, int(k)
        if which >= 0 and best <= length_at(min(share + 2.0 / count, 1.0)) * (1 + 1e-9):
            return HIT, best, which
        explained = abs(z - depth_at(max(share - 1.0 / count, 0.0)))  # one step, not more
        if not behind and z - surface <= max(4.0 * FOOTPRINT * surface, explained):
            k = int(image.triangle[y, x])
            t, _, _ = crossing(vertices, faces[k], p, d)
            low, high = length_at(before), length_at(share)
            return HIT, t if low <= t <= high else high, k
        behind, known, before = True, False, share
    return (CLEAR if known else UNKNOWN), math.inf, -1


def run(vertices, faces, image, p, d, last):
    n = len(p)
    found = MarchedHits(
        np.zeros(n, np.uint8), np.zeros(n), np.zeros(n, np.int64), np.zeros((n, 2), np.float32),
        np.zeros(-(-n // GROUP) + 1, np.int64),
    )  # fmt: skip
    march_rays((vertices, faces), image, EPSILON, (p, d), np.arange(n), (0.0, last), found)
    return found


@pytest.mark.parametrize("seed", range(4))
def test_rays_through_a_soup_against_the_loop(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centre = np.concatenate([rng.uniform(-2, 2, (14, 1, 2)), rng.uniform(2, 6, (14, 1, 1))], axis=2)
    vertices = (centre + rng.normal(0, 0.8, (14, 3, 3))).reshape(-1, 3)
    vertices[:, 2] = np.maximum(vertices[:, 2], 0.6)
    wall = np.array([[-9.0, -9, 7], [9, -9, 7], [9, 9, 7], [-9, 9, 7]])
    faces = np.concatenate([np.arange(42).reshape(14, 3), [[42, 43, 44], [42, 44, 45]]]).astype(np.int32)
    vertices = np.concatenate([vertices, wall])
    image = image_of(vertices, faces)
    n = 300
    p = np.column_stack([rng.uniform(-1.5, 1.5, (n, 2)), rng.uniform(-0.1, 2, n)])
    d = 0.5 * rng.normal(size=(n, 3)) + [0, 0, 0.5]
    last = rng.uniform(1, 5, n)
    found = run(vertices, faces, image, p, d, last)
    wanted = [march(vertices, faces, image, p[k], d[k], last[k]) for k in range(n)]
    states = np.array([w[0] for w in wanted])
    # Where rounding puts a step on the other side of a texel's edge, the two may part: that must be rare.
    same = (found.state == states) & (found.triangle == [w[2] for w in wanted])
    assert same.mean() > 0.99
    hit = same & (states == HIT)
    np.testing.assert_allclose(found.t[hit], np.array([w[1] for w in wanted])[hit], rtol=1e-6)
    assert hit.sum() > 2 and (states == CLEAR).sum() > 10 and (states == UNKNOWN).sum() > 10


@pytest.mark.parametrize(("behind", "wanted"), [(0.3, HIT), (0.9, HIT), (1.1, UNKNOWN), (1.5, UNKNOWN), (1.9, UNKNOWN)])
def test_a_ray_that_passes_a_rim_by_more_than_a_step_goes_on(behind: float, wanted: int) -> None:
    """Of the depth between a rim and a ray behind it, the ray's own last step explains what it gained, and no more."""
    vertices = np.array([[-9.0, -9, 2], [0.0, -9, 2], [0.0, 9, 2], [-9.0, 9, 2]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    image = image_of(vertices, faces)
    change, steps, rim = -0.02, 20, 10  # of inverse depth per texel; the step that first meets the card's texels
    low, high = 2.0, 9.0
    for _ in range(60):  # the depth at that step: ``behind`` steps beyond the card
        z = 0.5 * (low + high)
        low, high = (low, z) if z - 2.0 > behind * (z - 1.0 / (1.0 / z - change)) else (z, high)
    inverse = 1.0 / z - rim * change
    ends = []
    for m in (0, steps):
        depth = 1.0 / (inverse + m * change)
        ends.append(np.linalg.inv(K) @ [29.7 - m, 13.5, 1.0] * depth)
    assert behind < 0.5 or z - 2.0 > 4.0 * FOOTPRINT * 2.0  # not near enough to be one surface whatever the step
    p, d = ends[0], ends[1] - ends[0]
    found = run(vertices, faces, image, p[None], d[None], np.ones(1))
    slow = march(vertices, faces, image, p, d, 1.0)
    assert found.state[0] == slow[0] == wanted
