"""The kernels of reflection reuse against slow, obvious loops."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from reuse_scenes import mirror_key
from torchrender.kernels.reflections.match import (
    BORDER,
    RATIO,
    SILHOUETTE,
    STEPS,
    VALID,
    KeyPixels,
    Matches,
    Query,
    Settings,
    match,
    residual,
    scaled,
)
from torchrender.kernels.reflections.shift import SURE, UNCOVERED, UNSURE, draw_moved, resolve_moved
from torchrender.kernels.warp.corners import DIAGONAL, FIRST, SECOND


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def one_pixel(position: np.ndarray, normal: np.ndarray, footprint: float = 1e-9) -> np.ndarray:
    return np.concatenate([position, normal, [footprint, 1.0]])[None]


def distance_to_virtual_ray(point: np.ndarray, position: np.ndarray, normal: np.ndarray, eye: np.ndarray) -> float:
    """Section 5 as it is printed: from the eye to the ray that leaves the virtual point M through the candidate."""
    virtual = point - 2 * ((point - position) @ normal) * normal
    u = unit(position - virtual)
    return float(np.linalg.norm((eye - virtual) - ((eye - virtual) @ u) * u))


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_both_forms_of_the_distance_agree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = unit(rng.normal(size=3))
    position, point, eye = rng.uniform(-3, 3, (3, 3))
    for name in (point, eye):  # both in front of the tangent plane
        name += (abs((name - position) @ normal) - (name - position) @ normal + 0.1) * normal
    a, b, c, state = residual(one_pixel(position, normal), np.uintp(0), tuple(point), False, eye)
    assert state == 0
    printed = distance_to_virtual_ray(point, position, normal, eye)
    assert np.sqrt(a * a + b * b + c * c) == pytest.approx(printed, rel=1e-9, abs=1e-12)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["plane", "sphere"]))
@settings(max_examples=40, deadline=None)
def test_the_distance_vanishes_at_the_exact_reflection_point(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    eye = np.array([rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(2, 4)])
    if kind == "plane":
        point = np.array([*rng.uniform(-3, 3, 2), rng.uniform(0.5, 5)])
        virtual = point * (1, 1, -1)
        position = virtual + (eye - virtual) * (-virtual[2] / (eye[2] - virtual[2]))
        normal = np.array([0.0, 0.0, 1.0])
    else:
        normal = unit(np.array([*rng.uniform(-0.4, 0.4, 2), 1.0]))
        position = normal * 1.0  # a unit sphere about the origin
        view = unit(position - eye)
        point = position + rng.uniform(0.5, 5) * (view - 2 * (view @ normal) * normal)
    incoming, outgoing = unit(position - point), unit(eye - position)
    assert incoming @ normal == pytest.approx(-(outgoing @ normal), abs=1e-12)  # the law of reflection
    a, b, c, state = residual(one_pixel(position, normal), np.uintp(0), tuple(point), False, eye)
    assert state == 0
    assert np.sqrt(a * a + b * b + c * c) < 1e-9 * 10


@given(st.integers(0, 2**32 - 1), st.booleans())
@settings(max_examples=40, deadline=None)
def test_the_scaled_residual_is_how_far_the_mirror_is_off(seed: int, endless: bool) -> None:
    """Beside the exact reflection point of a plane: of a move on the mirror, what is at right angles to the ray."""
    rng = np.random.default_rng(seed)
    eye = np.array([*rng.uniform(-1, 1, 2), rng.uniform(0.5, 4)])
    point = np.array([*rng.uniform(-3, 3, 2), rng.uniform(0.5, 5)])
    virtual = point * (1, 1, -1)
    ray = unit(virtual if endless else virtual - eye)
    exact = eye - ray * (eye[2] / ray[2])
    move = np.array([*rng.normal(0, 1e-5, 2), 0.0])
    surface = one_pixel(exact + move, np.array([0.0, 0.0, 1.0]))
    query = Query(7, tuple(unit(point) if endless else point), endless, eye)
    *found, known = scaled(KeyPixels(surface, np.array([7], np.int32), np.zeros((1, 4)), 1, 1), np.uintp(0), query)
    across = move - (move @ ray) * ray
    assert known
    np.testing.assert_allclose(found, -across, atol=1e-3 * np.linalg.norm(move))


def arrays(key, ids=None):
    size = tuple(key.reflector.shape[1:])
    surface = key.surface[0].reshape(-1, 8).numpy().copy()
    own = key.reflector[0].reshape(-1).numpy().copy() if ids is None else ids.reshape(-1).astype(np.int32)
    return surface, own, key.reached[0].reshape(-1, 4).numpy().copy(), size


def run_match(key, eye, *, ids=None, max_steps=128, ratio=0.75, leaping=False, refined=False, start=None):
    surface, own, reached, size = arrays(key, ids)
    pixels = np.flatnonzero(own >= 0)
    n = len(pixels)
    out = np.zeros((n, 2), np.int32), np.zeros((n, 2), np.float32), np.zeros(n, np.uint8), np.zeros(n, np.int32)
    begin = np.zeros((n, 2), np.int32) if start is None else start
    match(
        KeyPixels(surface, own, reached, *size),
        pixels,
        eye,
        begin,
        Settings(max_steps, ratio, leaping, refined),
        Matches(*out),
    )
    return pixels, out


def slow_match(key, eye, pixel, ids=None, max_steps=128, ratio=0.75):
    """End, cause and steps of one pixel by the text of section 5."""
    surface, own, reached, (height, width) = arrays(key, ids)

    def d(y, x):
        if not (0 <= y < height and 0 <= x < width) or own[y * width + x] != own[pixel]:
            return np.inf
        w, n = surface[y * width + x, :3].astype(float), surface[y * width + x, 3:6].astype(float)
        r = reached[pixel].astype(float)
        toward = r[:3] - w if r[3] else r[:3]
        if r[3] and np.linalg.norm(toward) < 0.5 * surface[y * width + x, 6] and (eye - w) @ n > 0:
            return 0.0
        if toward @ n <= 0 or (eye - w) @ n <= 0:
            return np.inf
        back = -unit(toward)
        u = back - 2 * (back @ n) * n
        return np.linalg.norm((eye - w) - ((eye - w) @ u) * u)

    y0, x0 = divmod(int(pixel), width)
    y, x, best, steps = y0, x0, d(y0, x0), 0
    around = [(j, i) for j, i in itertools.product((-1, 0, 1), repeat=2) if j or i]
    while True:
        values = [d(y + j, x + i) for j, i in around]
        k = int(np.argmin(values))
        if values[k] >= best:
            break
        if steps == max_steps:
            return (y - y0, x - x0), STEPS, steps
        y, x, best = y + around[k][0], x + around[k][1], values[k]
        steps += 1
    feasible = [v for v in values if v < np.inf]
    if best == 0 or (best < np.inf and len(feasible) >= 3 and (ratio >= 1 or best <= ratio * np.mean(feasible))):
        return (y - y0, x - x0), VALID, steps
    if y in (0, height - 1) or x in (0, width - 1):
        return (y - y0, x - x0), BORDER, steps
    rim = any(own[(y + j) * width + x + i] != own[pixel] for j, i in around)
    return (y - y0, x - x0), SILHOUETTE if rim else RATIO, steps


@pytest.mark.parametrize("kind", ["plane", "convex", "concave"])
@pytest.mark.parametrize("endless", [False, True])
def test_search_against_a_loop(kind: str, endless: bool) -> None:
    key = mirror_key(kind, [0.3, 0.2, 3.0], 20, endless=endless, rho=2.0)
    eye = np.array([0.9, -0.6, 0.1])
    ids = key.reflector[0].numpy().copy()
    ids[:, 12:] = np.where(ids[:, 12:] >= 0, 5, -1)  # two reflectors side by side
    for max_steps in (2, 128):
        pixels, (end, _, cause, steps) = run_match(key, eye, ids=ids, max_steps=max_steps)
        assert len(pixels) > 100
        for k, pixel in enumerate(pixels):
            wanted_end, wanted_cause, wanted_steps = slow_match(key, eye, pixel, ids, max_steps)
            assert (tuple(end[k]), cause[k], steps[k]) == (wanted_end, wanted_cause, wanted_steps)
    assert VALID in cause and len(set(cause.tolist())) > 1


@pytest.mark.parametrize("leaping", [False, True])
def test_a_start_on_another_reflector_or_outside_is_none(leaping: bool) -> None:
    """What an earlier picture left may point anywhere: the search then begins where it would without."""
    key = mirror_key("convex", [0.3, 0.2, 3.0], 24, rho=2.0)
    ids = key.reflector[0].numpy().copy()
    ids[:, 14:] = np.where(ids[:, 14:] >= 0, 5, -1)
    eye = np.array([0.5, -0.3, 0.1])
    pixels, usual = run_match(key, eye, ids=ids, leaping=leaping, refined=True)
    row, column = np.divmod(pixels, 24)
    far = np.argwhere(ids == 5)[20], np.argwhere((ids >= 0) & (ids != 5))[20]
    aside = np.where((ids.reshape(-1)[pixels] == 5)[:, None], far[1], far[0]) - np.stack([row, column], axis=-1)
    for start in (aside, np.full_like(aside, 100), np.full_like(aside, -100)):
        _, found = run_match(key, eye, ids=ids, leaping=leaping, refined=True, start=start.astype(np.int32))
        for a, b in zip(found, usual, strict=True):
            np.testing.assert_array_equal(a, b)
    assert len(pixels) > 100


@pytest.mark.parametrize("kind", ["plane", "convex"])
def test_leaps_find_what_the_walk_finds(kind: str) -> None:
    key = mirror_key(kind, [0.3, 0.2, 3.0], 64, rho=2.0)
    eye = np.array([0.2, -0.1, 0.1])
    _, (end, offset, cause, _) = run_match(key, eye, leaping=True, refined=True)
    _, (walked, refined, causes, _) = run_match(key, eye, refined=True)
    both = (cause == VALID) & (causes == VALID)
    assert both.mean() > 0.5
    assert (cause == causes).mean() > 0.98
    assert (np.abs(end - walked).max(axis=1) <= 1)[both].all()
    assert np.abs(offset - refined)[both].max() < 0.05


def grid(rng: np.random.Generator, size: int, spread: float):
    y, x = np.mgrid[0:size, 0:size] + 0.5
    place = np.stack([x, y], -1) + rng.normal(0, spread, (size, size, 2))
    place[rng.random((size, size)) < 0.05] = np.nan
    shape = rng.choice([0, FIRST, SECOND, FIRST | SECOND, FIRST | SECOND | DIAGONAL], (size - 1, size - 1))
    ids = np.where(np.arange(size)[None] < size // 2, 1, 2).repeat(size, 0).astype(np.int32)
    shape[:, size // 2 - 1] = 0  # triangles do not span reflectors
    breaks = rng.choice([0, 0, 0, 1, 2, 4, 8], (size, size)).astype(np.uint8)
    return (
        place.astype(np.float32),
        rng.uniform(1, 3, (size, size)).astype(np.float32),
        shape.astype(np.uint8),
        ids,
        breaks,
    )


def slow_moved(place, depth, shape, ids, breaks, largest):
    """Source and certainty of every pixel, triangle by triangle."""
    size = len(ids)
    source, certainty = np.full((size, size, 2), np.nan), np.zeros((size, size), int)
    nearest = np.zeros((size, size), np.float32)
    for j, i in itertools.product(range(size - 1), repeat=2):
        flipped = shape[j, i] & DIAGONAL
        rows = [[(j, i), (j + 1, i), (j + 1, i + 1)], [(j + 1, i + 1), (j, i + 1), (j, i)]]
        if flipped:
            rows = [[(j + 1, i), (j + 1, i + 1), (j, i + 1)], [(j, i + 1), (j, i), (j + 1, i)]]
        for bit, corner in zip((FIRST, SECOND), rows, strict=True):
            points = np.array([place[c] for c in corner], float)
            if not shape[j, i] & bit or np.isnan(points).any():
                continue
            matrix = np.vstack([points.T, np.ones(3)])
            area = (points[1][1] - points[0][1]) * (points[2][0] - points[0][0]) - (points[1][0] - points[0][0]) * (
                points[2][1] - points[0][1]
            )
            if area == 0:
                continue
            links = 0
            for a, b in ((corner[0], corner[1]), (corner[1], corner[2])):
                first = min(a, b)
                step = 1 if a[0] == b[0] else 2
                links |= 1 if breaks[first] & step else (4 if breaks[first] & (4 * step) else 0)
            good = 0 < area <= largest and (links == 0 or (not links & 1 and area <= 1.5))
            for y, x in itertools.product(range(size), repeat=2):
                weights = np.linalg.solve(matrix, np.array([x + 0.5, y + 0.5, 1.0]))
                if ids[y, x] != ids[corner[0]] or (weights * abs(area) < -1e-6).any():
                    continue
                near = np.float32(weights @ np.array([1 / float(depth[c]) for c in corner]))
                if near > nearest[y, x]:
                    nearest[y, x] = near
                    source[y, x] = weights @ np.array([(c[1] + 0.5, c[0] + 0.5) for c in corner])
                    certainty[y, x] = SURE if good else UNSURE
    return source, certainty


@pytest.mark.parametrize(("seed", "spread"), [(0, 0.0), (1, 0.4), (2, 2.0)])
def test_moved_triangles_against_a_loop(seed: int, spread: float) -> None:
    size = 9
    place, depth, shape, ids, breaks = grid(np.random.default_rng(seed), size, spread)
    keys = np.zeros(size * size, np.uint64)
    draw_moved(place, depth, shape, ids, ids, keys)
    source, certainty = np.full((size, size, 2), np.nan, np.float32), np.zeros((size, size), np.uint8)
    resolve_moved(keys, place, shape, breaks, 4.0, ids, source, certainty)
    wanted, sure = slow_moved(place, depth, shape, ids, breaks, 4.0)
    assert set(np.unique(certainty)) == {UNCOVERED, UNSURE, SURE}
    if spread:  # without, all pixels lie on several triangles, and rounding decides which is nearest
        assert (certainty == sure).all()
    known = certainty != UNCOVERED
    assert ((sure != UNCOVERED) == known).all()
    assert np.abs(source[known] - wanted[known]).max() < 1e-3
    if not spread:
        assert np.allclose(source[known], (np.argwhere(known)[:, ::-1] + 0.5), atol=1e-5)


@pytest.mark.parametrize(("growth", "wanted"), [(15.0, SURE), (17.0, UNSURE), (-1.0, UNSURE)])
def test_a_triangle_may_grow_sixteenfold(growth: float, wanted: int) -> None:
    side = abs(growth) ** 0.5
    corner = np.array([[[0.5, 0.5], [0.5 + side, 0.5]], [[0.5, 0.5 + side], [0.5 + side, 0.5 + side]]], np.float32)
    if growth < 0:
        corner[..., 0] = 1.0 - corner[..., 0]
        corner[..., 0] += 0.5
    place = np.full((6, 6, 2), np.nan, np.float32)
    place[:2, :2] = corner
    shape, ids = np.zeros((5, 5), np.uint8), np.zeros((6, 6), np.int32)
    shape[0, 0] = FIRST | SECOND
    keys, ones = np.zeros(36, np.uint64), np.ones((6, 6), np.float32)
    draw_moved(place, ones, shape, ids, ids, keys)
    source, certainty = np.full((6, 6, 2), np.nan, np.float32), np.zeros((6, 6), np.uint8)
    resolve_moved(keys, place, shape, np.zeros((6, 6), np.uint8), 16.0, ids, source, certainty)
    assert certainty[0, 0] == wanted
    assert set(np.unique(certainty)) == {UNCOVERED, wanted}
    assert np.isnan(source[certainty == UNCOVERED]).all()


def test_of_two_reflections_on_one_spot_the_nearer_is_seen() -> None:
    ids = np.zeros((2, 5), np.int32)
    shape = np.array([[FIRST | SECOND, 0, 0, FIRST | SECOND]], np.uint8)
    y, x = np.mgrid[0:2, 0:5] + 0.5
    place = np.stack([np.where(x > 2.5, x - 3.0, x), y], -1).astype(
        np.float32
    )  # the right quad moves over the left one
    for near_right in (False, True):
        depth = np.where((x > 2.5) == near_right, 1.0, 2.0).astype(np.float32)
        keys = np.zeros(10, np.uint64)
        draw_moved(place, depth, shape, ids, ids, keys)
        source, certainty = np.full((2, 5, 2), np.nan, np.float32), np.zeros((2, 5), np.uint8)
        resolve_moved(keys, place, shape, np.zeros((2, 5), np.uint8), 16.0, ids, source, certainty)
        assert (certainty[:, :2] == SURE).all()
        assert np.allclose(source[:, :2, 0], (x + (3.0 if near_right else 0.0))[:, :2], atol=1e-5)
    assert torch.from_numpy(certainty[:, 2:]).eq(UNCOVERED).all()
