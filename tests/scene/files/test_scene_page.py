"""The page of scene files lists the keys that the reader takes, no more and no less, and its example is a scene."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch
from PIL import Image

from gltf_builder import Glb
from torchrender.scene.files.scene_file import load_scene_file
from torchrender.scene.files.toml_table import Table

PAGE = Path(__file__).resolve().parents[3] / "docs" / "scene-files.md"

EVERYTHING = """
[[material]]
name = "a"
[[geometry]]
file = "chair.glb"
translate = [0, 0, 0]
[[geometry]]
procedural = "cornell_box"
[environment]
file = "sky.png"
[[light]]
type = "point"
position = [0, 1, 0]
[[light]]
type = "spot"
position = [0, 1, 0]
target = [0, 0, 0]
[[light]]
type = "directional"
position = [0, 1, 0]
target = [0, 0, 0]
[[light]]
type = "directional"
direction = [0, 1, 0]
[[light]]
type = "rect"
corner = [0, 0, 0]
edge_u = [1, 0, 0]
edge_v = [0, 1, 0]
[[medium]]
low = [0, 0, 0]
high = [1, 1, 1]
[[camera]]
eye = [0, 0, 1]
target = [0, 0, 0]
view_height = 2
[[camera]]
eye = [0, 0, 1]
target = [0, 0, 0]
"""
SHAPES = {
    **dict.fromkeys(("box", "plane", "sphere", "cylinder", "cone", "torus"), ""),
    "quad": "corner = [0, 0, 0]\nedge_u = [1, 0, 0]\nedge_v = [0, 1, 0]\n",
}


def listed() -> dict[str, set[str]]:
    """Keys by table, out of the first columns of the page; the top of the file has no name."""
    found: dict[str, set[str]] = {}
    for part in PAGE.read_text().split("\n## ")[1:]:
        heading = re.match(r"`\[+(\w+)\]+`", part)
        cells = [line.split("|")[1] for line in part.splitlines() if line.startswith("| `")]
        found[heading[1] if heading else ""] = {key for cell in cells for key in re.findall(r"`(\w+)`", cell)}
    return found


def test_the_page_lists_what_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Image.new("RGB", (4, 2)).save(tmp_path / "sky.png")
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh()
    glb.write(tmp_path / "chair.glb")
    asked: dict[str, set[str]] = {}
    finish = Table.finish

    def note(table: Table) -> None:
        finish(table)
        asked.setdefault(re.sub(r"\[\d+\]", "", table.key), set()).update(table._asked)

    monkeypatch.setattr(Table, "finish", note)
    shapes = "".join(f'[[geometry]]\nshape = "{name}"\n{more}' for name, more in SHAPES.items())
    for text in (EVERYTHING + shapes, "[environment]\ncolor = 1\n"):
        (tmp_path / "scene.toml").write_text(text)
        load_scene_file(tmp_path / "scene.toml")
    assert listed() == asked


def test_the_example_is_a_scene(tmp_path: Path) -> None:
    example = re.search(r"```toml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    assert example is not None
    (tmp_path / "corner.toml").write_text(example[1])
    scene = load_scene_file(tmp_path / "corner.toml")
    assert (scene.name, len(scene.meshes), len(scene.lights), len(scene.media)) == ("corner", 3, 1, 1)
    floor, glass, lamp = scene.materials
    assert (floor.metallic, floor.roughness) == (0.0, pytest.approx(0.6)) and glass.metallic is None
    assert glass.blend and glass.opacity == pytest.approx(0.3)
    assert torch.equal(lamp.emission, torch.full((3,), 4.0))
