"""The study of time limits: what is handed to other renderers, and its page. The renderers themselves are optional."""

from __future__ import annotations

import json
import math
from importlib.util import find_spec
from pathlib import Path

import pytest
import torch
import trimesh

from torchrender.report.time_limits import study as time_limits
from torchrender.report.time_limits.page import page
from torchrender.report.time_limits.scene import export_scene, plain_scene
from torchrender.report.time_limits.study import PEERS, StudyOptions, compared, other, own
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

TINY = StudyOptions(scenes=("cornell_box",), size=16, limits_ms=(500,), runs=1, samples=2)


def textured() -> Scene:
    texture = torch.zeros(2, 2, 3)
    texture[0] = 1.0
    return Scene(
        meshes=(
            Mesh(
                vertices=torch.eye(3, dtype=torch.float64), faces=torch.tensor([[0, 1, 2]]), uv=torch.rand(3, 2),
                colors=torch.full((3, 3), 0.5),
            ),
        ),
        materials=(Material(diffuse=torch.tensor([0.8, 0.4, 0.2]), diffuse_texture=texture, specular=1.0),),
        lights=(
            PointLight(position=torch.tensor([0.0, 1.0, 2.0])),
            SpotLight(position=torch.zeros(3), direction=torch.tensor([0.0, 0.0, 1.0])),
            DirectionalLight(direction=torch.tensor([0.0, -2.0, 0.0])),
        ),
    )  # fmt: skip


def test_plain_scenes_keep_the_mean_colour_and_nothing_that_mirrors() -> None:
    scene = plain_scene(textured())
    (material,) = scene.materials
    torch.testing.assert_close(material.diffuse, torch.tensor([0.2, 0.1, 0.05]))
    assert material.diffuse_texture is None and not material.is_reflector
    assert scene.meshes[0].colors is None and scene.meshes[0].uv is None


def test_what_is_exported(tmp_path: Path) -> None:
    scene = plain_scene(textured())
    camera = Cameras.look_at((1.0, 2.0, 3.0), (0.0, 0.0, 0.0), width=20, height=10, fov_deg=40.0)
    export_scene(scene, camera, tmp_path)
    record = json.loads((tmp_path / "scene.json").read_text())
    assert record["size"] == [20, 10] and record["fov_deg"] == pytest.approx(40.0)
    assert [row[3] for row in record["world_from_camera"][:3]] == pytest.approx([1.0, 2.0, 3.0])
    assert [light["kind"] for light in record["lights"]] == ["point", "spot", "directional"]
    assert record["lights"][2]["direction"] == [0.0, -1.0, 0.0]
    read = trimesh.load(tmp_path / record["meshes"][0]["file"], process=False)
    assert read.vertices.tolist() == torch.eye(3).tolist() and read.faces.tolist() == [[0, 1, 2]]


def test_own_row_and_page() -> None:
    scene = plain_scene(build("cornell_box"))
    row = own(scene, scene.camera(width=16, height=16), TINY)
    found = row["limits"]["500"]
    assert found["complete"] == 1.0 and 0.0 <= found["flip"] < 0.5 and 0 < found["ms"] <= found["most_ms"]
    pictures = row.pop("pictures")
    assert len(pictures) == 2 and pictures[0].shape == (192, 192, 3)
    slow = {"500": {"ms": 600.0, "most_ms": 700.0, "complete": 0.5, "flip": 0.25}}
    record = {
        "machine": dict.fromkeys(("processor", "cores", "kernel_threads", "system", "python", "commit", "date"), "x"),
        "size": 16, "limits_ms": [500], "runs": 1, "samples": 1,
        "scenes": {"cornell_box": {"triangles": 96, "renderers": {
            "torchrender": row,
            "Slow": {"version": "1", "free_ms": 900.0, "limits": slow},
            "Gone": {"missing": "not installed | here"},
        }}},
    }  # fmt: skip
    text = page(record)
    assert "| Slow 1 | 600 (700), 50.0 %, 0.250 | 900 |" in text
    assert "| Gone | not measured: not installed / here |" in text
    assert math.isfinite(found["ms"])


def test_a_renderer_that_fails_is_said_to_be_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PEERS, "Nobody", ("time_limits.nobody", {}))
    assert "No module named" in other("Nobody", tmp_path, TINY)["missing"]


def test_each_renderer_has_its_script() -> None:
    assert all(find_spec(f"torchrender.report.{module}") is not None for module, _ in PEERS.values())


@pytest.mark.parametrize("peer", ["Mitsuba", "Blender Cycles"])
def test_other_renderers_see_the_same_scene(peer: str, monkeypatch: pytest.MonkeyPatch) -> None:
    if find_spec("mitsuba" if peer == "Mitsuba" else "bpy") is None:  # never imported here: they change the process
        pytest.skip(f"{peer} is not installed")
    monkeypatch.setattr(time_limits, "PEERS", {peer: PEERS[peer]})
    record, pictures = compared("cornell_box", TINY)
    found = record["renderers"]
    assert found[peer]["limits"]["500"]["complete"] == 1.0
    mine, theirs = pictures[:192, -192:], pictures[192:, -192:]
    # They have indirect light: no darker anywhere on the whole, and bright and dark in the same places.
    more = (theirs - mine).mean(dim=(0, 1))
    assert float(more.min()) > -0.05 and float(more.max()) < 0.25
    # Of a sixteenth of the picture each, for half a second leaves noise in pixels; below the lamp, which they draw.
    means = [torch.nn.functional.avg_pool2d(one[48:].permute(2, 0, 1), 48).reshape(-1) for one in (mine, theirs)]
    assert float(torch.corrcoef(torch.stack(means))[0, 1]) > 0.8
