"""What pixels mirror out of a key frame, pixel by pixel, on a plane mirror whose reflections have not moved."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.kernels.reflections.gather import (
    BROKEN,
    CONTRAST,
    FOUND,
    OFF_RAY,
    OTHER_SURFACE,
    OUTSIDE,
    UNRELIABLE,
    correction,
    gather,
    mix,
    off_ray,
)
from torchrender.kernels.reflections.gather import Ray as OffRay
from torchrender.kernels.reflections.records import Gathered, KeyFrame, KeyView, Limits, Pixels
from torchrender.kernels.reflections.shift import RIGHT, SURE, UNSURE

WIDTH, HEIGHT, FOCAL = 12, 9, 10.0


def key_frame(rng: np.random.Generator) -> tuple[KeyFrame, np.ndarray]:
    """A mirror at depth 2 that shows points at depth 7; source positions are the pixels' own."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    ray = np.stack([(x - 6) / FOCAL, (y - 4.5) / FOCAL, np.ones_like(x)], -1)
    surface = np.zeros((HEIGHT, WIDTH, 8), np.float32)
    surface[..., :3], surface[..., 5], surface[..., 7] = 2 * ray, -1, 2
    reached = np.ones((HEIGHT, WIDTH, 4), np.float32)
    reached[..., :3] = 7 * ray
    colors = rng.random((HEIGHT, WIDTH, 3)).astype(np.float32)
    ids = np.ones((HEIGHT, WIDTH), np.int32)
    span = np.linalg.norm(5 * ray, axis=-1).astype(np.float32)
    source = np.stack([x, y], -1).astype(np.float32)
    sure = np.full((HEIGHT, WIDTH), SURE, np.uint8)
    return KeyFrame(surface, ids, reached, span, colors, np.zeros_like(sure), source, sure), ray


def look(frame: KeyFrame, place: np.ndarray, limits: Limits, direction: np.ndarray | None = None, weight: float = 1.0):
    """Rays through the mirror at key positions (N,2), and what is found for them."""
    n = len(place)
    through = np.column_stack([(place - [6, 4.5]) / FOCAL, np.ones(n)])
    away = through / np.linalg.norm(through, axis=1, keepdims=True) if direction is None else direction
    out = Gathered(np.zeros((n, 3), np.float32), np.zeros(n, np.float32), np.zeros((n, 2), np.float32),
                   np.zeros(n, np.uint8))  # fmt: skip
    matrix = np.array([[FOCAL, 0, 6], [0, FOCAL, 4.5], [0, 0, 1.0]])
    pixels = Pixels(np.zeros((0, 2)), np.ones(n, np.int32), np.full(n, 0.1), np.full(n, weight, np.float32),
                    2 * through + [0.5, 0, 0], away)  # fmt: skip
    gather(pixels, KeyView(np.array([0.5, 0, 0]), matrix, 0.1), frame, limits, out)
    return out


def bilinear(values: np.ndarray, place: np.ndarray) -> np.ndarray:
    x, y = place - 0.5
    i, j = int(np.floor(x)), int(np.floor(y))
    a, b = x - i, y - j
    top = (1 - a) * values[j, i] + a * values[j, i + 1]
    return (1 - b) * top + b * ((1 - a) * values[j + 1, i] + a * values[j + 1, i + 1])


@pytest.mark.parametrize("largest", [0.0, 4.0])
def test_colours_are_bilinear_and_distances_those_along_the_ray(largest: float) -> None:
    rng = np.random.default_rng(0)
    frame, ray = key_frame(rng)
    place = rng.uniform([0.6, 0.6], [WIDTH - 0.6, HEIGHT - 0.6], (60, 2))
    out = look(frame, place, Limits(largest, 9.0))
    assert (out.state == FOUND).all()
    # Without a correction, taps of almost no weight are left out of the interpolated position.
    near = 1e-4 if largest else 1e-2
    np.testing.assert_allclose(out.source, place, atol=near)
    for k in range(60):
        np.testing.assert_allclose(out.color[k], bilinear(frame.colors, place[k]), atol=2 * near)
        assert out.distance[k] == pytest.approx(np.linalg.norm(5 * bilinear(ray, place[k])), rel=near)


def test_the_correction_finds_the_point_on_the_ray() -> None:
    """Rays towards another place than the picture says: corrected to that place, or given up beyond the limit."""
    rng = np.random.default_rng(1)
    frame, _ = key_frame(rng)
    place, shift = np.full((20, 2), [5.2, 4.1]), rng.uniform(-1.5, 1.5, (20, 2))
    target = np.column_stack([7 * (place + shift - [6, 4.5]) / FOCAL, np.full(20, 7.0)])
    start = 2 * np.column_stack([(place - [6, 4.5]) / FOCAL, np.ones(20)])
    direction = (target - start) / np.linalg.norm(target - start, axis=1, keepdims=True)
    for largest in (1.0, 4.0):
        out = look(frame, place, Limits(largest, 9.0), direction)
        kept = np.abs(shift).max(axis=1) <= largest
        np.testing.assert_array_equal(out.state, np.where(kept, FOUND, OFF_RAY))
        np.testing.assert_allclose(out.source[kept], (place + shift)[kept], atol=1e-3)
    assert not kept.all() or largest == 4.0


def test_every_cause() -> None:
    rng = np.random.default_rng(2)
    frame, _ = key_frame(rng)
    inside = np.array([[5.2, 4.1]])
    none = Limits(0.0, 9.0)

    def state(changed: KeyFrame, place: np.ndarray = inside, limits: Limits = none, weight: float = 1.0) -> int:
        return int(look(changed, place, limits, weight=weight).state[0])

    assert state(frame) == FOUND and state(frame, np.array([[-0.1, 4.0]])) == OUTSIDE
    assert state(frame, np.array([[WIDTH + 0.1, 4.0]])) == OUTSIDE
    ids, deep, sure, breaks = (a.copy() for a in (frame.ids, frame.surface, frame.certainty, frame.breaks))
    ids[4, 5], deep[4, 5, 7], sure[4, 5], breaks[3, 4] = 2, 2.2, UNSURE, RIGHT
    assert state(frame._replace(ids=ids)) == OTHER_SURFACE and state(frame._replace(surface=deep)) == OTHER_SURFACE
    assert state(frame._replace(certainty=sure)) == UNRELIABLE and state(frame._replace(breaks=breaks)) == BROKEN
    flat = frame.colors.copy()
    flat[:] = 0.25
    flat[4, 4] = 0.75
    plain = frame._replace(colors=flat)
    assert state(plain, limits=Limits(0.0, 0.45)) == CONTRAST and state(plain, limits=Limits(0.0, 0.55)) == FOUND
    assert state(plain, limits=Limits(0.0, 0.45), weight=0.8) == FOUND
    sky = frame.reached.copy()
    sky[3:5, 4:6, 3] = 0
    assert look(frame._replace(reached=sky), inside, none).distance[0] == np.inf
    sky[3, 4, 3] = 1  # points and directions do not mix
    assert state(frame._replace(reached=sky)) == BROKEN


def test_the_gauss_newton_step_against_finite_differences() -> None:
    rng = np.random.default_rng(3)
    corner, start, ray = rng.normal(size=(4, 8)), rng.normal(size=3), np.array([0.0, 0.6, 0.8])
    corner[:, 3] = 1.0
    across = np.array([[1.0, 0, 0], [0, 0.8, -0.6]])
    one = OffRay(tuple(start), tuple(ray), across)

    def miss(a: float, b: float) -> np.ndarray:
        point = np.array([mix(corner, c, a, b) for c in range(3)]) - start
        return across @ point

    a, b, h = 0.3, 0.6, 1e-6
    np.testing.assert_allclose(off_ray(corner, a, b, one)[:2], miss(a, b), atol=1e-12)
    jacobian = np.stack([(miss(a + h, b) - miss(a - h, b)) / (2 * h), (miss(a, b + h) - miss(a, b - h)) / (2 * h)], 1)
    wanted = -np.linalg.solve(jacobian, miss(a, b))
    found = correction(corner, a, b, *miss(a, b), across)
    assert found[2]
    np.testing.assert_allclose(found[:2], wanted, rtol=1e-6)
