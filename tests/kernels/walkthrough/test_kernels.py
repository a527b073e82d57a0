"""Every loop against a slow twin."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
import torch

from torchrender.kernels.walkthrough import splat
from torchrender.kernels.walkthrough.clusters import join_cells
from torchrender.kernels.walkthrough.culling import visible
from torchrender.kernels.walkthrough.density import Comparison, Photos, compare, restore
from torchrender.kernels.walkthrough.fill import Search, synthesise, window_cost
from torchrender.kernels.walkthrough.pinholes import close_pinholes
from torchrender.kernels.walkthrough.plane_pixels import shade_planes
from torchrender.kernels.walkthrough.texture import HOLE, SEEN, UNSEEN, Patch, Votes, resample
from torchrender.kernels.walkthrough.view_colors import SCALE, STEP, Looks, Residuals, add_residuals
from torchrender.numerics.color import srgb_from_linear
from torchrender.walkthrough.model import build_atlas


def photos(count: int = 3, size: int = 12, seed: int = 0, flat: bool = False) -> tuple[Photos, np.ndarray]:
    """Cameras side by side in front of a slightly bumpy wall at depth 2; world from camera (N,4,4)."""
    rng = np.random.default_rng(seed)
    depth = np.full((count, size, size), 2.0) + (0 if flat else 0.01) * rng.normal(size=(count, size, size))
    depth = depth.astype(np.float32)
    if not flat:
        depth[1, 3, 4], depth[2, 5, 5] = 0.0, np.inf
    normal = np.zeros((count, size, size, 3), np.int16)
    normal[..., 2] = -32767
    pose = np.tile(np.eye(4), (count, 1, 1))
    pose[:, 0, 3] = 0.12 * np.arange(count)
    pose[:, 2, 3] = 0.05 * np.arange(count)
    made = Photos(
        color=rng.integers(0, 256, (count, size, size, 3)).astype(np.uint8),
        depth=depth,
        normal=normal,
        plane=np.full((count, size, size), 0 if flat else -1, np.int32),
        guard=(rng.random((count, size, size)) < (0 if flat else 0.1)).astype(np.uint8),
        feather=np.full((count, size, size), 20, np.uint8),
        lens=np.tile([10.0, 10.0, size / 2, size / 2], (count, 1)),
        log_quality=np.zeros(count),
        noise=np.array([0.0, 0.0, 0.005])[:count],
    )
    return made, pose


def seen_in(made: Photos, pose: np.ndarray, i: int, j: int, y: int, x: int):
    """Pixel of photo j and depth there of pixel (y, x) of photo i, or None."""
    fx, fy, cx, cy = made.lens[i]
    z = float(made.depth[i, y, x])
    p = np.array([(x + 0.5 - cx) / fx * z, (y + 0.5 - cy) / fy * z, z, 1.0])
    q = np.linalg.inv(pose[j]) @ pose[i] @ p
    if q[2] <= 0:
        return None
    u, v = fx * q[0] / q[2] + cx, fy * q[1] / q[2] + cy
    height, width = made.depth.shape[1:]
    return (int(v), int(u), q) if 0 <= u < width and 0 <= v < height else None


def test_compare_and_restore() -> None:
    made, pose = photos()
    i, others = 0, np.array([1, 2])
    move = np.ascontiguousarray((np.linalg.inv(pose[others]) @ pose[i])[:, :3])
    limits = Comparison(0.01, 2.0, 0.02, 2.0, 300.0)
    size = made.depth.shape[1]
    keep, through = np.zeros((size, size), np.uint8), np.zeros((size, size), np.uint8)
    blended, fused = np.zeros((size, size, 3), np.uint8), np.zeros((size, size), np.float32)
    compare(i, others, move, made, limits, (keep, blended, fused, through))
    for y in range(size):
        for x in range(size):
            z = float(made.depth[i, y, x])
            own = 100.0 / z**2
            weighed = own * (0.25 if made.guard[i, y, x] else 1.0)
            best, total, color, votes = True, 1.0, made.color[i, y, x].astype(float), 0
            ws, shift = 1 / z**4, 0.0
            for j in others:
                hit = seen_in(made, pose, i, j, y, x)
                if hit is None:
                    continue
                v, u, q = hit
                found = float(made.depth[j, v, u])
                if found <= 0:
                    continue
                gap, slack = found - q[2], max(0.01, 3 * made.noise[j] * q[2]) * q[2]
                if gap > 2 * slack:
                    votes += made.guard[j, v, u] == 0
                    continue
                if abs(gap) > slack:
                    continue
                density = 100.0 / q[2] ** 2
                share = (density / weighed) ** 2
                color, total = color + share * made.color[j, v, u], total + share
                ws, shift = ws + q[2] ** -4, shift + q[2] ** -4 * gap
                if made.guard[j, v, u]:
                    continue
                a, b = round(math.log(density) / 0.02), round(math.log(weighed) / 0.02)
                best &= not (a > b or (a == b and j < i))
            assert keep[y, x] == best and through[y, x] == votes
            assert np.abs(blended[y, x] - color / total).max() <= 0.51
            assert fused[y, x] == pytest.approx(z + shift / ws, rel=1e-6)
    kept = (np.random.default_rng(1).random(made.depth.shape) < 0.02).astype(np.uint8)
    kept[i] = keep
    restored = np.zeros((size, size), np.uint8)
    restore(i, others, move, made, kept, 0.01, restored)
    for y in range(size):
        for x in range(size):
            held = False
            for j in others:
                hit = seen_in(made, pose, i, j, y, x)
                if hit is not None:
                    v, u, q = hit
                    near = [
                        (b, a)
                        for b in range(max(v - 1, 0), min(v + 2, size))
                        for a in range(max(u - 1, 0), min(u + 2, size))
                    ]
                    slack = max(0.01, 3 * made.noise[j] * q[2]) * q[2]
                    held |= any(kept[j, b, a] and abs(made.depth[j, b, a] - q[2]) <= slack for b, a in near)
            assert restored[y, x] == (keep[y, x] == 0 and not held)


def test_textures_by_the_mean_of_what_photos_see() -> None:
    made, pose = photos(flat=True)
    # A window in the second photo: it sees through.
    made.depth[1, 2:4, 2:4] = np.inf
    patch = Patch(
        np.array([-0.5, -0.5, 2.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, -1.0]), 0.1, 0
    )
    poses = np.ascontiguousarray(np.linalg.inv(pose)[:, :3])
    # All photos move along z, too: the wall is at one world depth only for the first.
    made.depth[1] = np.where(np.isfinite(made.depth[1]), 1.95, np.inf)
    made.depth[2] = 1.9
    color, state = np.zeros((14, 12, 3), np.uint8), np.zeros((14, 12), np.uint8)
    resample(patch, np.arange(3), poses, made, Votes(0.01, 2.0, 1, 4.0, 0.01, True), color, state)
    for row in range(14):
        for column in range(12):
            world = np.array([-0.5 + 0.1 * (column + 0.5), -0.5 + 0.1 * (row + 0.5), 2.0, 1.0])
            total, mean, through = 0.0, np.zeros(3), 0
            for j in range(3):
                q = np.linalg.inv(pose[j]) @ world
                u, v = 10 * q[0] / q[2] + 6, 10 * q[1] / q[2] + 6
                if not (0 <= u < 12 and 0 <= v < 12):
                    continue
                if made.depth[j, int(v), int(u)] > q[2] * (1 + max(0.01, 3 * made.noise[j] * q[2])):
                    through += 1
                    continue
                x, y = math.floor(u - 0.5), math.floor(v - 0.5)
                share, value = 0.0, np.zeros(3)
                for b in (0, 1):
                    for a in (0, 1):
                        if 0 <= x + a < 12 and 0 <= y + b < 12:
                            w = (u - 0.5 - x if a else 1 - (u - 0.5 - x)) * (v - 0.5 - y if b else 1 - (v - 0.5 - y))
                            share, value = share + w, value + w * made.color[j, y + b, x + a]
                total, mean = total + share, mean + value
            if total > 0:
                assert state[row, column] == SEEN and np.abs(color[row, column] - mean / total).max() <= 0.51
            else:
                assert state[row, column] == (HOLE if through else UNSEEN)


def test_filling_takes_the_window_that_fits_best() -> None:
    rng = np.random.default_rng(2)
    image = rng.random((14, 14, 2)).astype(np.float32)
    known = np.ones((14, 14), bool)
    known[6:8, 6:8] = False
    gauss = np.ones((3, 3))
    filled = known.copy()

    def cost(source: tuple[int, int]) -> float:
        total, weight = 0.0, 0.0
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                if filled[6 + dy, 6 + dx]:
                    weight += 1
                    total += float(((image[6 + dy, 6 + dx] - image[source[0] + dy, source[1] + dx]) ** 2).sum())
        return total / weight

    candidates = np.array([(y, x) for y in range(1, 13) for x in range(1, 13)
                           if known[y - 1 : y + 2, x - 1 : x + 2].all()])  # fmt: skip
    costs = [cost(tuple(c)) for c in candidates]
    for c, expected in zip(candidates, costs):
        assert window_cost(image, known, filled, gauss, (6, 6), tuple(c)) == pytest.approx(expected, rel=1e-5)
    made, source = image.copy(), np.full((14, 14, 2), -1, np.int32)
    picks = np.arange(len(candidates))[None]
    synthesise(made, known, ~known, Search(np.array([[6, 6]]), candidates, picks), gauss, 1.0, source)
    assert tuple(source[6, 6]) == tuple(candidates[int(np.argmin(costs))])
    assert np.array_equal(made[known], image[known])


def test_points_as_squares() -> None:
    rng = np.random.default_rng(3)
    count, width, height = 60, 24, 37
    position = np.stack([rng.uniform(-1, 1, count), rng.uniform(-1.6, 1.6, count), rng.uniform(1.5, 3, count)], 1)
    normal = np.zeros((count, 3), np.float32)
    normal[:, 2] = -1.0
    normal[7] = 0.0
    footprint = rng.uniform(0.07, 0.3, count).astype(np.float32)
    points = splat.Points(position.astype(np.float32), normal, rng.integers(0, 256, (count, 3)).astype(np.uint8),
                          footprint)  # fmt: skip
    view = splat.View(np.eye(4)[:3].copy(), np.array([16.0, 16.0, 12.0, 18.5]), 0.1, 100.0, 5.0, 1.0)
    runs, starts = np.array([[0, 25], [40, 60]]), np.array([0, 25])
    records = np.full((45, 4), np.nan, np.float32)
    splat.project(points, view, runs, starts, (width, height), records)
    table = (np.arange(256) / 255).astype(np.float32)
    image, depth = rng.random((height, width, 3)).astype(np.float32), np.full((height, width), np.inf, np.float32)
    depth[:9] = 2.2
    kind = np.where(np.isfinite(depth), 1, 0).astype(np.uint8)
    start = image.copy()
    space = (np.full((height, width), np.nan, np.float32), np.full((height, width, 4), np.nan, np.float32))
    front = depth.copy()
    splat.draw_points(
        (points.color, table), runs, starts, records, splat.Shares(0.9, 0.01, 2), space, (image, depth, kind)
    )
    nearest = (front * 0.9).astype(np.float64)
    squares = []
    for k in np.r_[0:25, 40:60]:
        x, y, z = points.position[k].astype(float)
        u, v = 16 * x / z + 12, 16 * y / z + 18.5
        side = min(max(math.ceil(16 / z * float(footprint[k]) - 0.05), 1), 5)
        x0, y0 = math.floor(u - 0.5 * (side - 1)), math.floor(v - 0.5 * (side - 1))
        squares.append((k, x0, y0, side, u, v, z))
        for b in range(max(y0, 0), min(y0 + side, height)):
            for a in range(max(x0, 0), min(x0 + side, width)):
                nearest[b, a] = min(nearest[b, a], z)
    totals = np.zeros((height, width, 4))
    for k, x0, y0, side, u, v, z in squares:
        for b in range(max(y0, 0), min(y0 + side, height)):
            for a in range(max(x0, 0), min(x0 + side, width)):
                if z <= nearest[b, a] * 1.01 and nearest[b, a] < front[b, a] * np.float32(0.9):
                    reach = 0.5 * side + 0.5
                    w = max(1 - abs(b + 0.5 - v) / reach, 0.02) * max(1 - abs(a + 0.5 - u) / reach, 0.02)
                    totals[b, a, :3] += w * table[points.color[k]]
                    totals[b, a, 3] += w
    covered = totals[..., 3] > 0
    assert 50 < covered.sum() < covered.size - 50 and covered[:9].any()
    assert np.array_equal(covered, kind == splat.POINT)
    assert np.allclose(depth[covered], nearest[covered], rtol=1e-5) and np.array_equal(depth[~covered], front[~covered])
    assert np.allclose(image[covered], totals[covered][:, :3] / totals[covered][:, 3:], atol=2e-4)
    assert np.array_equal(image[~covered], start[~covered])
    one = (start.copy(), front.copy(), np.zeros_like(kind))
    splat.draw_points((points.color, table), runs, starts, records, splat.Shares(0.9, 0.01, 1), space, one)
    assert np.array_equal(one[0], image) and np.array_equal(one[1], depth)


def test_pinholes_between_points() -> None:
    rng = np.random.default_rng(11)
    height, width = 20, 26
    kind = rng.choice([0, 1, 3], (height, width), p=[0.08, 0.12, 0.8]).astype(np.uint8)
    kind[:, :4] = 1  # a plane whose border no point may grow over
    depth = np.where(kind == 3, 2.0 + 0.02 * rng.random((height, width)), 3.0).astype(np.float32)
    depth[kind == 0] = np.inf
    depth[12:, 15:] += (kind[12:, 15:] == 3) * np.float32(0.7)  # a step between two surfaces of points
    image = rng.random((height, width, 3)).astype(np.float32)
    start = (image.copy(), depth.copy(), kind.copy())
    close_pinholes(image, depth, kind, np.full((height, width), np.nan, np.float32))

    def nearer(y: int, x: int) -> list[tuple[int, int]]:
        cells = [(y + b, x + a) for b in (-1, 0, 1) for a in (-1, 0, 1) if (a, b) != (0, 0)]
        points = [c for c in cells if start[2][c] == 3]
        if not points:
            return []
        least = min(start[1][c] for c in points)
        limit = min(least * 1.05, start[1][y, x] * 0.98)
        return [c for c in points if start[1][c] <= limit]

    inner = [(y, x) for y in range(1, height - 1) for x in range(1, width - 1)]
    holes = {c for c in inner if len(nearer(*c)) >= 6}
    assert len(holes) > 20 and any(start[2][c] == 1 for c in holes)
    for y in range(height):
        for x in range(width):
            if (y, x) in holes:
                by = [c for c in nearer(y, x) if c not in holes]
                if by:
                    assert kind[y, x] == 3
                    assert np.allclose(image[y, x], np.mean([start[0][c] for c in by], 0), atol=1e-5)
                    assert depth[y, x] == pytest.approx(np.mean([start[1][c] for c in by]), rel=1e-5)
            else:
                assert np.array_equal(image[y, x], start[0][y, x]) and kind[y, x] == start[2][y, x]


def test_boxes_that_a_camera_need_not_look_at() -> None:
    rng = np.random.default_rng(8)
    count = 40
    nodes = np.zeros((count, 15))
    nodes[:, :3], nodes[:, 12:] = rng.uniform(-3, 3, (count, 3)), rng.uniform(0.05, 0.8, (count, 3))
    nodes[:, 3:12] = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0].reshape(count, 9)
    # Two trees: 0 has 2 and 3, 2 has 4 and 5; all others are leaves of their own.
    links = np.stack([10 * np.arange(count), 10 * np.arange(count) + 7, np.zeros(count), np.zeros(count)], 1).astype(
        int
    )
    links[0, 2:], links[2, 2:] = (2, 4), (4, 6)
    roots = np.array([0, 1, *range(6, count)])
    planes = np.concatenate([rng.normal(size=(5, 3)), np.full((5, 1), 1.5)], 1)
    shadows = np.concatenate([rng.normal(size=(3, 2, 3)), np.full((3, 2, 1), 0.2)], 2)
    runs = np.empty((count, 2), np.int64)
    found, outside, hidden = visible(nodes, links, roots, planes, shadows, runs)

    def corners(k: int) -> np.ndarray:
        signs = np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
        return nodes[k, :3] + (signs * nodes[k, 12:]) @ nodes[k, 3:12].reshape(3, 3)

    expected, counts = set(), [0, 0]

    def walk(k: int) -> None:
        p = corners(k)
        inside = p @ planes[:, :3].T + planes[:, 3]
        dark = [p @ s[:, :3].T + s[:, 3] for s in shadows]
        size = links[k, 1] - links[k, 0]
        if (inside < 0).all(0).any():
            counts[0] += size
        elif any((d > 0).all() for d in dark):
            counts[1] += size
        elif links[k, 2] == links[k, 3] or ((inside >= 0).all() and not any((d > 0).any(0).all() for d in dark)):
            expected.add(tuple(links[k, :2]))
        else:
            for child in range(links[k, 2], links[k, 3]):
                walk(child)

    for r in roots:
        walk(r)
    assert {tuple(r) for r in runs[:found]} == expected and [outside, hidden] == counts
    assert min(counts) > 0 and expected


def test_texels_under_pixels() -> None:
    rng = np.random.default_rng(4)
    texture = rng.integers(0, 256, (8, 10, 4)).astype(np.uint8)
    texture[..., 3] = 255
    texture[2, 3, 3] = 254
    atlas = build_atlas([texture])
    # One texel a pixel, shifted by a fraction: level 0.
    matrix = np.array([[[1.0, 0, 0.3], [0, 1.0, -0.4], [0, 0, 1.0]]])
    image, kind = np.zeros((6, 7, 3), np.float32), np.zeros((6, 7), np.uint8)
    triangle = np.zeros((6, 7), np.int64)
    triangle[0, 0] = -1
    shade_planes(triangle, np.zeros(1, np.int64), matrix, atlas, image, kind)
    assert (image[0, 0] == 0).all() and kind[0, 0] == 0
    for y in range(6):
        for x in range(7):
            if triangle[y, x] < 0:
                continue
            s, t = x + 0.8, y + 0.1
            a, b = max(s - 0.5, 0), max(t - 0.5, 0)
            x0, y0 = int(a), int(b)
            value = np.zeros(3)
            for dy in (0, 1):
                for dx in (0, 1):
                    w = (a - x0 if dx else 1 - (a - x0)) * (b - y0 if dy else 1 - (b - y0))
                    value += w * texture[min(y0 + dy, 7), min(x0 + dx, 9), :3]
            # The table has sixteen entries a code: half an entry is what rounding may take.
            assert np.abs(srgb_from_linear(torch.from_numpy(image[y, x])).numpy() * 255 - value).max() < 0.04
            assert kind[y, x] == (2 if texture[int(t), int(s), 3] == 254 else 1)
    # Four times as many texels as pixels along each side: half way between the levels, as the determinant has it.
    half = np.array([[[3.0, 0, 0.2], [0, 2.0, 0.1], [0, 0.02, 1.0]]])
    shade_planes(triangle, np.zeros(1, np.int64), half, atlas, image, kind)
    mips = [texture.astype(float), texture.astype(float).reshape(4, 2, 5, 2, 4).mean((1, 3))]
    u, v = 1.5, 1.5
    w = 0.02 * v + 1
    s, t = (3 * u + 0.2) / w, (2 * v + 0.1) / w
    ds = np.array([[3 / w, -(3 * u + 0.2) * 0.02 / w**2], [0, 2 / w - (2 * v + 0.1) * 0.02 / w**2]])
    level = 0.5 * math.log2(abs(np.linalg.det(ds)))
    assert 1 < level < 2

    def at(picture: np.ndarray, s: float, t: float) -> np.ndarray:
        h, w = picture.shape[:2]
        a, b = min(max(s - 0.5, 0), w - 1), min(max(t - 0.5, 0), h - 1)
        x, y = int(a), int(b)
        x1, y1, a, b = min(x + 1, w - 1), min(y + 1, h - 1), a - x, b - y
        top = (1 - a) * picture[y, x] + a * picture[y, x1]
        return (1 - b) * top + b * ((1 - a) * picture[y1, x] + a * picture[y1, x1])

    mips.append(
        np.stack([cv2.resize(mips[1].astype(np.float32), (2, 2), interpolation=cv2.INTER_AREA)]).reshape(2, 2, 4)
    )
    value = sum(
        share * at(mips[n], s * mips[n].shape[1] / 10, t * mips[n].shape[0] / 8)
        for n, share in ((1, 2 - level), (2, level - 1))
    )
    assert np.abs(srgb_from_linear(torch.from_numpy(image[1, 1])).numpy() * 255 - value[:3]).max() < 0.6


def test_cells_join_as_points_do() -> None:
    rng = np.random.default_rng(5)
    position = rng.random((60, 3))
    side = 0.2
    cell = np.floor(position / side).astype(np.int64) + 2
    stride = np.array([1, 10, 100])
    order = np.argsort(cell @ stride, kind="stable")
    keys, starts = np.unique((cell @ stride)[order], return_index=True)
    offsets = np.mgrid[-2:3, -2:3, -2:3].reshape(3, -1).T
    offsets = np.ascontiguousarray(offsets[offsets @ stride > 0])
    bounds = np.append(starts, 60)
    for limit in (0.15**2, -1.0):
        parent = np.arange(len(keys))
        join_cells(keys, bounds, stride, offsets, position[order], limit, parent)
        expected = np.arange(len(keys))
        for a in range(len(keys)):
            for b in range(len(keys)):
                ca, cb = cell[order[starts[a]]], cell[order[starts[b]]]
                pa, pb = position[order[bounds[a] : bounds[a + 1]]], position[order[bounds[b] : bounds[b + 1]]]
                close = np.linalg.norm(pa[:, None] - pb[None], axis=2).min() <= 0.15 if limit >= 0 else True
                if np.abs(ca - cb).max() <= 2 and close:
                    expected[expected == expected[a]] = expected[b]

        def root(k: int, parent: np.ndarray = parent) -> int:
            while parent[k] != k:
                k = parent[k]
            return k

        roots = np.array([root(k) for k in range(len(keys))])
        assert np.array_equal(roots[:, None] == roots, expected[:, None] == expected)


def test_residuals_weighted_by_angle() -> None:
    rng = np.random.default_rng(6)
    eye = np.array([[0.0, 0, 0], [0.3, 0.1, 0]])
    pose = np.tile(np.eye(4)[:3], (2, 1, 1))
    pose[:, :, 3] = -eye
    data = Residuals(
        residual=rng.integers(-60, 60, (2, 6, 8, 3)).astype(np.int8),
        inverse_depth=np.full((2, 6, 8), 500, np.uint16),
        unit=np.full(2, 0.001),
        lens=np.tile([6.0, 6.0, 4.0, 3.0], (2, 1)),
        pose=pose,
        eye=eye,
    )
    data.inverse_depth[1, 2, 3] = 0
    size = 11
    depth = np.full((size, size), 2.0, np.float32)
    depth[0, 0] = np.inf
    depth[6:, 7:] = 2.3  # a step that nothing may be interpolated over
    depth[9, 1] = 2.1
    start = rng.random((size, size, 3)).astype(np.float32)
    image = start.copy()
    rays = np.array([[0.05, 0, -0.25], [0, 0.05, -0.25], [0, 0, 1.0]])
    looks = Looks(np.arange(2), np.array([1.0, 0.4]), rays, np.zeros(3), 0.03, 1e-3, 50.0)
    shape = ((size - 1) // STEP + 2,) * 2
    data.inverse_depth[1, 3:, 4:] = 435
    grid, inverse = np.full((*shape, 3), np.nan, np.float32), np.full(shape, np.nan, np.float32)
    add_residuals(data, looks, depth, grid, inverse, image)

    def looked_up(j: int, i: int) -> np.ndarray:
        d = rays @ [i + 0.5, j + 0.5, 1.0]
        world = float(depth[j, i]) * d
        total, change = 50.0, np.zeros(3)
        for k in range(2):
            q = world - eye[k]
            u, v = 6 * q[0] / q[2] + 4, 6 * q[1] / q[2] + 3
            if not (0 < u < 8 and 0 < v < 6):
                continue
            x, y = math.floor(u - 0.5), math.floor(v - 0.5)
            found, value = 0.0, np.zeros(3)
            for b in (0, 1):
                for a in (0, 1):
                    if not (0 <= x + a < 8 and 0 <= y + b < 6):
                        continue
                    code = data.inverse_depth[k, y + b, x + a]
                    if code and abs(code * 0.001 - 1 / q[2]) <= 0.03 / q[2]:
                        w = (u - 0.5 - x if a else 1 - (u - 0.5 - x)) * (v - 0.5 - y if b else 1 - (v - 0.5 - y))
                        found, value = found + w, value + w * data.residual[k, y + b, x + a]
            angle = max(1 - q @ d / np.linalg.norm(q) / np.linalg.norm(d), 0)
            share = looks.fade[k] * min(min(u, 8 - u, v, 6 - v) / 6, 1) / (1e-3 + angle) ** 2
            total, change = total + share * found, change + share * value
        return change / total / SCALE

    between = 0
    for j in range(size):
        for i in range(size):
            if not np.isfinite(depth[j, i]):
                assert np.array_equal(image[j, i], start[j, i])
                continue
            j0, i0 = j // STEP * STEP, i // STEP * STEP
            j1, i1 = min(j0 + STEP, size - 1), min(i0 + STEP, size - 1)
            fv, fu = (j - j0) / max(j1 - j0, 1), (i - i0) / max(i1 - i0, 1)
            around = [
                ((1 - fv) * (1 - fu), j0, i0),
                ((1 - fv) * fu, j0, i1),
                (fv * (1 - fu), j1, i0),
                (fv * fu, j1, i1),
            ]
            q = [1 / depth[a, b] for _, a, b in around]
            smooth = min(q) > 0 and abs(sum(w * x for (w, _, _), x in zip(around, q)) - 1 / depth[j, i]) < 0.005
            if smooth and max(q) - min(q) < 0.25 / depth[j, i]:
                change = sum(w * looked_up(a, b) for w, a, b in around)
                between += (j, i) not in {(a, b) for _, a, b in around}
            else:
                change = looked_up(j, i)
            root = np.clip(np.sqrt(start[j, i]) + change, 0, 1)
            assert np.allclose(image[j, i], root**2, atol=1e-5), (j, i)
    assert between > 30
