"""The reflection study: a tiny run from end to end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from torchrender.images.files import read_image
from torchrender.report.reflections.page import PARTS
from torchrender.report.reflections.study import QUICK, run_study, write_study


def test_a_tiny_study_makes_its_page(tmp_path: Path) -> None:
    study = replace(
        QUICK,
        rooms=("living_room",),
        size=24,
        triangles=10_000,
        counts=(10_000,),
        outputs=(24,),
        rules=(1.0,),
        path=1,
        sweep_size=16,
    )
    record = run_study(study, tmp_path)
    write_study(record, tmp_path)
    page = (tmp_path / "reflections.md").read_text()
    for heading in ("Against rays", "Time", "Triangles", "Number of clusters", "Gloss", "Along a path"):
        assert f"## {heading}" in page
    picture = read_image(tmp_path / "reflections.jpg")
    assert tuple(picture.shape[:2]) == (24, 72)
    time, paid = (page.index(f"| living room{label} |") for label in ("", ", everything paid"))
    assert 0 < page.index("## Time") < time < paid and record["triangles"][0]["preparations"].keys() == {*PARTS}
    none, all_pixels = record["share"][0], record["share"][-1]
    assert none["pixels"] == 0 and all_pixels["pixels"] > 0
    for row in record["quality"].values():
        assert max(row["clustered"]["channels"]) < max(row["environment"]["channels"])
