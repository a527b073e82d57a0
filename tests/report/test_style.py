"""The study of material style: its parts on small scenes, and its page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch

from photo_scenes import room, striped_photo
from torchrender.photo.style.options import StyleOptions
from torchrender.photo.style.transfer import style_scene
from torchrender.quality.machine import machine_record
from torchrender.report.style.flat import flat_rows, reinhard
from torchrender.report.style.known import known_photo, known_row, mean_colors, stripped
from torchrender.report.style.page import write_page
from torchrender.report.style.study import StudyOptions, cost_row, optimum_share
from torchrender.report.style.subjects import largest

QUICK = StyleOptions(views=8, width=80, height=60)
COLORS = {
    "floor": (0.4, 0.2, 0.1),
    "sofa": (0.1, 0.1, 0.5),
    "table": (0.5, 0.1, 0.1),
    "shelf": (0.1, 0.4, 0.1),
    "back wall": (0.7, 0.6, 0.5),
}


def test_the_true_materials_have_no_error_and_a_registered_photo_offers_them() -> None:
    scene = room(COLORS)
    known = known_photo(scene, QUICK, registered=True)
    style = style_scene(stripped(scene), known.photo, QUICK, cameras=known.cameras)
    truth = mean_colors(style, known.rows)
    assert np.allclose(truth, mean_colors(style, known.rows.clone()), equal_nan=True) and not np.isnan(truth).all()
    row = known_row("room", scene, QUICK, registered=True)
    assert row["wrong_possible"] <= row["wrong"] <= 0.5 and row["wrong"] <= row["wrong_random"] + 0.1
    held_out = known_photo(scene, QUICK, registered=False)
    assert len(held_out.cameras) == len(known.cameras) - 1


def test_costs_and_the_page(tmp_path: Path) -> None:
    style = style_scene(room(), striped_photo(), QUICK)
    study = StudyOptions(random=3, seeds=3, options=QUICK)
    row = cost_row("living room", "kitchen", style, study)
    assert row["found"] <= min(row["start"], row["greedy"], row["single"][0], row["random"][0]) + 1e-9
    share = optimum_share(style, 3, objects=3, columns=3)
    assert 0 <= share["share"] <= 1 and share["gap"] >= -1e-12
    known = dict.fromkeys(("wrong", "wrong_shown", "wrong_start", "wrong_random", "wrong_possible", "median"), 0.5)
    write_page(
        {
            "machine": machine_record(),
            "costs": [row],
            "unclustered": {"found": 1.0, "chroma": 1.0, "chroma_clustered": 2.0},
            "optimum": share,
            "flat": [{"photo": "kitchen", **r} for r in flat_rows(style)],
            "known": [{"scene": "room", "registered": True, "objects": 3, "shown": 2, **known}],
            "time": {
                "objects": 3, "views": 8, "total_s": 1.0, "lock_s": 0.1, "pick_s": 0.1, "table_error": 0.0,
                "timings_ms": dict(style.timings_ms), "neighbours": 5, "table_ms": 1.0, "render_ms": 500.0,
            },
            "settings": [{"case": "x", "seconds": 1.0, "search_ms": 1.0, "per_view": 0.5, "ratio": 0.5}],
        },
        tmp_path,
    )  # fmt: skip
    text = (tmp_path / "material-style.md").read_text()
    assert "500×" in text and "| room | yes | 3 | 2 | **50 %** |" in text


def test_two_dimensional_transfer_has_the_photos_moments() -> None:
    picture = torch.rand(20, 30, 3, generator=torch.Generator().manual_seed(0)) * 0.4 + 0.2
    from torchrender.photo.lab import lab_from_linear

    made = lab_from_linear(reinhard(picture, picture.flip(0) * 0.9).double())
    wanted = lab_from_linear((picture.flip(0) * 0.9).double())
    assert torch.allclose(made[..., 1:].mean(dim=(0, 1)), wanted[..., 1:].mean(dim=(0, 1)), atol=0.5)


def test_the_largest_objects_stay() -> None:
    assert {m.name for m in largest(room(), 6).meshes} == {m.name for m in room().meshes[:6]}
