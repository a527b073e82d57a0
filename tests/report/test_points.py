"""The study of points: a tiny run from end to end, and the definitions of its errors."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
import torch

from point_scenes import sphere_cloud
from torchrender.images.files import read_image
from torchrender.points.codec import compress, decompress
from torchrender.points.draw import render_points
from torchrender.points.options import SplatOptions
from torchrender.points.tree import build_patches
from torchrender.report.common.parts import Parts
from torchrender.report.points.models import bumpy_sphere, close_camera, ground_reference
from torchrender.report.points.study import QUICK, errors, node_errors, run
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere
from torchrender.tuning.systems.points import drawn_surfaces


def test_a_tiny_study_writes_its_page(tmp_path, monkeypatch):
    """Without real models and without pyvista the page says so and has the rest."""
    monkeypatch.setenv("TORCHRENDER_DATA", str(tmp_path / "none"))
    monkeypatch.setattr("torchrender.report.points.study.pyvista_points", lambda *_: {"skipped": "not asked for"})
    run(replace(QUICK, size=48, counts=(3000,), one_pixel=2000, runs=1, peer=(1000, 32)), tmp_path, Parts())
    page = (tmp_path / "points.md").read_text()
    assert "| Dragon (published, 2000s GPU) | adaptive EWA | 1.28 M | 0.42 M | 0.33 | 10.75 | 4.5 |" in page
    assert "| bumpy sphere | adaptive EWA | 0.003 M |" in page and "Not measured: not asked for." in page
    assert "nan" not in page
    record = json.loads((tmp_path / "points.json").read_text())
    ground = record["aliasing"]
    assert ground["adaptive"]["far"] > ground["reconstruction"]["far"] + 5
    assert abs(ground["adaptive"]["all"] - ground["full"]["all"]) < 0.3
    assert record["one_pixel"]["deepest"]["drawn"] == 2000
    assert read_image(tmp_path / "points-ground.png").shape == (256, 6 * 256, 3)


def test_the_reference_is_the_scene_with_smooth_edges():
    scene = Scene(meshes=(sphere(segments=96),))
    camera = Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=64, height=64)
    options = SplatOptions(background=(0.0, 0.0, 1.0))
    image, coverage = drawn_surfaces(scene, camera, options, 4)
    assert 0 < int(((coverage > 0) & (coverage < 1)).sum()) < 300
    torch.testing.assert_close(image[0, 0], torch.tensor([0.0, 0.0, 1.0]))
    # A sphere seen from four units away fills a circle of this radius.
    radius = float(camera.intrinsics[0, 0, 0]) * math.tan(math.asin(0.25))
    assert float(coverage.sum()) == pytest.approx(math.pi * radius**2, rel=0.01)
    strips = drawn_surfaces(scene, camera.sub_camera(0, 20, 64, 8), options, 4)[0]
    torch.testing.assert_close(strips, image[20:28])


def test_errors_of_equal_pictures_are_none():
    patches = build_patches(sphere_cloud(2000))
    drawn = render_points(patches, patches.camera(width=40, height=40))
    coverage = drawn.mask[0].float()
    row = errors(drawn, drawn, (drawn.image[0], coverage))
    assert (row["psnr"], row["psnr_full"], row["holes"], row["outline"]) == (120.0, 120.0, 0, 0.0)
    assert row["ssim"] == pytest.approx(1.0)


def test_node_errors_of_compressed_points_are_those_stated():
    plain = build_patches(sphere_cloud(3000))
    assert max(node_errors(plain, plain).values()) < 0.05  # acos of almost one
    found = node_errors(plain, decompress(compress(plain)))
    assert found["position_max"] <= 1.01 / 2048 and found["normal_max"] <= 0.79


def test_the_synthetic_model_has_right_normals():
    cloud = bumpy_sphere(20_000)
    found = replace(cloud, normal=None).completed()
    assert float((found.normal * cloud.normal).sum(1).min()) > 0.9
    camera = close_camera(cloud, 32)
    assert float(camera.transform(cloud.position)[..., 2].min()) > float(camera.near[0])


def test_the_ground_reference_turns_grey_in_the_distance():
    camera = Cameras.look_at([0.0, 1.5, 0.0], [0.0, 0.0, -8.0], width=64, height=64, fov_deg=50, near=0.1)
    value, share, distance = ground_reference(camera, 8)
    far, near = (share > 0.999) & (distance > 18), (share > 0.999) & (distance < 5)
    assert 0.3 < float(value[far].mean()) < 0.7
    assert float((value[near] - 0.5).abs().mean()) > float((value[far] - 0.5).abs().mean()) + 0.1
