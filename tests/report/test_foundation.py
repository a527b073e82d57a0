"""The foundation report runs small, and its page says what was measured."""

from __future__ import annotations

import pytest
import torch

from torchrender.quality.machine import machine_line, machine_record
from torchrender.quality.timing import Timing, take_turns
from torchrender.raster import rasterize_visibility
from torchrender.report.foundation import page as foundation_page
from torchrender.report.foundation import study as foundation
from torchrender.report.foundation.peers import opengl_raster
from torchrender.report.foundation.rays import measure_rays
from torchrender.scene.procedural import build


def test_candidates_take_turns():
    order = []
    times = take_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, runs=3, warm_up=1)
    assert order == ["a", "b"] * 4
    assert times["a"].runs == 3
    assert Timing.of([0.001, 0.003, 0.002]) == Timing(2.0, 1.0, 3.0, 3)


def test_agreement_with_the_ray_caster():
    result = foundation.agreement(build("cornell_box"), 64)
    assert result["pixels"] > 1000
    assert result["same_id"] >= 0.999
    assert result["depth_error_max"] < 1e-5


def test_software_opengl_draws_the_same_picture_where_it_runs():
    scene = build("cornell_box")
    camera = scene.camera(width=64, height=64)
    drawn = opengl_raster(scene.geometry, camera)
    if isinstance(drawn, str):
        assert "not usable" in drawn  # said in the report instead
        pytest.skip(drawn)
    ids = torch.frombuffer(drawn[0]()[0], dtype=torch.int32).reshape(64, 64).flip(0)
    seen = rasterize_visibility(scene.geometry, camera).triangle[0]
    covered = seen >= 0
    assert float((ids[covered] == seen[covered]).double().mean()) > 0.98


def test_the_page_holds_every_figure(tmp_path):
    scene = build("cornell_box")
    row = foundation.compare(scene, 32, 1)
    sweep = [
        {"triangles": 96.0, "side": 32, "share_in_view": s, "zoom": 1.0, **row["ms"]["torchrender"]} for s in (1, 0.5)
    ]
    record = {
        "machine": machine_record(),
        "size": 32,
        "gbuffer": {"cornell_box": {**row, "cost": foundation.cost_model(scene, 32, 2)}},
        "changing": [foundation.changing(scene, 32, 1)],
        "views": [foundation.many_views("cornell_box", scene, 3, 16, 1)],
        "floor_ms": foundation.write_floor(32, 2),
        "triangles": sweep,
        "pixels": sweep,
        "in_view": sweep,
        "rays": {"machine": {**machine_record(), "commit": "elsewhere"}, "rows": measure_rays(quick=True)},
        "start": {"cached": 1.5, "very_first": 20.0},
    }
    foundation_page.write_page(record, tmp_path)
    text = (tmp_path / "foundation.md").read_text()
    assert machine_line(record["machine"]) in text
    assert f"| {record['changing'][0]['triangles']:,} |" in text
    assert "1.5 s with compiled kernels cached, 20.0 s the very first time" in text
    assert f"| cornell_box | {record['views'][0]['per_second']['depth']:.0f} |" in text
    assert f"{100 * row['agreement']['same_id']:.4f} %" in text
    for found in record["rays"]["rows"][0]["kinds"].values() if record["rays"]["rows"] else ():
        assert f"| {found['mrays_per_s']['caster']:.2f} |" in text
        assert f"| 0 of {found['rays']:,} |" in text
        assert f"rad: 0 of {record['rays']['rows'][0]['grazing']['rays']:,}" in text
    assert (tmp_path / "foundation-scaling.png").stat().st_size > 1000
