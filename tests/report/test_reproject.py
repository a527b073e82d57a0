"""The reprojection report: a tiny run from end to end."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchrender.depth.sample import sample_depth_images
from torchrender.images.files import read_image
from torchrender.report.reproject import study
from torchrender.report.reproject.kornia_warp import flow_warp, homography_warp
from torchrender.report.reproject.study import SCENES, run
from torchrender.scene.procedural import build


def test_a_tiny_run_writes_its_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "EVERY", ("cornell_box", "city"))
    run(tmp_path, 48, 1, triangles=10_000)
    record = json.loads((tmp_path / "reproject.json").read_text())
    assert len(record["scenes"]) == 2 * len(SCENES)
    for found in record["scenes"].values():
        assert 0.3 < found["filled"] <= 1.0
        assert all(row["median"] > 0 for row in found["ms"].values())
        hybrid, grid = (found["quality"][key] for key in ("hybrid, offset images", "grid"))
        assert 0.8 < hybrid["valid"] <= 1.0 and hybrid["valid"] >= grid["valid"] - 0.02
    page = (tmp_path / "reproject.md").read_text()
    for row in record["every"]:
        assert all(timing["median"] > 0 for timing in row["ms"].values()) and f"| {row['scene']} |" in page
    assert "plain torch grid" in page and "nan" not in page
    assert "| kornia homography of one image |" in page and "| kornia flow of one image, depth given |" in page
    assert read_image(tmp_path / "reproject.png").shape == (4 * 48, 5 * 48, 3)


def test_warps_of_others_bring_an_image_back_to_its_own_view() -> None:
    scene = build("cornell_box")
    camera = scene.camera(width=40, height=30)
    images = sample_depth_images(scene, camera)
    color = torch.rand(1, 30, 40, 3, generator=torch.Generator().manual_seed(0))
    images = replace(images, color=color)
    inner = (slice(1, -1), slice(1, -1))  # beyond the borders there is nothing
    for found in (homography_warp(images, camera), flow_warp(images, camera, images.depth[0])):
        torch.testing.assert_close(found[inner], color[0][inner], atol=2e-3, rtol=0)
