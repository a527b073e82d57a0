"""Points that look alike become one."""

from __future__ import annotations

import numpy as np
import pytest

from torchrender.walkthrough.density import Samples
from torchrender.walkthrough.points.merging import merge_points


def sheet(copies: int = 1, noise: float = 0.0, scale: float = 1.0) -> Samples:
    """A square metre of 64 x 64 points, photographed ``copies`` times: one half in one colour, one in stripes."""
    rng = np.random.default_rng(0)
    grid = (np.arange(64) + 0.5) / 64
    y, x = (g.reshape(-1) for g in np.meshgrid(grid, grid, indexing="ij"))
    place = np.tile(np.stack([x, y, np.ones_like(x)], axis=1), (copies, 1))
    stripes = np.where((np.arange(64) // 2 % 2 == 0)[None], 40, 200)
    grey = np.where(grid[None] < 0.5, 120, np.broadcast_to(stripes, (64, 64))).reshape(-1)
    count = 4096 * copies
    return Samples(
        position=scale * (place + rng.normal(size=(count, 3)) * noise),
        normal=np.tile(np.array([[0, 0, -1]], np.float32), (count, 1)),
        color=np.tile(np.repeat(grey[:, None], 3, 1), (copies, 1)).astype(np.uint8),
        log_density=np.full(count, np.log(4096 / scale**2), np.float32),
    )


def area(samples: Samples) -> float:
    return float(np.exp(-samples.log_density.astype(np.float64)).sum())


def test_no_more_than_needed_merges() -> None:
    made = sheet()
    assert merge_points(made, 4096) is made
    fewer = merge_points(made, 3000)
    assert 2985 <= len(fewer.position) <= 3000
    assert area(fewer) == pytest.approx(1.0, rel=0.15)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e5])
def test_smooth_places_merge_and_detail_stays(scale: float) -> None:
    made = merge_points(sheet(scale=scale), 100)
    plain = made.position[:, 0] < 0.47 * scale
    assert plain.sum() < 300
    assert (made.position[:, 0] > 0.53 * scale).sum() > 400
    assert set(np.unique(made.color)) <= {40, 120, 200} | set(range(110, 131))


def test_what_several_photos_saw_is_no_larger_for_that() -> None:
    made = merge_points(sheet(copies=4, noise=1e-3), 3000)
    assert len(made.position) <= 3000
    assert area(made) < 1.6


def test_a_strict_limit_is_kept() -> None:
    for most in (7, 500):
        assert len(merge_points(sheet(), most, strict=True).position) <= most


def test_sides_stay_apart() -> None:
    front = sheet()
    both = Samples(
        position=np.concatenate([front.position, front.position]),
        normal=np.concatenate([front.normal, -front.normal]),
        color=np.concatenate([front.color, front.color]),
        log_density=np.concatenate([front.log_density, front.log_density]),
    )
    made = merge_points(both, 100)
    assert bool((np.abs(made.normal[:, 2]) > 0.999).all())
    assert (made.normal[:, 2] > 0).sum() == (made.normal[:, 2] < 0).sum()
