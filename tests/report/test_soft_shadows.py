"""The soft-shadow study: error definitions, and a tiny run from end to end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from torchrender.effects.shadows.soft_shadow import LightVisibility, SoftShadowOptions, count_bits, soft_shadow
from torchrender.images.files import read_image
from torchrender.raster import rasterize
from torchrender.report.soft_shadows.errors import error_images, mean_errors
from torchrender.report.soft_shadows.study import run
from torchrender.report.soft_shadows.subject import QUICK, study_light
from torchrender.scene.procedural import build


def visibility(bits: list[int], samples: int = 64) -> LightVisibility:
    words = torch.tensor(bits).reshape(1, 1, 1, -1, 1)
    lit = count_bits(words)
    return LightVisibility(lit, lit / samples, torch.full_like(lit, samples), words, (samples,), (0,), ())


def test_error_definitions() -> None:
    """All wrong gives 255; one sample wrongly lit and one wrongly dark cancel in the intensity."""
    vis, signed = error_images(visibility([0, 0b0110, 0b1]), visibility([-1, 0b0101, 0b1]))
    assert vis.reshape(-1).tolist() == pytest.approx([255.0, 510.0 / 64, 0.0])
    assert signed.reshape(-1).tolist() == pytest.approx([-255.0, 0.0, 0.0])


def test_original_triangles_agree_across_engines_and_bounds_hold() -> None:
    """Maps drawn whole and texels traced one by one answer the same question; without casters, all is far off."""
    scene = build("city", triangles=3000)
    view, light = rasterize(scene, scene.camera(width=48, height=48)), study_light(scene.bounds)
    options = SoftShadowOptions(light_samples=4, map_size=128, visibility="shadow_map")
    reference = soft_shadow(scene.geometry, light, view, options)
    drawn = soft_shadow(scene.geometry, light, view, replace(options, engine="maps"))
    assert mean_errors(drawn, reference, view.covered)["vis"] < 0.1
    lit = soft_shadow(replace(scene, meshes=scene.meshes[:1]).geometry, light, view, options, bounds=scene.bounds)
    assert mean_errors(lit, reference, view.covered)["vis"] > 1.0
    vis, signed = error_images(lit, reference)
    assert bool((signed.abs() <= vis + 1e-4).all()) and float(vis.max()) <= 255.0 and float(vis.max()) > 0


def test_study_writes_its_page(tmp_path: Path) -> None:
    record = run(QUICK, tmp_path)
    page = (tmp_path / "soft-shadows.md").read_text()
    for heading in ("resolution", "size of the light", "By mesh", "scene size", "penumbra"):
        assert heading in page
    assert (tmp_path / "soft-shadows-cost.png").exists() and (tmp_path / "soft-shadows.json").exists()
    assert read_image(tmp_path / "soft-shadows-city.png").shape == (48, 144, 3)
    for row in record["errors"]["resolution"]["city"].values():
        for cell in row.values():
            assert 0.0 <= cell["A"]["int"] <= cell["A"]["vis"] <= 255.0
    assert all(share < 1e-3 for share in record["skipping"].values())
    assert all(abs(r["skipping lit"] - r["tracing all lit"]) <= 1e-3 * r["tracing all lit"] for r in record["penumbra"])
