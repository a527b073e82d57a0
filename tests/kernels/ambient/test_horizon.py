"""The search along slices beside a slow twin that follows the definition, angle by angle."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from torchrender.effects.ambient.horizon import _tables
from torchrender.effects.ambient.visibility import WHOLE
from torchrender.kernels.ambient.horizon import (
    PATTERN,
    SECTORS,
    Points,
    Search,
    Surroundings,
    between,
    cube_place,
    cube_point,
    end_of_plane,
    measure_points,
    sector,
    spread_steps,
)

FAR = np.float32(np.inf)


def place_of(angle: float) -> float:
    c, s = math.cos(angle), math.sin(angle)
    return (1 - c / (abs(c) + s)) * SECTORS / 2


@pytest.mark.parametrize("angle", np.linspace(0.0, math.pi, 9))
def test_sectors_go_from_the_eye_to_away_from_it(angle: float) -> None:
    found = sector(np.float32(3 * math.cos(angle)), np.float32(3 * math.sin(angle)))
    assert found == pytest.approx(place_of(angle), abs=1e-4)


def test_bits_are_the_sectors_whose_middles_are_covered() -> None:
    for low, high in ((0.0, 32.0), (2.4, 5.6), (2.6, 3.4), (5.0, 4.0), (-3.0, 40.0), (31.2, 33.0)):
        wanted = sum(1 << k for k in range(SECTORS) if low <= k + 0.5 < high)
        assert int(between(np.float32(low), np.float32(high))) == wanted, (low, high)


def test_a_direction_finds_its_face() -> None:
    axes = ((1, 2), (2, 1), (2, 0), (0, 2), (0, 1), (1, 0))
    rng = np.random.default_rng(2)
    for d in rng.normal(size=(200, 3)).astype(np.float32):
        axis = int(np.abs(d).argmax())
        face = 2 * axis + (0 if d[axis] > 0 else 1)
        u, v = (d[k] / abs(d[axis]) for k in axes[face])
        found = cube_place(*d, 16)
        assert tuple(found[:3]) == (face, int((v + 1) * 8), int((u + 1) * 8))
        assert found[3] == abs(d[axis])
        # The pixel's centre sees about the same direction.
        centre = np.array(cube_point(*found[:3], 16, found[3]))
        assert np.abs(centre - d).max() <= abs(d[axis]) / 16 + 1e-5


def test_a_plane_goes_on_to_the_middle_of_a_step() -> None:
    """On the plane x = 2 beside an eye at the origin; the point looks back from distance 5."""
    angles = [0.5, 0.6, 0.8]
    r = [np.float32(2.0 / math.sin(a)) for a in angles]
    middle = 0.7
    x, y = 5 - 2 / math.tan(middle), 2.0
    place, apart = end_of_plane(
        np.float32(5.0),
        (r[0], np.float32(angles[0])),
        (r[1], np.float32(angles[1])),
        np.float32(angles[2]),
    )
    assert place == pytest.approx(place_of(math.atan2(y, x)), abs=0.01)
    assert apart == pytest.approx(x * x + y * y, rel=1e-3)


def test_steps_ascend_from_the_point_to_once_around() -> None:
    steps = np.zeros((12, 3), np.float32)
    spread_steps(((np.arange(12) + 0.5) / 6).astype(np.float32), np.float32(0.01), np.float32(0.4), steps)
    assert (np.diff(steps[:, 0]) > 0).all() and steps[0, 0] >= 0.01 and steps[-1, 0] < math.pi
    np.testing.assert_allclose(steps[:, 1:], np.stack([np.cos(steps[:, 0]), np.sin(steps[:, 0])], -1), atol=1e-6)


def unit_of(v: object) -> np.ndarray:
    v = np.asarray(v, float)
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def around_the_eye(depth_of: Callable[[np.ndarray], np.ndarray]) -> Surroundings:
    """What an eye sees on the faces of a cube: ``depth_of`` directions (S,S,3) whose largest component is 1."""
    size = 256
    grid = (np.arange(size) + 0.5) / size * 2 - 1
    v, u = np.meshgrid(grid, grid, indexing="ij")
    axes = ((1, 2), (2, 1), (2, 0), (0, 2), (0, 1), (1, 0))
    front = np.full((6, size, size), FAR, np.float32)
    for face in range(6):
        d = np.zeros((size, size, 3))
        d[..., axes[face][0]], d[..., axes[face][1]] = u, v
        d[..., face // 2] = 1 - 2 * (face % 2)
        front[face] = depth_of(d)
    none = np.full((1, 1), FAR, np.float32)
    lens = np.array([1.0, 1.0, -50.0, -50.0], np.float32)
    return Surroundings(none, none, lens, front, np.full_like(front, FAR))


def seen_disc(cosine: float) -> Surroundings:
    """An eye that sees nothing but a sphere of radius 1 about itself where the direction's z is above ``cosine``."""
    return around_the_eye(lambda d: np.where(unit_of(d)[..., 2] >= cosine, 1.0 / np.linalg.norm(d, axis=-1), np.inf))


@pytest.mark.parametrize("edge", [0.6, 1.2, 2.2])
def test_a_point_in_a_round_bowl_sees_through_its_opening(edge: float) -> None:
    """The point is the bowl's deepest one: the rim lies at half the supplement of its angle, so that the cosine law
    gives sin^2 of that."""
    points = Points(
        np.array([[0, 0, 1]] * PATTERN, np.float32),
        np.ones(PATTERN, np.float32),
        np.array([[0, 0, -1]] * PATTERN, np.float32),
        np.arange(PATTERN),
    )
    share = (np.arange(96)[None] + (np.arange(PATTERN)[:, None] + 0.5) / PATTERN) / 48
    search = Search(2, share.astype(np.float32), 0.005, 1.0, 10.0, 0.15)
    found = np.zeros((PATTERN, 5), np.float32)
    measure_points(seen_disc(math.cos(edge)), points, _tables(), search, found)
    rim = (math.pi - edge) / 2
    assert found[:, 0].mean() == pytest.approx(math.sin(rim) ** 2, abs=0.04)
    direction = found[:, 2:].mean(axis=0) + WHOLE * found[:, 0].mean() * np.array([0, 0, -1])
    assert direction[2] < 0 and np.abs(direction[:2]).max() < 0.02 * abs(direction[2])


def seen_plane(normal: np.ndarray) -> Surroundings:
    """An eye that sees nothing but the plane ``normal . x = -1``."""
    return around_the_eye(lambda d: np.where(d @ normal < 0.0, -1.0 / np.minimum(d @ normal, -1e-6), np.inf))


@pytest.mark.parametrize("tilt", [0.0, 0.005])
def test_a_plane_hides_nothing_from_its_own_points(tilt: float) -> None:
    """Nor where its normals are as little off as those of pictures are."""
    normal = unit_of([0.2, -0.3, -1.0])
    rng = np.random.default_rng(3)
    direction = unit_of(np.array([0.0, 0.0, 1.0]) + rng.uniform(-0.6, 0.6, (64, 3)) * (1.0, 1.0, 0.0))
    off = np.cross(normal, unit_of(rng.normal(size=(64, 3))))
    points = Points(
        direction.astype(np.float32),
        (-1.0 / (direction @ normal)).astype(np.float32),
        unit_of(normal + tilt * unit_of(off)).astype(np.float32),
        np.arange(64) % PATTERN,
    )
    share = (np.arange(24)[None] + (np.arange(PATTERN)[:, None] + 0.5) / PATTERN) / 12
    search = Search(4, share.astype(np.float32), 0.005, 1.0, 10.0, 0.15)
    found = np.zeros((64, 5), np.float32)
    measure_points(seen_plane(normal), points, _tables(), search, found)
    np.testing.assert_allclose(found[:, :2], 1.0, atol=1e-6)
    np.testing.assert_allclose(found[:, 2:], 0.0, atol=1e-6)  # light comes from around the normal, however few slices


@pytest.mark.parametrize("edges", [(0.0,), (0.9, 0.3), (0.8, 0.5, 0.2, -0.2, -0.5)])
def test_a_point_that_is_shut_in_sees_no_sky(edges: tuple[float, ...]) -> None:
    """Thin walls all around, rings of them far behind others: what no step saw between them is as closed."""
    ones = np.ones(PATTERN, np.float32)
    axis = np.array([[0, 0, 1]] * PATTERN, np.float32)
    points = Points(axis, ones, -axis, np.arange(PATTERN))
    share = (np.arange(48)[None] + (np.arange(PATTERN)[:, None] + 0.5) / PATTERN) / 24
    search = Search(2, share.astype(np.float32), 0.005, 1.0, 1.0, 0.15)

    def walls(d: np.ndarray) -> np.ndarray:
        ring = sum((unit_of(d)[..., 2] < edge).astype(int) for edge in edges)
        return np.where(ring % 2 == 0, 1.0, 6.0) / np.linalg.norm(d, axis=-1)

    around = around_the_eye(walls)
    found = np.zeros((PATTERN, 5), np.float32)
    around = around._replace(cube_back=around.cube_front * np.float32(1.01))
    measure_points(around, points, _tables(), search, found)
    assert found[:, 0].max() < 0.03
