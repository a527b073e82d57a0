"""Colour statistics, their distance, and tables that answer for any choice."""

from __future__ import annotations

import time

import numpy as np
import pytest
import torch

from photo_scenes import around, room, striped_photo
from torchrender.errors import OptionError
from torchrender.photo.lab import lab_from_linear
from torchrender.photo.photograph import prepare_photo
from torchrender.photo.style.adjacency import Smoothness
from torchrender.photo.style.cost import StyleCost
from torchrender.photo.style.objects import cut_scene
from torchrender.photo.style.statistics import (
    ColorStatistics,
    build_tables,
    photo_statistics,
    rendered_distance,
    style_distance,
    style_terms,
)
from torchrender.photo.style.terms import default_light, view_terms
from torchrender.photo.style.views import look


def statistics(seed: int, bins: int = 32) -> ColorStatistics:
    colors = torch.rand(300, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    return ColorStatistics.of(lab_from_linear(colors**seed), bins)


def test_distance_of_a_picture_to_itself_is_zero_and_it_is_symmetric() -> None:
    first, second = statistics(1), statistics(3)
    assert style_distance(first, first) == pytest.approx(0.0, abs=1e-12)
    assert style_distance(first, second) == style_distance(second, first) > 0.1
    assert 0.0 <= style_terms(first, second)[2] <= 1.0
    with pytest.raises(OptionError, match="units"):
        style_distance(first, second, "percent")


def test_moments_and_bins_by_hand() -> None:
    lab = torch.tensor([[50.0, 10.0, -20.0], [20.0, 30.0, -20.0]])
    found = ColorStatistics.of(lab, 8)
    assert found.mean.tolist() == [20.0, -20.0] and found.deviation.tolist() == [10.0, 0.0]
    # Bins of 32: a in 0..32 is bin 4, b in -32..0 bin 3.
    assert found.histogram.nonzero().reshape(-1).tolist() == [4 * 8 + 3] and float(found.histogram.sum()) == 1.0
    heavy = ColorStatistics.of(lab, 8, torch.tensor([3.0, 1.0]))
    assert heavy.mean.tolist() == [15.0, -20.0]


def test_units() -> None:
    first, second = statistics(1), statistics(2)
    raw, scaled = style_terms(first, second, "raw"), style_terms(first, second)
    assert raw[0] == pytest.approx(scaled[0] * 128**2) and raw[2] == scaled[2]


@pytest.fixture(scope="module")
def stage():
    scene = room()
    objects = cut_scene(scene)
    views = look(scene, objects, around(3))
    terms = view_terms(scene, views, default_light(scene))
    generator = torch.Generator().manual_seed(7)
    materials = torch.rand(len(objects), 5, 8, dtype=torch.float64, generator=generator)
    materials[..., :6] *= 0.6
    materials[..., 7] = 5 + 60 * materials[..., 7]
    materials[:, 2, 6] = 0.0
    return terms, materials, photo_statistics([prepare_photo(striped_photo())])


def cost_of(terms, materials, wanted, bins: int = 32, units: str = "normalized") -> StyleCost:
    smooth = Smoothness.of(materials, torch.zeros(len(materials), len(materials), dtype=torch.bool), "laplacian")
    return StyleCost(build_tables(terms, materials, bins), wanted, smooth, smooth_weight=0.0, units=units)


@pytest.mark.parametrize("units", ["normalized", "raw"])
def test_tables_give_what_rendering_gives(stage, units: str) -> None:
    terms, materials, wanted = stage
    cost = cost_of(terms, materials, wanted, units=units)
    rng = np.random.default_rng(0)
    for _ in range(20):
        choice = rng.integers(0, 5, len(materials))
        rows = materials[torch.arange(len(materials)), torch.from_numpy(choice)]
        parts = rendered_distance(terms, rows, wanted, units).sum(dim=0)
        found = cost.parts(choice)
        for ours, theirs in zip((found.mean, found.deviation, found.histogram), parts.tolist(), strict=True):
            assert ours == pytest.approx(theirs, abs=1e-6 if units == "normalized" else 1e-3)


def test_neighbours_are_the_totals_of_the_moved_choices(stage) -> None:
    terms, materials, wanted = stage
    near = torch.rand(len(materials), len(materials), generator=torch.Generator().manual_seed(1)) < 0.3
    near = (near | near.T) & ~torch.eye(len(materials), dtype=torch.bool)
    prior = np.random.default_rng(2).random((len(materials), 5))
    for kind in ("laplacian", "tv"):
        cost = StyleCost(
            build_tables(terms, materials),
            wanted,
            Smoothness.of(materials, near, kind),
            smooth_weight=0.3,
            prior=prior,
        )
        moves = cost.start(np.zeros(len(materials), dtype=np.int64))
        for index, column in ((3, 2), (0, 4), (3, 1)):
            moves.move(index, column)
        assert moves.total == pytest.approx(cost.total(moves.choice), abs=1e-12)
        table = moves.neighbours()
        for index in range(len(materials)):
            for column in range(5):
                other = moves.choice.copy()
                other[index] = column
                assert table[index, column] == pytest.approx(cost.total(other), abs=1e-10)


def test_only_candidates_that_can_be_chosen_are_rendered(stage) -> None:
    terms, materials, _ = stage
    some = torch.rand(materials.shape[:2], generator=torch.Generator().manual_seed(4)) < 0.5
    some[:, 0] = True
    full, part = build_tables(terms, materials), build_tables(terms, materials, wanted=some)
    for p, i in enumerate(full.object):
        for c in range(5):
            assert np.allclose(part.sums[p, c], full.sums[p, c] * bool(some[i, c]))
    joined = build_tables(terms, materials[:, :2]).joined(build_tables(terms, materials[:, 2:]))
    assert np.array_equal(joined.sums, full.sums) and np.array_equal(joined.counts, full.counts)
    assert np.array_equal(joined.bins, full.bins)


def test_tables_are_a_hundred_times_faster_than_rendering_neighbours() -> None:
    """At the size that views have by default; both evaluate every neighbour of one choice."""
    scene = room()
    objects = cut_scene(scene)
    views = look(scene, objects, around(4, 400, 300))
    terms = view_terms(scene, views, default_light(scene))
    materials = torch.rand(len(objects), 6, 8, dtype=torch.float64, generator=torch.Generator().manual_seed(3))
    wanted = photo_statistics([prepare_photo(striped_photo())])
    moves = cost_of(terms, materials, wanted).start(np.zeros(len(materials), dtype=np.int64))
    moves.move(0, 1)
    begin = time.perf_counter()
    for _ in range(5):
        moves.move(0, 1)
        moves.neighbours()
    table_s = (time.perf_counter() - begin) / 5
    begin = time.perf_counter()
    for column in range(3):
        rendered_distance(terms, materials[:, column], wanted)
    render_s = (time.perf_counter() - begin) / 3 * len(materials) * 5
    assert render_s > 100 * table_s, (render_s, table_s)
