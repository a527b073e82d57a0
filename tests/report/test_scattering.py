"""The study of scattering: its page says what was measured."""

from __future__ import annotations

from dataclasses import asdict, replace

import pytest
import torch

from torchrender.report.scattering.motion import edits, film
from torchrender.report.scattering.page import lines, plot
from torchrender.report.scattering.peers import beside_mitsuba
from torchrender.report.scattering.probes import Probes
from torchrender.report.scattering.scenes import KINDS, eye, t1, t2
from torchrender.report.scattering.stage import QUICK, Stage, errors, shaft_edges
from torchrender.report.scattering.streamed import STEPS, after_steps
from torchrender.report.scattering.study import baselines, costs, trends
from torchrender.report.scattering.ways import QUICK_WAYS, published, quick_ways, ways_of


def test_errors_are_shares_of_the_mean() -> None:
    wanted = torch.full((4, 4), 2.0, dtype=torch.float64)
    found = wanted.clone()
    found[0, 0] = 3.0
    made = errors(found, wanted, wanted == found)
    assert made["rmse"] == (1 / 16) ** 0.5 / 2 and made["max"] == 0.5 and made["edge"] == 0.0


def test_scenes_have_shafts_and_all_kinds_of_media() -> None:
    for kind in KINDS:
        assert len(t1(kind).media) == 1
    stage = Stage.of(t2("sun"), eye(40, 30), 256)
    light = stage.light(block=1)
    assert bool((light > 0).any()) and bool((light == 0).any())
    assert 0.0 < float(shaft_edges(light).float().mean()) < 0.1


def test_probes_are_the_pixels_of_the_picture() -> None:
    """By the same way they have the light that the picture has there, each by itself."""
    stage = Stage.of(t2("lamp"), eye(40, 30), 256)
    light = stage.light(way="walk", block=1)
    probes = Probes.of(stage, light, 50)
    torch.testing.assert_close(probes.light(way="walk"), light.reshape(-1)[probes.chosen], rtol=1e-4, atol=1e-6)
    made = probes.errors(1.1 * light, probes.light(way="walk"))
    assert 0.05 < made["rmse"] < 0.5 and 0.05 < made["edge"] < 0.5


def test_ways_are_compared_with_the_walk_and_with_rays() -> None:
    rows = {r["way"]: r for r in ways_of("T2 sun", t2("sun", "height"), QUICK)}
    assert set(rows) == {*QUICK_WAYS, "64 steps"}
    assert rows["slices"]["walk"]["rmse"] < 0.1 and rows["slices"]["share"] == 1.0
    assert rows["slices, 3 x 3, marks by length alone"]["walk"]["edge"] > rows["slices"]["walk"]["edge"]


def test_blocks_are_left_out_where_they_change_nothing() -> None:
    assert set(quick_ways(t2("lamp"))) == {"slices", "walk, 2 x 2"}
    assert set(quick_ways(t2("lamp", "grid"))) == set(QUICK_WAYS)


def test_the_page_holds_what_was_measured(tmp_path) -> None:
    named = ("processor", "cores", "kernel_threads", "system", "python", "commit", "date")
    row = {
        "case": "T2 sun, height",
        "ms": 90.0,
        "least_ms": 80.0,
        "share": 0.3,
        "walk": {"rmse": 0.01, "edge": 0.03},
        "rays": {"rmse": 0.02, "edge": 0.04},
    }
    rows = [row | {"way": "slices, 2 x 2"}, row | {"way": "64 steps", "least_ms": 400.0}]
    peer = {"case": "T1", "rows": [{"what": "slices", "ms": 10.0, "rmse": 0.01}], "mean": 1.0, "tiles": 0.02}
    record = {
        "machine": dict.fromkeys(named, 2),
        "load": 3.0,
        "study": asdict(QUICK),
        "published": published(QUICK),
        "ways": rows,
        "costs": costs(QUICK),
        "baselines": baselines(QUICK),
        "trends": trends(QUICK),
        "film": film(QUICK, tmp_path),
        "edits": edits(QUICK),
        "streamed": [{"scene": "hall", "step": 0.1, "fog": 0.02, "clear": 0.01}],
        "peer": {"version": "3", "variant": "x", "size": (4, 3), "cases": [peer | {"at_our_time": 0.5}]},
    }
    text = "\n".join(lines(record))
    assert (
        "3 x 3, guard 20, lsq, marks by length alone" in text
        and "behind the camera" in text
        and "Other work ran beside (load 3.0" in text
    )
    assert "80 | 80 | 5.0" in text, "what was asked for, and how many times as quick as 64 steps"
    assert "| T1 | 1.0000 | 2.00 % | 50.00 % | 50 |" in text
    assert "| hall | 0.1 | 2.00 % | 1.00 % |" in text
    quiet = "\n".join(lines(record | {"load": 0.1, "peer": {"missing": "Mitsuba is not installed"}}))
    assert "Nothing else ran on the machine (load 0.1" in quiet and "Mitsuba is not installed" in quiet
    assert record["edits"]["pictures"]["density"]["ratio"] > 0 and record["edits"]["none in view"] < 50
    more = record["trends"]["scattering 0.02 to 0.1, no absorption"]
    assert more == sorted(more)
    plot(tmp_path / "cost.png", record["costs"])
    assert (tmp_path / "cost.png").stat().st_size > 5000


def test_a_path_tracer_finds_the_same_light() -> None:
    """The same scene in the same units: means of the whole picture, beside what is drawn here."""
    pytest.importorskip("mitsuba")
    study = replace(QUICK, small=(60, 45), map_size=512, rays_steps=256, peer_samples=(128,))
    made = beside_mitsuba(study)
    assert len(made["cases"]) == 3
    for case in made["cases"]:
        assert case["mean"] == pytest.approx(1.0, abs=0.15) and case["tiles"] < 0.5
        assert case["rows"][0]["rmse"] < 0.2 < case["rows"][1]["rmse"]


def test_keyframes_are_compared_after_steps_with_media_and_without() -> None:
    rows = after_steps(64, ("hall",))
    assert [row["step"] for row in rows] == list(STEPS)
    assert all(0.0 < row[air] < 0.5 for row in rows for air in ("fog", "clear"))
    assert all(row["fog"] != row["clear"] for row in rows)
