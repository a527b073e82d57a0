"""Files beside a scene file: nothing that somebody else made is written over."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

import torchrender as tr
from torchrender.scene.files.named import names_file


def box(**more: object) -> tr.Scene:
    return tr.Scene(meshes=(tr.Mesh.box(),), name="box", **more)  # type: ignore[arg-type]


def lit() -> tr.Scene:
    sky = tr.Environment(radiance=torch.ones(4, 8, 3), name="sky")
    low, high = torch.zeros(3), torch.ones(3)
    density = torch.ones(2, 2, 2)
    fog = tr.Medium(low=low, high=high, absorption=0.1, scattering=0.1, density=density)
    return box(environment=sky, media=(fog,))


@pytest.mark.parametrize("name", ["room.glb", "room_environment.exr", "room_density0.npy"])
def test_a_file_of_somebody_else_stays(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(b"mine")
    files = tr.write_scene(tmp_path / "room.toml", lit())
    assert (tmp_path / name).read_bytes() == b"mine"
    stem, dot, suffix = name.rpartition(".")
    assert tmp_path / f"{stem}_2{dot}{suffix}" in files and len(files) == 4
    again = tr.load(tmp_path / "room.toml")
    assert again.environment is not None and len(again.media) == 1 and len(again.meshes) == 1


def test_a_scene_from_the_model_beside_it(tmp_path: Path) -> None:
    """Lights and cameras that only the model has are still there."""
    camera = tr.Cameras.look_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), width=32, height=24)
    lamp = tr.PointLight(position=(0.0, 3.0, 0.0), intensity=5.0)
    tr.write_scene(tmp_path / "room.glb", box(cameras={"front": camera}, lights=(lamp,)))
    before = (tmp_path / "room.glb").read_bytes()
    for _ in range(2):
        files = tr.write_scene(tmp_path / "room.toml", tr.load(tmp_path / "room.glb"))
        assert [f.name for f in files] == ["room.toml", "room_2.glb"], "its own file is written anew"
        assert (tmp_path / "room.glb").read_bytes() == before
    assert len(tr.load(tmp_path / "room.toml").lights) == 1


def test_own_files_are_written_anew_until_somebody_changes_them(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    first = tr.write_scene(path, lit())
    other = replace(lit(), meshes=(tr.Mesh.sphere(segments=8),))
    assert tr.write_scene(path, other) == first and len(list(tmp_path.iterdir())) == 4
    assert tr.load(path).geometry.triangle_count == other.geometry.triangle_count
    with first[1].open("ab") as file:
        file.write(b" ")  # as an editor would
    changed = first[1].read_bytes()
    assert tr.write_scene(path, lit())[1].name == "a_2.glb" and first[1].read_bytes() == changed


def test_notes_that_are_none_are_passed_by(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"# beside: \xff\n# beside: abc no name\n")
    (tmp_path / "a.glb").write_bytes(b"mine")
    assert tr.write_scene(tmp_path / "a.toml", box())[1].name == "a_2.glb"


@pytest.mark.parametrize(
    ("text", "content", "named"),
    [
        ("a.toml", '[[geometry]]\nfile = "wood.png"', True),
        ("a.toml", 'file = "./wood.png"', True),
        ("a.toml", 'file = "other/wood.png"', False),
        ("a.toml", 'file = "../wood.png"', False),
        ("a.toml", 'file = "driftwood.png"', False),
        ("a.obj", "mtllib b.mtl\nv 0 0 0\n", True),
        ("a.toml", 'file = "b.mtl"', True),
        ("a.gltf", '{"images": [{"uri": "wood.png"}]}', True),
        ("a.glb", "wood.png", False),
        ("wood.png", "itself", True),
    ],
)
def test_files_that_a_scene_names(text: str, content: str, named: bool, tmp_path: Path) -> None:
    (tmp_path / "wood.png").write_bytes(b"png")
    (tmp_path / "b.mtl").write_text("newmtl a\nmap_Kd wood.png\n")
    (tmp_path / text).write_text(content)
    assert names_file(tmp_path / text, tmp_path / "wood.png") == named
    assert not names_file(tmp_path / "none.toml", tmp_path / "wood.png")


def test_names_of_addresses_and_of_other_folders(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    for name in ("old wood.png", "out/wood.png"):
        (tmp_path / name).write_bytes(b"png")
    (tmp_path / "a.gltf").write_text('{"images": [{"uri": "old%20wood.png"}, {"uri": "out/wood.png"}]}')
    assert names_file(tmp_path / "a.gltf", tmp_path / "old wood.png")
    assert names_file(tmp_path / "a.gltf", tmp_path / "out" / "wood.png")
    (tmp_path / "out" / "b.toml").write_text('file = "../a.gltf"')
    assert names_file(tmp_path / "out" / "b.toml", tmp_path / "old wood.png")
