"""The command line: what it writes, what it says, and that errors are one line and exit code 2."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import torchrender
from torchrender.cli import main as cli
from torchrender.cli.arguments import numbers
from torchrender.cli.plan import say_missed
from torchrender.cli.wishes import enhance_wish
from torchrender.depth.options import SamplingOptions
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.errors import OptionError
from torchrender.images.files import read_image
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.plan import Plan
from torchrender.points.select import SelectionOptions

ROOT = Path(__file__).resolve().parents[2]

OBJ = """
v -1 0 -1
v 1 0 -1
v 0 0 1
v 0 1.5 0
f 1 2 3
f 1 4 2
f 2 4 3
f 3 4 1
"""


@pytest.fixture
def obj(tmp_path: Path) -> Path:
    path = tmp_path / "never seen before.obj"
    path.write_text(OBJ)
    return path


def run(*arguments: object) -> int:
    return cli.main([str(a) for a in arguments])


def test_render_writes_a_picture_of_an_unknown_file(
    obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "out.png"
    assert run("render", obj, "-o", output, "--size", "64x48") == 0
    said = capsys.readouterr().out
    assert str(output) in said and "4 triangles" in said and "total" in said
    picture = read_image(output)
    assert picture.shape == (48, 64, 3)
    assert float(picture.std()) > 0.02


def test_render_takes_cameras_size_and_look(obj: Path, tmp_path: Path) -> None:
    output = tmp_path / "views.png"
    look = ("--supersample", 2, "--exposure", "auto", "--tone-map", "reinhard", "--background", "0,0,1", "--no-shadows")
    eyes = ("--camera", "eye=0,1,4", "target=0,0.5,0", "fov=40", "--camera", "eye=0,9,0 up=0,0,-1")
    assert run("render", obj, "-o", output, "--size", "32x32", *eyes, *look) == 0
    files = [tmp_path / "views_000.png", tmp_path / "views_001.png"]
    pictures = [read_image(file) for file in files]
    assert all(float(p[0, 0, 2]) > 0.2 and float(p[0, 0, 0]) == 0.0 for p in pictures)
    assert not output.exists()


def test_render_size_of_a_procedural_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("render", "nest", "--triangles", 5000, "-o", tmp_path / "n.npz", "--size", "40x30") == 0
    count = int(capsys.readouterr().out.split(" triangles")[0].split()[-1].replace(",", ""))
    assert abs(count - 5000) <= 500
    with np.load(tmp_path / "n.npz") as data:
        assert data["radiance"].shape == (1, 30, 40, 3)


def test_info(obj: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", obj) == 0
    said = capsys.readouterr().out
    assert "triangles" in said and "warning: no light" in said
    assert run("info", obj, "--json") == 0
    assert json.loads(capsys.readouterr().out)["triangles"] == 4


def test_depth_as_npz(obj: Path, tmp_path: Path) -> None:
    assert run("depth", obj, "--views", 3, "--size", "32x24", "-o", tmp_path / "d.npz") == 0
    with np.load(tmp_path / "d.npz") as data:
        assert data["depth"].shape == data["triangle"].shape == data["object_id"].shape == (3, 24, 32)
        assert data["camera_from_world"].shape == (3, 4, 4)
        assert ((data["triangle"] >= 0) == np.isfinite(data["depth"])).all()
        assert (data["triangle"] >= 0).any()


@pytest.mark.parametrize("form", ["folder", "views.exr"])
def test_depth_as_exr(form: str, obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("depth", obj, "--views", 2, "--size", "32x24", "-o", tmp_path / form) == 0
    files = [Path(line) for line in capsys.readouterr().out.split("\n") if line]
    cameras = json.loads(files[-1].read_text())
    assert [f.name for f in files[:-1]] == cameras["files"]
    assert len(files) == 3 and all(f.is_file() for f in files)
    assert cameras["image_size"] == [32, 24]
    assert cameras["far"] == [None, None]


def test_scenes_lists_the_built_in_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("scenes") == 0
    assert "living_room" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["render", "no_such_scene", "-o", "a.png"], "no_such_scene"),
        (["render", "missing.glb", "-o", "a.png"], "missing.glb"),
        (["render", "nest", "-o", "a.jpg"], ".png"),
        (["render", "nest", "-o", "nowhere/a.png"], "nowhere"),
        (["render", "nest", "-o", "a.png", "--size", "10"], "--size"),
        (["render", "nest", "-o", "a.png", "--size", "0x5"], "--size"),
        (["render", "nest", "-o", "a.png", "--exposure", "bright"], "--exposure"),
        (["render", "nest", "-o", "a.png", "--background", "1,2"], "--background"),
        (["render", "nest", "--triangles", "3000", "-o", "a.png", "--camera", "eye=1,2"], "--camera eye"),
        (["render", "nest", "--triangles", "3000", "-o", "a.png", "--camera", "zoom=2"], "zoom"),
        (["render", "nest", "--triangles", "3000", "-o", "a.png", "--camera", "target=0,0,0"], "eye=x,y,z"),
        (["render", "nest", "--triangles", "3000", "-o", "a.png", "--camera", "balcony"], "balcony"),
        (["render", "nest", "--triangles", "3000", "-o", "a.png", "--camera", "eye=0,1,4 fov=200"], "--camera fov"),
        (["render", "nest", "--triangles", "1", "-o", "a.png"], "triangles"),
        (["depth", "nest", "--triangles", "3000", "-o", "a.npz", "--views", "0"], "--views must be in [1, 4096]"),
        (["depth", "nest", "-o", "a.png"], ".npz"),
        (["--threads", "0", "scenes"], "--threads"),
        (["render", "cornell_box", "-o", "a.png", "--enhance", "5"], "--enhance gradient_weight must be in [-1"),
        (["render", "cornell_box", "-o", "a.png", "--enhance", "step=-1"], "--enhance step must be in"),
        (["render", "cornell_box", "-o", "a.png", "--camera", "eye=1,2,3 fov=500"], "--camera fov must be in"),
        (["render", "cornell_box", "-o", "a.png", "--camera", "eye=1,2,3 near=-1"], "--camera near must be > 0"),
        (["batch", "cornell_box", "-o", "out", "--orbit", "2", "--shadow-size", "3"], "--shadow-size must be in"),
    ],
)
def test_errors_are_one_line_with_exit_code_2(
    arguments: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("torchrender: error: ") and error.count("\n") == 1
    assert said in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["render"], "the following arguments are required: SCENE, -o/--output; see torchrender render --help"),
        (["render", "nest", "-o", "a.png", "--shadows", "soft"], "argument --shadows: invalid choice: 'soft'"),
        (["fly", "nest", "-o", "a", "--frames", "many"], "argument --frames: invalid int value: 'many'"),
        (["draw"], "invalid choice: 'draw'"),
        (["scenes", "--fast"], "unrecognized arguments: --fast; see torchrender --help"),
    ],
)
def test_words_that_no_command_has_are_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        cli.main(words)
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.startswith("torchrender: error: ") and error.count("\n") == 1
    assert said in error


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("", "got an empty one"),
        (".", "is a folder"),
        ("a.xyz", ".trw (walkthroughs), .trp (points)"),
        ("a/b", "no such"),
    ],
)
def test_what_is_no_scene_is_told(name: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["info", name]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_a_missed_wish_is_one_line(obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["render", str(obj), "-o", str(tmp_path / "a.png"), "--size", "48x32"]
    for wishes, told in (
        (["--budget-ms", "0.001"], "a budget of 0.001 ms"),
        (["--budget-ms", "0.001", "--max-error", "0.0001"], "0.001 ms"),
        (["--max-error", "0"], "no settings reach an error of 0"),
        (["--budget-ms", "1e6"], ""),
        ([], ""),
    ):
        assert cli.main([*words, *wishes]) == 0
        lines = [line for line in capsys.readouterr().err.splitlines() if "budget" in line or "error" in line]
        assert len(lines) == bool(told) and all(told in line for line in lines), wishes


def test_a_picture_that_took_longer_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    for taken, told in ((100.0, False), (109.0, False), (111.0, True)):
        say_missed(Plan(rows=(), options=RenderOptions(), budget_ms=100.0, measured_ms=taken))
        assert ("took 111 ms, its budget was 100 ms" in capsys.readouterr().err) == told


def test_image_size_and_numbers() -> None:
    assert cli.image_size("640x480") == (640, 480)
    assert cli.image_size("32768x8192") == (32768, 8192)
    for wrong in ("32769x1", "0x5", "32768x8193", "9" * 5000 + "x5"):
        with pytest.raises(OptionError, match="--size must have sides of 1 to 32768 pixels, and 268,435,456 pixels at"):
            cli.image_size(wrong)
    with pytest.raises(OptionError, match="--size must look like 1024x768, got '1e9x5'"):
        cli.image_size("1e9x5")
    assert numbers("x", "1,-2.5,3e1", 3) == [1.0, -2.5, 30.0]
    for wrong in ("nan,0,0", "1,2,3,4", "", "1;2;3", "inf,0,0"):
        with pytest.raises(OptionError, match="x must be 3 numbers"):
            numbers("x", wrong, 3)


def fresh(code: str, **environment: str) -> str:
    clean = {k: v for k, v in os.environ.items() if not k.startswith("OMP_")}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=clean | environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_importing_the_package_and_its_command_line_loads_nothing_heavy() -> None:
    code = (
        "import sys, torchrender.cli.main; print([m for m in ('torch', 'numpy', 'numba', 'cv2') if m in sys.modules])"
    )
    assert fresh(code) == "[]"


def test_thread_settings_are_made_before_torch_is_imported() -> None:
    code = "import os, sys; from torchrender.cli import main as cli; cli.set_up_threads(1);"
    code += " assert 'torch' not in sys.modules;"
    code += " import torch; print(os.environ['OMP_WAIT_POLICY'], torch.get_num_threads())"
    assert fresh(code) == "PASSIVE 1"


def test_public_names_exist_and_are_listed() -> None:
    for name in torchrender.__all__:
        assert getattr(torchrender, name) is not None
    assert set(torchrender.__all__) == {*torchrender._HOME, "__version__"}
    assert set(torchrender.__all__) <= set(dir(torchrender))
    with pytest.raises(AttributeError, match="no attribute 'rendr'"):
        _ = torchrender.rendr  # type: ignore[attr-defined]


def test_version_is_the_one_of_the_project_file(capsys: pytest.CaptureFixture[str]) -> None:
    declared = re.search(r'^version = "(.+)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    assert declared is not None and torchrender.__version__ == declared[1]
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0
    assert torchrender.__version__ in capsys.readouterr().out


@pytest.mark.parametrize("redundancy", ["pixel", "visibility"])
def test_depth_pictures_of_sample_kinds(redundancy: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--method", "nonredundant", "--redundancy", redundancy, "--views", 2, "--size", "32x32", "--show"]
    assert run("depth", "nest", "--triangles", 3000, *options, "-o", tmp_path / "out") == 0
    said = capsys.readouterr().out
    assert "redundant 0.0 %" in said
    assert sorted(p.name for p in (tmp_path / "out").glob("*.png")) == ["kinds_000.png", "kinds_001.png"]
    assert run("depth", "nest", "--triangles", 3000, *options[:-1], "-o", tmp_path / "set.npz") == 0
    with np.load(tmp_path / "set.npz") as data:
        assert data["layer"].max() >= 1
        assert data["normal"].shape == (2, 32, 32, 3)
        assert not data["truncated"].any()


def test_defaults_that_help_names_are_those_of_the_options(capsys: pytest.CaptureFixture[str]) -> None:
    """The command line holds no defaults of its own for these: its words must not drift from what happens."""
    owners = {
        "render": (RenderOptions(), ("supersample", "exposure", "tone_map", "reflections")),
        "depth": (SamplingOptions(), ("method", "redundancy")),
        "fly": (ReuseOptions(), ("key_frame_threshold",)),
        "points": (SelectionOptions(), ("coarse_radius",)),
    }
    flags = {"key_frame_threshold": "threshold", "coarse_radius": "radius"}
    for command, (options, names) in owners.items():
        with pytest.raises(SystemExit):
            cli.main([command, "--help"])
        words = " ".join(capsys.readouterr().out.split())
        for name in names:
            value = getattr(options, name)
            flag = f"--{flags.get(name, name).replace('_', '-')}"
            text = words[words.rindex(flag) :]
            said = re.search(r"default ([\w.]+)", text)
            assert said is not None, flag
            assert said[1].rstrip(".") == (value if isinstance(value, str) else f"{value:g}"), flag


def test_fog_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plain, foggy, off = (tmp_path / f"{name}.npz" for name in ("plain", "foggy", "off"))
    size = ["--size", "32x24"]
    assert cli.main(["render", "cornell_box", "-o", str(plain), *size]) == 0
    fog = ["--fog", "scattering=1.5 height=0.3 asymmetry=0.2", "--explain"]
    assert cli.main(["render", "cornell_box", "-o", str(foggy), *size, *fog]) == 0
    assert "1 medium in view" in capsys.readouterr().out
    assert cli.main(["render", "cornell_box", "-o", str(off), *size, "--fog", "off"]) == 0
    light = [np.load(file)["radiance"] for file in (plain, foggy, off)]
    assert np.abs(light[1] - light[0]).mean() > 0.01 and np.array_equal(light[2], light[0])
    for wrong, word in (
        ("thick", "name=number, such as --fog 'scattering=0.3 height=2', got 'thick'"),
        ("0.3", "name=number, such as --fog 'scattering=0.3', got '0.3'"),
        ("scatering=1", "no 'scatering'"),
        ("scattering=x", "--fog scattering"),
    ):
        assert cli.main(["render", "cornell_box", "-o", str(off), *size, "--fog", wrong]) == 2
        assert word in capsys.readouterr().err


def test_fog_that_is_seen_from_outside_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["render", "cornell_box", "-o", str(tmp_path / "a.png"), "--size", "16x12", "--fog"]
    assert cli.main(words) == 0
    assert "from outside" not in capsys.readouterr().err, "alone: a thin one, and the scene's camera stands in it"
    assert cli.main([*words, "--camera", "eye=0.3,0.3,-3"]) == 0
    assert "view 0 looks at the fog from outside: it fills a box around the scene, from (" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["voxelize", "cornell_box", "-o", "a.npz", "--resolution", "0"], "--resolution must be in [1, 2048], got 0"),
        (["spheres", "cornell_box", "-o", "a.npz", "--resolution", "0"], "--resolution must be in [8, 256], got 0"),
        (["batch", "cornell_box", "-o", "out", "--orbit", "0"], "--orbit must be >= 1, got 0"),
        (["batch", "cornell_box", "-o", "out", "--path", "orbit", "--frames", "0"], "--frames must be >= 1, got 0"),
        (["fly", "cornell_box", "-o", "out", "--frames", "-1"], "--frames must be >= 1, got -1"),
    ],
)
def test_counts_are_told_by_their_flag(
    words: list[str], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("depth", "cornell_box", "-o", "a.npz", "--views", "0"), "--views must be in [1, 4096]"),
        (("render", "cornell_box", "-o", "a.png", "--triangles", "-5"), "--triangles must be in"),
        (("render", "cornell_box", "-o", "a.png", "--shadow-size", "7"), "--shadow-size must be"),
        (("render", "cornell_box", "-o", "a.png", "--supersample", "99"), "--supersample must be in"),
        (("render", "cornell_box", "-o", "a.png", "--exposure", "wat"), '--exposure must be a number (EV) or "auto"'),
        (("fly", "cornell_box", "-o", "a.gif", "--threshold", "7"), "--threshold must be in"),
    ],
)
def test_errors_name_the_option(
    words: tuple[str, ...],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(*words) == 2
    assert capsys.readouterr().err.startswith(f"torchrender: error: {told}")


def test_flags_of_enhancement_are_yes_or_no() -> None:
    flags = [field.name for field in fields(EnhanceOptions) if isinstance(field.default, bool)]
    for name in flags:
        made = enhance_wish(f"{name}=yes")
        assert made is not None
        assert getattr(made, name) is True
        with pytest.raises(OptionError, match=f"--enhance {name} must be yes or no"):
            enhance_wish(f"{name}=1")


def test_what_a_file_holds_does_not_reach_the_terminal_as_it_is(tmp_path, capsys):
    file = tmp_path / "noise.obj"
    file.write_bytes(b"v 0 0 0\nf \x1b[2J\x07 \x9b1m 2 3\n")
    assert cli.main(["info", str(file)]) == 2
    said = capsys.readouterr().err
    assert said.startswith("torchrender: error: ") and said.endswith("\n") and "\\x1b" in said
    assert said[:-1].isprintable()


@pytest.mark.parametrize("error", [MemoryError("no room"), RuntimeError("DefaultCPUAllocator: can't allocate memory")])
def test_memory_that_ran_out_is_told_in_one_line(
    error: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> None:
        raise error

    monkeypatch.setitem(cli._COMMANDS, "scenes", fail)
    assert cli.main(["scenes"]) == 2
    assert capsys.readouterr().err == f"torchrender: error: out of memory: {error}\n"
    monkeypatch.setitem(cli._COMMANDS, "scenes", lambda _: (_ for _ in ()).throw(RuntimeError("a fault")))
    with pytest.raises(RuntimeError, match="a fault"):
        cli.main(["scenes"])
