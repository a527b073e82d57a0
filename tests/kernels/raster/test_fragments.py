"""Refusals that refuse fragments, against loops over images and pixels."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.raster.fragments import AGREES, CAPTURED, IDENTITY, is_hole, redundant_samples
from torchrender.kernels.raster.records import SOLID, Earlier, Holes

SIZE = (9, 7)  # columns, rows of the earlier images


def camera(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intrinsics with skew, a small rotation, and an eye."""
    k = np.array([[8.0, 0.4, 4.3], [0.0, 9.0, 3.6], [0.0, 0.0, 1.0]])
    turn = rng.normal(0, 0.1, 3)
    angle = np.linalg.norm(turn)
    cross = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]]) / angle
    return k, np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross, rng.normal(0, 0.3, 3)


def earlier_images(rng: np.random.Generator, count: int, test: int, ratio: float):
    """Earlier images with random contents, and their cameras; the image that is drawn looks along z from the origin."""
    matrix = np.array([[10.0, 0.0, 0.3], [0.0, 11.0, -0.2], [0.0, 0.0, 1.0]])
    inverse = np.linalg.inv(matrix)
    cameras = [camera(rng) for _ in range(count)]
    pixels, lenses = np.zeros((count, 3, 4)), np.zeros((count, 9))
    for j, (k, rotation, eye) in enumerate(cameras):
        pixels[j, :, :3], pixels[j, :, 3] = k @ rotation @ inverse, -k @ rotation @ eye
        lenses[j] = (k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1], 1 / min(k[0, 0], k[1, 1]), *(matrix @ eye))
    ids = rng.integers(0, 3, (count, SIZE[1], SIZE[0]))
    depth = rng.uniform(1.5, 5, (count, SIZE[1], SIZE[0])).astype(np.float32)
    near = rng.uniform(0.5, 2.0, count)
    return cameras, Earlier(ids, pixels, near, depth, lenses, matrix, inverse, test, ratio, 0.1)


def redundant(t: int, spot: np.ndarray, key: float, slope: np.ndarray, cameras, earlier: Earlier) -> bool:
    """By world points, ray by ray (specification 01, sections 5 and 13)."""
    z = float(np.float32(1.0 / key))
    ray = earlier.inverse @ [*spot, 1.0]
    plane = earlier.matrix.T @ [*slope, 1.0 / z - slope @ spot]  # n with n.X = 1 on the plane
    if earlier.test == IDENTITY and earlier.ratio == np.inf:
        plane = earlier.matrix.T @ [0.0, 0.0, 1.0 / z]
    point, n = z * ray, plane / np.linalg.norm(plane)
    for j, (k, rotation, eye) in enumerate(cameras):
        x, y, depth = k @ rotation @ (point - eye)
        if depth < earlier.near[j]:
            continue
        u, v = x / depth, y / depth
        if not (0 <= u < SIZE[0] and 0 <= v < SIZE[1]):
            continue
        there = abs(n @ (point - eye)) / np.linalg.norm(point - eye)
        here = abs(n @ ray) / np.linalg.norm(ray)
        stored = float(earlier.depth[j, int(v), int(u)])
        tolerance = 2.0 * depth * earlier.lenses[j, 5] / max(there, 0.1)
        if earlier.test == IDENTITY:
            found = earlier.ids[j, int(v), int(u)] == t
        elif earlier.test == CAPTURED:
            found = depth <= stored + tolerance
        else:
            rows, columns = (math.floor(v - 0.5), math.floor(v + 0.5)), (math.floor(u - 0.5), math.floor(u + 0.5))
            around = [earlier.ids[j, r, c] == t for r in rows for c in columns if 0 <= r < SIZE[1] and 0 <= c < SIZE[0]]
            found = abs(stored - depth) <= tolerance or any(around)
        coarser = depth * earlier.lenses[j, 5] / there > earlier.ratio * earlier.footprint * z / here
        if found and not coarser:
            return True
    return False


@pytest.mark.parametrize("ratio", [np.inf, 1.3])
@pytest.mark.parametrize("test", [IDENTITY, AGREES, CAPTURED])
def test_redundant_samples_against_a_loop(test: int, ratio: float) -> None:
    rng = np.random.default_rng(test)
    seen = np.zeros(2, int)
    for _ in range(20):
        cameras, earlier = earlier_images(rng, 2, test, ratio)
        n = 60
        triangle, spot = rng.integers(0, 4, n), rng.uniform(-5, 5, (n, 2))
        key, slope = 1.0 / rng.uniform(1.5, 5, n), rng.normal(0, 0.02, (n, 2))
        known = np.zeros(n, np.bool_)
        known[0] = True
        triangle[1] = -1
        redundant_samples(triangle, spot, key, slope, earlier, known)
        assert known[0] and not known[1]
        wanted = [redundant(triangle[i], spot[i], key[i], slope[i], cameras, earlier) for i in range(2, n)]
        np.testing.assert_array_equal(known[2:], wanted)
        seen += np.bincount(known[2:], minlength=2)
    assert seen.min() > 50


def test_a_fragment_before_the_near_plane_of_an_image_is_not_known_there() -> None:
    rng = np.random.default_rng(3)
    _, earlier = earlier_images(rng, 1, IDENTITY, np.inf)
    same = earlier._replace(ids=np.full_like(earlier.ids, 7))
    for near, wanted in ((2.0, True), (100.0, False)):
        known = np.zeros(1, np.bool_)
        shown = same._replace(near=np.array([near]))
        redundant_samples(np.array([7]), np.zeros((1, 2)), np.array([0.25]), np.zeros((1, 2)), shown, known)
        assert known[0] == wanted


@pytest.mark.parametrize("wraps", [(0, 0), (1, 2), (5, 7)])
def test_holes_are_the_missing_texels(wraps: tuple[int, int]) -> None:
    rng = np.random.default_rng(4)
    uv = rng.uniform(-1.5, 2.5, (9, 3)).astype(np.float32)
    uv[:, 2] = rng.uniform(0.4, 1.0, 9)
    uv[8] = np.nan
    faces = np.array([[0, 1, 2], [3, 4, 5], [5, 6, 7], [6, 7, 8]], np.int32)
    mask = np.array([1, -1, 0, 0], np.int32)
    pictures = [rng.integers(0, 256, (3, 5)), rng.integers(0, 256, (4, 2))]  # rows from the top
    table = np.array([[0, 3, 5, wraps[0]], [15, 4, 2, wraps[1]]], np.int64)
    texels = np.concatenate([p.reshape(-1) for p in pictures]).astype(np.uint8)
    holes = Holes(mask, table, texels, uv)
    for t in range(4):
        for _ in range(100):
            u = rng.uniform(0, 1)
            v = rng.uniform(0, 1 - u)
            wanted = False
            if mask[t] >= 0 and t != 3:
                a, b, c = uv[faces[t]].astype(float)
                s, r, opacity = a + u * (b - a) + v * (c - a)
                picture, wrap = pictures[mask[t]], wraps[mask[t]]
                s, r = ((x % 1, 1 - abs(1 - x % 2), min(max(x, 0), 1))[w] for x, w in ((s, wrap % 3), (r, wrap // 3)))
                row = min(int((1 - r) * len(picture)), len(picture) - 1)
                wanted = picture[row, min(int(s * picture.shape[1]), picture.shape[1] - 1)] * opacity < SOLID
            assert is_hole(t, u, v, faces, holes) == wanted
