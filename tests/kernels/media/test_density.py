"""Densities, their integrals and the functions beneath against plain loops in float64."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import density_at, way_through
from torchrender.kernels.media.functions import arctan2, exponential, tangent
from torchrender.kernels.media.nodes import phase
from torchrender.kernels.media.records import SUN, Beams
from torchrender.kernels.media.ways import clip_rays, light_means, ways_through
from torchrender.scene.medium import Medium

GRID = torch.from_numpy(np.random.default_rng(3).random((5, 4, 6)).astype(np.float32))
KINDS = {
    "flat": {"density": 1.7},
    "height": {"density": 2.0, "falloff": 1.3},
    "grid": {"density": GRID},
}


def table(**changes: object) -> MediaTable:
    low, high = torch.tensor([-1.0, -2.0, -1.5]), torch.tensor([2.0, 1.0, 1.0])
    return MediaTable.of([Medium(low=low, high=high, **changes)], torch.zeros(3, dtype=torch.float64))  # type: ignore[arg-type]


def slow_density(medium: Medium, p: np.ndarray) -> float:
    low, high = medium.low.numpy().astype(float), medium.high.numpy().astype(float)
    if ((p < low) | (p > high)).any():
        return 0.0
    if not isinstance(medium.density, torch.Tensor):
        return medium.density * math.exp(-medium.falloff * (p[1] - medium.ground))
    g = medium.density.numpy().astype(float)
    at = (p - low) / (high - low) * np.array(g.shape[::-1]) - 0.5
    at = np.clip(at, 0, np.array(g.shape[::-1]) - 1)
    i = np.minimum(at.astype(int), np.array(g.shape[::-1]) - 2)
    f, total = at - i, 0.0
    for k in range(8):
        b = np.array([k & 1, k >> 1 & 1, k >> 2])
        w = np.prod(np.where(b, f, 1 - f))
        total += w * g[tuple((i + b)[::-1])]
    return float(total)


@kernel()
def _density(media, x, y, z):
    return density_at(media, 0, x, y, z)


@kernel()
def _way(media, p, d, length, steps):
    return way_through(media, 0, p, d, length, steps)


@kernel()
def _functions(x, out):
    for k in range(len(x)):
        out[0, k] = exponential(x[k])
        out[1, k] = arctan2(np.float32(math.sin(x[k])), np.float32(math.cos(x[k])))
        out[2, k] = tangent(x[k])


@pytest.mark.parametrize("kind", KINDS)
def test_density_is_what_the_medium_says(kind: str) -> None:
    made = table(**KINDS[kind])
    rng = np.random.default_rng(0)
    for p in rng.uniform([-0.9, -1.9, -1.4], [1.9, 0.9, 0.9], (40, 3)):
        found = _density(made.arrays, *p.astype(np.float32))
        assert found == pytest.approx(slow_density(made.media[0], p), rel=2e-5)


@pytest.mark.parametrize("kind", KINDS)
def test_ways_are_integrals_of_the_density(kind: str) -> None:
    made = table(**KINDS[kind])
    rng = np.random.default_rng(1)
    for _ in range(12):
        p, d = rng.uniform(-3, 3, 3), rng.normal(size=3)
        d /= np.linalg.norm(d)
        length = rng.uniform(0.5, 8.0)
        t = (np.arange(4000) + 0.5) / 4000 * length
        wanted = sum(slow_density(made.media[0], p + d * x) for x in t) * length / 4000
        found = _way(made.arrays, p.astype(np.float32), d.astype(np.float32), np.float32(length), 400)
        assert found == pytest.approx(wanted, rel=3e-3, abs=3e-3)


@pytest.mark.parametrize("steps", [1, 2, 7])
def test_steps_through_a_density_that_grows_evenly_are_exact(steps: int) -> None:
    """Looks are in the middles of steps: what one misses before, it has too much behind."""
    made = table(density=torch.arange(6.0).expand(5, 4, 6).contiguous())
    p, d = np.array([-0.7, -1.0, -0.5], np.float32), np.array([1.0, 0.0, 0.0], np.float32)
    for length in (0.3, 1.1, 2.2):  # within the centres of the outer cells
        ends = [slow_density(made.media[0], p + d * t) for t in (0.0, length)]
        assert _way(made.arrays, p, d, np.float32(length), steps) == pytest.approx(sum(ends) / 2 * length, rel=1e-5)


def test_ways_of_many_rays_are_those_of_each() -> None:
    made = table(density=GRID)
    rng = np.random.default_rng(2)
    d = rng.normal(size=(50, 3))
    d = (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)
    p = rng.uniform(-3, 3, (50, 3)).astype(np.float32)
    beams = Beams(p, d, np.zeros((50, 2), np.float32))
    lengths = rng.uniform(1, 9, 50).astype(np.float32)
    clip_rays(made.arrays, beams, lengths)
    ways = np.zeros((50, 1), np.float32)
    ways_through(made.arrays, beams, 300, ways)
    for k in range(50):
        assert ways[k, 0] == pytest.approx(_way(made.arrays, p[k], d[k], lengths[k], 300), rel=2e-2, abs=2e-3)


def test_means_towards_a_light_are_means() -> None:
    made = table(density=GRID)
    numbers = np.zeros(12, np.float32)
    numbers[3:6] = (0.6, -0.8, 0.0)
    means = np.zeros((3, 3, 3), np.float32)
    light_means(made.arrays, 0, SUN, numbers, 200, means)
    low, high = made.media[0].low.numpy(), made.media[0].high.numpy()
    for k, j, i in np.ndindex(3, 3, 3):
        p = low + (np.array([i, j, k]) + 0.5) / 3 * (high - low)
        toward = np.array([-0.6, 0.8, 0.0])
        end = min((high[0] - p[0]) / 1e-30 if toward[0] > 0 else (low[0] - p[0]) / toward[0], (high[1] - p[1]) / 0.8)
        t = (np.arange(400) + 0.5) / 400 * end
        wanted = np.mean([slow_density(made.media[0], p + toward * x) for x in t])
        assert means[k, j, i] == pytest.approx(wanted, rel=5e-3)


@settings(deadline=None)
@given(st.lists(st.floats(-1.5625, 1.5625, width=32), min_size=1, max_size=20))
def test_polynomials_are_the_functions(values: list[float]) -> None:
    x = np.array(values, np.float32)
    out = np.zeros((3, len(x)), np.float32)
    _functions(x, out)
    np.testing.assert_allclose(out[0], np.exp(x.astype(float)), rtol=2e-6)
    np.testing.assert_allclose(out[1], x, atol=2e-6)
    np.testing.assert_allclose(out[2], np.tan(x.astype(float)), rtol=5e-4, atol=1e-6)


def test_exponentials_of_large_arguments_are_finite_and_small() -> None:
    x = np.array([-1e30, -200.0, -88.0, 88.0, 1e30], np.float32)
    out = np.zeros((3, 5), np.float32)
    _functions(x, out)
    assert np.isfinite(out[0]).all() and (out[0, :3] < 1e-37).all()


def test_the_phase_function_of_kernels_is_that_of_the_effect() -> None:
    from torchrender.effects.media.phase import henyey_greenstein

    for g in (-0.99, -0.5, 0.0, 0.3, 0.99):
        for c in np.linspace(-1, 1, 9):
            wanted = float(henyey_greenstein(torch.tensor(c, dtype=torch.float64), g))
            assert phase(np.float32(g), np.float32(c)) == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_rays_along_an_axis_meet_the_box_or_pass_it(kind: str) -> None:
    """Directions with components of zero, beside every side of the box and through it."""
    made = table(**KINDS[kind])
    medium = made.media[0]
    low, high = medium.low.numpy().astype(float), medium.high.numpy().astype(float)
    for along in range(3):
        for across in (k for k in range(3) if k != along):
            for place, meets in ((low[across] - 0.2, False), (high[across] + 0.2, False), (low[across] + 0.4, True)):
                p, d = (low + high) / 2, np.zeros(3)
                p[along], p[across], d[along] = low[along] - 1.0, place, 1.0
                found = _way(made.arrays, p.astype(np.float32), d.astype(np.float32), np.float32(9.0), 200)
                assert (found > 0.0) == meets
