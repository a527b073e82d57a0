"""The study of scattering: its page says what was measured."""

from __future__ import annotations

import torch

from torchrender.report.scattering.motion import edits, film
from torchrender.report.scattering.page import lines
from torchrender.report.scattering.scenes import KINDS, eye, t1, t2
from torchrender.report.scattering.stage import QUICK, Stage, errors, shaft_edges
from torchrender.report.scattering.study import baselines, costs, published, trends


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


def test_the_page_holds_what_was_measured(tmp_path) -> None:
    record = {
        "machine": dict.fromkeys(("processor", "cores", "kernel_threads", "system", "python", "commit", "date"), "-"),
        "study": {"size": QUICK.size, "frames": 2},
        "published": published(QUICK),
        "ways": [],
        "costs": costs(QUICK),
        "baselines": baselines(QUICK),
        "trends": trends(QUICK),
        "film": film(QUICK, tmp_path),
        "edits": edits(QUICK),
        "peer": {"missing": "Mitsuba is not installed"},
    }  # fmt: skip
    text = "\n".join(lines(record))
    assert "3 x 3 | 20 | lsq" in text and "behind the camera" in text and "Mitsuba is not installed" in text
    more = record["trends"]["scattering 0.02 to 0.1, no absorption"]
    assert more == sorted(more)
