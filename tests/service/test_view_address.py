"""Views in addresses: Python writes what the page reads, wherever the scene lies."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import numpy as np
import pytest

import torchrender as tr
from torchrender.wire.cameras import header_of, view_text

JS = Path(tr.__file__).parent.parent / "service" / "torchrender_service" / "static" / "js" / "address.js"
WAY = np.array([0.3, -0.2, -0.9]) / np.linalg.norm([0.3, -0.2, -0.9])
SIZES = (0.0, 1e-3, 1.0, 1e6, 5.123456789e6, 1e9, 9e11)


def looking(size: float, diagonal: float) -> tr.Cameras:
    eye = np.array([size, 0.37 * size, -0.81 * size])
    return tr.Cameras.look_at(eye, eye + max(diagonal, 1e-4 * size, 1e-3) * WAY, width=64, height=36)


def read(text: str) -> tuple[np.ndarray, np.ndarray]:
    """As the page: words of a form, then numbers between commas."""
    (view,) = parse_qs(urlsplit(f"http://host/?scene=a&view={text}").query)["view"]
    numbers = np.array([float(word) for word in view.split(",")])
    assert len(numbers) == 6
    return numbers[:3], numbers[3:]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("diagonal", [0.0, 0.01, 3.0, 2000.0])
def test_eye_and_direction_come_back(size: float, diagonal: float) -> None:
    camera = looking(size, diagonal)
    eye, target = read(view_text(header_of(camera), diagonal))
    way = (target - eye) / np.linalg.norm(target - eye)
    forward = camera.forward[0].numpy()
    assert np.abs(way - forward).max() < 1e-6
    assert np.abs(eye - camera.eye[0].numpy()).max() <= 1e-6 * max(size, diagonal, 1e-6)
    if size >= 1e6:
        assert np.abs(eye - camera.eye[0].numpy()).max() <= max(1e-6 * diagonal, 1e-8 * size * 1e-6, 1e-15 * size)


def test_addresses_stay_short_near_the_origin() -> None:
    assert len(view_text(header_of(looking(1.0, 3.0)), 3.0)) < 80
    assert "+" not in view_text(header_of(looking(9e11, 1e10)), 1e10)


def test_views_of_far_scenes_have_such_addresses() -> None:
    mesh = tr.Mesh.box(20.0, (4.5e8, 120.0, 5.4e9))
    with tr.show(tr.Scene(meshes=(mesh,), name="scan"), browser=False) as view:
        view.camera = camera = view.scene.camera(width=64, height=36)
        eye, target = read(view.url.partition("view=")[2])
    way = (target - eye) / np.linalg.norm(target - eye)
    assert np.abs(way - camera.forward[0].numpy()).max() < 1e-6


@pytest.mark.skipif(shutil.which("node") is None, reason="needs Node.js")
def test_the_page_writes_and_reads_them_alike(tmp_path: Path) -> None:
    for file in ("address.js", "camera.js", "controls.js", "gamepad.js"):
        text = (JS.parent / file).read_text().replace('.js"', '.mjs"')
        (tmp_path / file.replace(".js", ".mjs")).write_text(text)
    cases = [(size, diagonal) for size in SIZES for diagonal in (0.01, 3.0, 2000.0)]
    given = []
    for size, diagonal in cases:
        camera = looking(size, diagonal)
        header = header_of(camera)
        told = {name: getattr(header, name) for name in header.__struct_fields__}
        given.append({"camera": told, "diagonal": diagonal, "text": view_text(header, diagonal)})
    code = """
import { readFileSync } from "node:fs";
import { cameraOf, viewText } from "./address.mjs";
const up = [0, 1, 0];
const found = JSON.parse(readFileSync("cases.json", "utf8")).map(({ camera, diagonal, text }) => {
  const python = cameraOf(new URLSearchParams("view=" + text).get("view"), camera, up);
  const page = viewText({ camera, diagonal, orbiting: false });
  return { python: python?.world_from_camera, page, back: cameraOf(page, camera, up)?.world_from_camera };
});
console.log(JSON.stringify(found));
"""
    (tmp_path / "cases.json").write_text(json.dumps(given))
    (tmp_path / "run.mjs").write_text(code)
    done = subprocess.run(["node", "run.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=True)
    for (size, diagonal), case, found in zip(cases, given, json.loads(done.stdout), strict=True):
        matrix = np.reshape(case["camera"]["world_from_camera"], (4, 4))
        assert found["page"] == case["text"] or read(found["page"])[0] == pytest.approx(read(case["text"])[0], rel=1e-7)
        for way in ("python", "back"):
            assert found[way] is not None, (way, size, diagonal)
            seen = np.reshape(found[way], (4, 4))
            assert np.abs(seen[:3, :3] - matrix[:3, :3]).max() < 2e-6, (way, size, diagonal)
            assert math.isclose(seen[0, 3], matrix[0, 3], rel_tol=1e-7, abs_tol=1e-7)
