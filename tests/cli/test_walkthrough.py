"""The command ``torchrender walkthrough``, and the commands that take its files."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO

import numpy as np
import pytest
import torch
import trimesh

from torchrender.cli.main import main
from torchrender.images.files import read_image
from torchrender.numerics.color import luminance
from torchrender.points.load import load_points
from torchrender.scene.load import load
from torchrender.walkthrough.frames.json_file import write_json_sequence
from walkthrough_scenes import capture


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A capture as a folder with JSON, and what is built of it."""
    import cv2

    home = tmp_path_factory.mktemp("walk")
    entries = []
    sequence = capture(6, 96)
    for n, frame in enumerate(sequence.frames):
        cv2.imwrite(str(home / f"c{n}.png"), np.ascontiguousarray(frame.color[..., ::-1]))
        np.save(home / f"d{n}.npy", frame.depth)
        entries.append({"color": f"c{n}.png", "depth": f"d{n}.npy", "pose": frame.world_from_camera.tolist()})
    k = sequence.frames[0].intrinsics
    write_json_sequence(home / "walkthrough.json", entries, [k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    words = ["walkthrough", str(home), "-o", str(home / "room.trw"), "--hold-out", "3", "--n-min", "100"]
    exports = ["--glb", str(home / "room.glb"), "--ply", str(home / "room.ply"), "--trp", str(home / "room.trp")]
    with redirect_stdout(StringIO()) as out, redirect_stderr(StringIO()) as err:
        assert main([*words, *exports]) == 0
    (home / "said.txt").write_text(out.getvalue())
    (home / "progress.txt").write_text(err.getvalue())
    return home


def test_the_report_says_how_good_it_is(folder, capsys):
    said = (folder / "said.txt").read_text()
    for part in ("held out: 2 photos, PSNR", "% of the photos'", "kept after comparing", "next photo 1: eye="):
        assert part in said
    assert "compare density ..." in (folder / "progress.txt").read_text()
    words = ["walkthrough", str(folder), "-o", str(folder / "again.trw"), "--hold-out", "3", "--n-min", "100"]
    assert main([*words, "--json", "--next-views", "0"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["held_out"]["psnr_db"] > 20 and report["photos"] == 4


def test_exports_are_read_by_others(folder):
    scene = load(folder / "room.glb")
    assert len(scene.meshes) >= 4 and any(m.diffuse_texture is not None for m in scene.materials)
    # Photos hold their light already: lamps, also those of other programs, must not light them again.
    assert all(m.unlit for m in scene.materials) and scene.is_lit and not scene.photo_light
    assert len(trimesh.load(folder / "room.glb").geometry) == len(scene.meshes)
    cloud = load_points(folder / "room.ply")
    assert len(cloud) > 100 and cloud.radius is not None and cloud.color is not None
    assert main(["info", str(folder / "room.trp")]) == 0


def test_render_info_and_fly(folder, tmp_path, capsys):
    room = str(folder / "room.trw")
    picture = tmp_path / "a.png"
    assert (
        main(["render", room, "-o", str(picture), "--size", "80x60", "--camera", "frame1", "--supersample", "2"]) == 0
    )
    assert read_image(picture).shape == (60, 80, 3)
    said = capsys.readouterr()
    assert "points" in said.out and "supersample" not in said.err
    few = ["render", room, "-o", str(picture), "--size", "40x30", "--camera", "frame1", "--supersample"]
    assert main([*few, "0.5"]) == 0
    assert "--supersample 0.5: a walkthrough takes whole numbers of at least 1, here 1" in capsys.readouterr().err
    assert main([*few, "9"]) == 2
    assert "--supersample must be in" in capsys.readouterr().err
    assert main(["render", room, "-o", str(picture), "--size", "40x30", "--camera", "eye=0,1.5,-1", "--explain"]) == 0
    assert "--explain does nothing with a walkthrough" in capsys.readouterr().err
    words = ["--fog", "--enhance", "--time", "3", "--variant", "red", "--drop-invalid", "--shadows", "off"]
    assert main(["render", room, "-o", str(picture), "--size", "40x30", "--camera", "frame1", *words]) == 0
    said = capsys.readouterr().err
    assert all(word in said for word in words if word.startswith("--")) and "do nothing" in said and "size" not in said
    assert main(["info", room, "--time", "3", "--json"]) == 0
    assert "--time does nothing" in capsys.readouterr().err
    shown = {}
    for ev in ("-2", "auto"):
        words = ["render", room, "-o", str(tmp_path / "a.exr"), "--size", "80x60", "--camera", "frame1"]
        assert main([*words, "--exposure", ev]) == 0
        said = capsys.readouterr().out
        assert ("exposure" in said) == (ev == "auto")
        shown[ev] = read_image(tmp_path / "a.exr")
    light = luminance(torch.as_tensor(shown["auto"], dtype=torch.float64))
    assert float(torch.log2(light[light > 0]).mean()) == pytest.approx(math.log2(0.18), abs=0.01)
    ratio = (shown["auto"] / shown["-2"])[shown["-2"] > 1e-3]
    assert float(ratio.max() / ratio.min()) == pytest.approx(1.0, abs=1e-2), "one factor for the whole picture"
    assert main(["info", room, "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["planes"] >= 4 and info["held_out_psnr_db"] > 20
    assert main(["fly", room, "-o", str(tmp_path / "film"), "--frames", "3", "--size", "40x30"]) == 0
    assert len(list((tmp_path / "film").glob("frame_*.png"))) == 3


def test_serve_keeps_it_as_a_scene(folder, tmp_path):
    from torchrender.cli.serve import _keep

    name, _ = _keep(folder / "room.trw", tmp_path)
    assert (name, False) == _keep(folder / "room.trw", tmp_path)
    home = tmp_path / "scenes" / name
    facts = json.loads((home / "facts.json").read_text())
    assert facts["id"] == name and facts["bytes"] == (home / "scene.toml").stat().st_size
    scene = load(home / "scene.toml")
    assert float(scene.ambient.min()) == 1.0 and not scene.lights and "frame0" in scene.cameras


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["walkthrough", "missing", "-o", "a.trw"], "no such folder"),
        (["walkthrough", ".", "-o", "a.glb"], "must be .trw"),
        (["walkthrough", ".", "-o", "a.trw"], "known layout"),
        (["walkthrough", ".", "-o", "a.trw", "--intrinsics", "1,2"], "4 numbers"),
        (["walkthrough", ".", "-o", "a.trw", "--tau-z", "7"], "--tau-z must be in"),
        (["walkthrough", ".", "-o", "a.trw", "--next-views", "-1"], "next-views"),
        (["render", "missing.trw", "-o", "a.png"], "no such file"),
        (["fly", "missing.trw", "-o", "film", "--frames", "0"], "--frames"),
        (["serve", "room.glb"], "no such file"),
    ],
)
def test_wrong_words_are_named(words, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TORCHRENDER_DATA_DIR", str(tmp_path / "data"))
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_the_module_runs_from_a_shell(folder):
    command = [sys.executable, "-m", "torchrender.cli", "info", str(folder / "room.trw")]
    assert "planes" in subprocess.run(command, capture_output=True, text=True, check=True).stdout
