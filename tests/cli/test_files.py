"""Files with more than one picture in them, on the command line: what is drawn, and what is said."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import numpy as np
import pytest

from gltf_builder import Glb
from torchrender.cli import main as cli
from torchrender.cli import output
from torchrender.errors import ImageFileError, NotUsedWarning
from torchrender.images import files
from torchrender.images.files import read_image
from torchrender.scene.load import load


def run(*arguments: object) -> int:
    return cli.main([str(a) for a in arguments])


@pytest.fixture
def walking(tmp_path: Path) -> Path:
    """A triangle that moves to the right beside one that stands, with an extension of nobody."""
    glb = Glb(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [0, 3, 0]}], scenes=[{"nodes": [0, 1]}])
    glb.mesh()
    sampler = {"input": glb.accessor([0.0, 1.0]), "output": glb.accessor([[0.0, 0, 0], [4.0, 0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    glb.json["animations"] = [{"name": "Walk", "channels": [channel], "samplers": [sampler]}]
    glb.json["meshes"][0]["extensions"] = {"EXT_of_nobody": {}}
    return glb.write(tmp_path / "walking.glb")


def test_times_and_what_is_not_used(walking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pictures = {}
    for name, more in {"rest": (), "late": ("--time", 1, "--animation", "Walk")}.items():
        out = tmp_path / f"{name}.png"
        eye = ("--camera", "eye=2,2,9", "target=2,2,0")
        assert run("render", walking, "-o", out, "--size", "32x24", *eye, *more) == 0
        pictures[name] = read_image(out).numpy()
        said = capsys.readouterr().err
        assert said.count("not used: EXT_of_nobody (1)") == 1 and said.count("\n") == 1
    difference = np.abs(pictures["rest"] - pictures["late"]).max(axis=-1) > 0.02
    rows = difference.any(axis=1).nonzero()[0]
    assert len(rows) and rows.min() >= 12, "only the lower triangle moves"
    assert run("render", walking, "-o", tmp_path / "a.png", "--animation", "Fly") == 2
    assert "no animation 'Fly'; known: 'Walk'" in capsys.readouterr().err


@pytest.mark.parametrize(("seconds", "told"), [
    (1.5, "time 1.5: Walk goes from 0 to 1 s, its end is shown"),
    (-1, "time -1: Walk goes from 0 to 1 s, its start is shown"),
    (0, ""), (1, ""),
])  # fmt: skip
def test_times_beyond_an_animation_are_said(
    walking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], seconds: float, told: str
) -> None:
    """Of a file, and of a scene that names it."""
    scene = tmp_path / "scene.toml"
    scene.write_text(f'[[geometry]]\nfile = "walking.glb"\ntime = {seconds}\n')
    for named, more in ((walking, ("--time", seconds)), (scene, ())):
        assert run("render", named, "-o", tmp_path / "a.png", "--size", "16x12", *more) == 0
        said = capsys.readouterr().err
        assert (told in said) if told else (" is shown" not in said), named


def test_times_beyond_the_animation_of_a_built_in_scene_are_said() -> None:
    with pytest.warns(NotUsedWarning, match="time 1e\\+06: .* its end is shown"):
        load("walker", time=1e6)


def test_info_tells_what_was_read(walking: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", walking, "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert info["animations"] == {"Walk": 1.0} and info["not_used"] == ["EXT_of_nobody (1)"]
    assert "meshes (2)" in info["read"] and info["repaired"] == []


def test_flights_play_animations(walking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "frames"
    assert run("fly", walking, "-o", out, "--animate", "--frames", 4, "--fps", 4, "--size", "24x24") == 0
    records = json.loads((out / "statistics.json").read_text())
    assert len(records) == 4 and all(r["moved_ms"] >= 0 for r in records)
    assert run("fly", "cornell_box", "-o", out, "--animate", "--frames", 2, "--size", "24x24") == 2
    assert "--animate: cornell_box has no animation" in capsys.readouterr().err


def test_points_given_to_render_and_meshes_to_points(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = "".join(f"{x} {y} 0 255 0 0\n" for x in range(8) for y in range(8))
    head = "ply\nformat ascii 1.0\nelement vertex 64\n" + "".join(f"property float {n}\n" for n in "xyz")
    head += "".join(f"property uchar {n}\n" for n in ("red", "green", "blue")) + "end_header\n"
    (tmp_path / "points.ply").write_text(head + rows)
    assert run("render", tmp_path / "points.ply", "-o", tmp_path / "a.png", "--size", "32x32") == 0
    assert "holds points: drawn as by the command points" in capsys.readouterr().err
    assert float(read_image(tmp_path / "a.png")[..., 0].max()) > 0.5
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run("points", tmp_path / "a.obj", "-o", tmp_path / "b.png", "--size", "32x32") == 0
    assert "holds surfaces: sampled by 1,000,000 points" in capsys.readouterr().err


def test_points_are_packed_within_a_bound_of_memory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """To a file, or to a picture by way of one; and what faces away is drawn all the same, which is said."""
    head = "ply\nformat ascii 1.0\nelement vertex 400\n" + "".join(
        f"property float {n}\n" for n in ("x", "y", "z", "nx", "ny", "nz")
    )
    rows = "\n".join(f"{k % 20 / 20} {k // 20 / 20} 0 0 0 -1" for k in range(400))
    path = tmp_path / "away.ply"
    path.write_text(head + "end_header\n" + rows + "\n")
    assert run("points", path, "-o", tmp_path / "a.trp", "--memory", 128) == 0
    assert "400 points" in capsys.readouterr().out
    for name, more in (("a.png", ()), ("b.png", ("--memory", 128))):
        assert run("points", path, "-o", tmp_path / name, "--size", "32x32", *more) == 0
        assert "away.ply: all points face away: drawn from both sides" in capsys.readouterr().err
        assert float(read_image(tmp_path / name).max()) > 0.1
    assert run("points", path, "-o", tmp_path / "c.trp", "--memory", 1) == 2
    assert "--memory must be in [128.0" in capsys.readouterr().err
    assert sorted(f.name for f in tmp_path.iterdir()) == ["a.png", "a.trp", "away.ply", "b.png"]


def test_invalid_vertices_can_be_dropped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv nan 0 0\nf 1 2 3\nf 2 3 4\n")
    assert run("render", tmp_path / "a.obj", "-o", tmp_path / "a.png", "--size", "32x32") == 2
    assert "1 of 4 vertices are NaN or infinite" in capsys.readouterr().err
    assert run("render", tmp_path / "a.obj", "-o", tmp_path / "a.png", "--size", "32x32", "--drop-invalid") == 0
    assert "dropped with their faces (1)" in capsys.readouterr().err


def test_options_are_named_as_they_were_typed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run("render", tmp_path / "a.obj", "-o", tmp_path / "a.png", "--triangles", 5000) == 2
    assert "--triangles must be left out where a file is read" in capsys.readouterr().err


def test_photometric_lights_set_the_exposure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    glb = Glb(nodes=[{"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}])
    glb.mesh([[-5.0, -5, 0], [5.0, -5, 0], [0.0, 9, 0]])
    glb.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "directional", "intensity": 100000.0}]}}
    path = glb.write(tmp_path / "sun.glb")
    assert run("render", path, "-o", tmp_path / "a.png", "--size", "32x32") == 0
    assert "exposure auto" in capsys.readouterr().err
    assert 0.02 < float(read_image(tmp_path / "a.png")[16, 16].mean()) < 0.9
    assert run("render", path, "-o", tmp_path / "b.png", "--size", "32x32", "--exposure", 0) == 0
    assert float(read_image(tmp_path / "b.png")[16, 16].mean()) == 1.0


def test_long_steps_are_shown_to_who_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(output, "PATIENCE_S", 0.05)
    for stream, seen in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stderr", stream)
        with output.waiting("reading a.ply"):
            time.sleep(0.7)
        assert ("reading a.ply" in stream.getvalue()) == seen
    quick = Terminal()
    monkeypatch.setattr("sys.stderr", quick)
    monkeypatch.setattr(output, "PATIENCE_S", 5.0)
    with output.waiting("reading a.ply"):
        pass
    assert not quick.getvalue()


def test_shares_of_long_steps_are_shown_to_who_watches(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    for patience, stream, seen in ((0.0, Terminal(), True), (9.0, Terminal(), False), (0.0, io.StringIO(), False)):
        monkeypatch.setattr(output, "PATIENCE_S", patience)
        monkeypatch.setattr("sys.stderr", stream)
        with output.sharing("a.ply") as show:
            for share in (0.25, 0.5, 1.0):
                show("reading", share)
                time.sleep(0.15)
        assert ("a.ply: reading:  50%" in stream.getvalue()) == seen, stream.getvalue()


@pytest.mark.parametrize(
    "words",
    [
        ("render", "nothing.glb", "-o", "taken.png"),
        ("walkthrough", "nothing", "-o", "taken.trw"),
        ("walkthrough", "nothing", "-o", "a.trw", "--ply", "taken.ply"),
        ("style", "nothing.glb", "--photo", "nothing.png", "-o", "taken.glb"),
        ("style", "nothing.glb", "--photo", "nothing.png", "-o", "a.glb", "--sheet", "taken.png"),
        ("style", "nothing.glb", "--photo", "nothing.png", "--no-sheet", "-o", "taken.toml"),
        ("style", "nothing.glb", "--photo", "nothing.png", "--no-sheet", "-o", f"{260 * 'n'}.toml"),
        ("batch", "nothing.glb", "--orbit", "2", "-o", "file/out"),
        ("batch", "nothing.glb", "--orbit", "2", "-o", "file"),
        ("batch", "nothing.glb", "--orbit", "2", "--what", "film", "-o", "films"),
        ("depth", "nothing.glb", "-o", "file/out"),
        ("depth", "nothing.glb", "-o", "taken.npz"),
        ("fly", "nothing.glb", "-o", "file/deep/out"),
        ("fly", "nothing.glb", "-o", "taken.mp4"),
        ("voxelize", "nothing.glb", "-o", "taken.vox"),
        ("points", "nothing.ply", "-o", "taken.trp"),
    ],
)
def test_an_output_that_cannot_be_written_is_found_before_the_work(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also before the input, which is not there, is missed."""
    monkeypatch.chdir(tmp_path)
    for kind in ("png", "trw", "ply", "glb", "toml", "npz", "mp4", "vox", "trp"):
        Path(f"taken.{kind}").mkdir()
    Path("films/film.mp4").mkdir(parents=True)
    Path("file").write_text("")
    before = sorted(Path().rglob("*"))
    assert run(*words) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "error: " in said
    assert "cannot be written" in said or "is no folder" in said
    assert sorted(Path().rglob("*")) == before, "nothing is left behind"


@pytest.mark.parametrize("words", [("depth", "nothing.glb", "-o"), ("batch", "nothing.glb", "--orbit", "2", "-o")])
def test_folders_that_take_no_files_are_told(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: Path) -> None:
        raise ImageFileError(path, "cannot be written (Read-only file system)")

    monkeypatch.setattr(files, "check_writable", refuse)
    assert run(*words, tmp_path / "a" / "b") == 2
    assert f"{tmp_path} takes no files: it cannot be written (Read-only" in capsys.readouterr().err
