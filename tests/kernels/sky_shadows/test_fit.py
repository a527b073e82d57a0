"""Loops of the fit of spheres beside slow twins."""

from __future__ import annotations

import math

import numpy as np
import pytest

from torchrender.kernels.sky_shadows.fit import flood, outside_volume, refit, solid_of, volumes_within

RNG = np.random.default_rng(0)
FILLED = (RNG.random((7, 6, 9)) < 0.5).astype(np.uint8)
SOLID = solid_of(FILLED, np.array([-1.0, 0.5, 2.0]), 0.25)
CELLS = SOLID.origin + (np.argwhere(FILLED)[:, ::-1] + 0.5) * SOLID.cell


def twin_outside(centre: np.ndarray, radius: float) -> float:
    inside = 0.0
    for cell in CELLS:
        inside += min(max(0.5 - (np.linalg.norm(cell - centre) - radius) / SOLID.cell, 0.0), 1.0)
    return 4 / 3 * math.pi * radius**3 - SOLID.cell**3 * inside


@pytest.mark.parametrize("radius", [0.0, 0.1, 0.6, 5.0])
def test_volume_outside(radius: float) -> None:
    for centre in (np.array([0.1, 1.2, 2.7]), SOLID.origin, SOLID.origin - 3):
        assert outside_volume(SOLID, *centre, radius) == pytest.approx(twin_outside(centre, radius), abs=1e-9)


def test_volumes_by_distance() -> None:
    centres = np.array([[0.0, 1.0, 3.0], [1.0, 1.0, 2.0]])
    table = np.empty((2, 40))
    volumes_within(SOLID, centres, 0.1, table)
    for c in range(2):
        distance = np.linalg.norm(CELLS - centres[c], axis=1)
        wanted = [(distance <= 0.1 * n + 1e-12).sum() * SOLID.cell**3 for n in range(39)]
        np.testing.assert_allclose(table[c, :39], wanted, atol=1.1 * SOLID.cell**3)
        assert table[c, 39] == pytest.approx(len(CELLS) * SOLID.cell**3)


def test_refit_never_sticks_out_more() -> None:
    points = RNG.random((30, 3)) + SOLID.origin
    place = points[0].copy()
    before = twin_outside(place, float(np.linalg.norm(points - place, axis=1).max()))
    after = refit(SOLID, points, place, 8)
    assert after < before
    assert after == pytest.approx(twin_outside(place, float(np.linalg.norm(points - place, axis=1).max())), abs=1e-9)


def test_flood_gives_every_point_a_sphere_that_reaches_it() -> None:
    points = RNG.random((200, 3)) + SOLID.origin
    points[150:] += 10.0  # apart: the flood starts again there
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    neighbours = np.argsort(distance, axis=1)[:, :8].copy()
    centres = np.ascontiguousarray(points[[0, 60, 160]])
    table = np.empty((3, 400))
    volumes_within(SOLID, centres, 0.1, table)
    radii, labels = np.zeros(3), np.empty(200, np.int64)
    flood(points, neighbours, centres, (table, 0.1), radii, labels)
    assert set(labels) <= {0, 1, 2}
    away = np.linalg.norm(points - centres[labels], axis=1)
    assert (away <= radii[labels] + 1e-12).all()
    for k in set(labels.tolist()):
        assert radii[k] == pytest.approx(away[labels == k].max())
