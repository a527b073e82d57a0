"""Commands and files that were there before them: what is read stays, what an earlier run left over goes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import torchrender as tr
from torchrender.cli import main as cli
from torchrender.cli.arguments import Parser, set_up_threads
from torchrender.cli.output import Terminated, ending_when_told
from torchrender.errors import ImageFileError, OptionError
from torchrender.images import files, film

POSES = {"pose": [{"eye": [0, 1, 3.5], "target": [0, 1, 0]}, {"eye": [0.2, 1, 3.4], "target": [0, 1, 0]}]}
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    tr.write_scene("room.glb", tr.Scene(meshes=(tr.Mesh.box(),), name="room"))
    Path("room.toml").write_text('[[geometry]]\nfile = "room.glb"\n')
    Path("a.obj").write_text("mtllib a.mtl\nusemtl a\n" + TRIANGLE)
    Path("a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    for name in ("a.png", "photo.png", "photo_000.png"):
        files.write_image(name, tr.Cameras.look_at((0.0, 0, 1), (0.0, 0, 0), width=4, height=4).near.expand(4, 4, 3))
    for name in ("p.json", "film_statistics.json"):
        Path(name).write_text(json.dumps(POSES))
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ("render", "a.obj", "-o", "a.png"),
        ("style", "room.glb", "--photo", "photo.png", "-o", "room.glb"),
        ("style", "room.toml", "--photo", "photo.png", "-o", "room.glb"),
        ("style", "room.glb", "--photo", "photo.png", "-o", "new.glb", "--sheet", "photo.png"),
        ("fly", "cornell_box", "--path", "film_statistics.json", "-o", "film.mp4"),
        ("fly", "cornell_box", "--move", "tall box=film_statistics.json", "-o", "film.mp4"),
        ("fog", "photo.png", "--depth", "photo_000.png", "-o", "photo.png"),
        ("fog", "photo.png", "--depth", "photo_000.png", "-o", "b.png", "--write-depth", "photo_000.png"),
    ],
)
def test_what_a_command_reads_is_not_written_over(
    words: tuple[str, ...], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path.name: path.read_bytes() for path in here.iterdir()}
    assert cli.main(list(words)) == 2
    said = capsys.readouterr().err
    assert "is read by this command, too: give another output" in said and said.count("\n") == 1
    assert {path.name: path.read_bytes() for path in here.iterdir()} == before


@pytest.mark.usefixtures("here")
def test_a_flight_leaves_its_path_and_pictures_alone() -> None:
    files.write_image("p.png", tr.load("cornell_box").ambient.expand(4, 4, 3))
    before = {name: Path(name).read_bytes() for name in ("p.json", "p.png")}
    words = ["fly", "cornell_box", "--frames", "2", "--size", "24x24", "--path", "p.json", "-o", "p.mp4"]
    assert cli.main(words) == 0
    assert {name: Path(name).read_bytes() for name in before} == before
    assert len(json.loads(Path("p_statistics.json").read_text())) == 2


def test_help_names_by_products(capsys: pytest.CaptureFixture[str]) -> None:
    told = {"fly": ("film_statistics.json", "film_statistics.png"), "spheres": ("set_spheres.png",)}
    told |= {"depth": ("OUT_cameras.json", "OUT_kinds.png"), "style": ("OUTPUT_sheet.png",)}
    for command, names in told.items():
        with pytest.raises(SystemExit):
            cli.main([command, "--help"])
        said = capsys.readouterr().out
        assert all(name in said for name in names), command


def test_frames_of_a_longer_flight_go_and_those_of_others_stay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "frames"
    words = ["fly", "cornell_box", "--path", "orbit", "--size", "16x16", "-o", str(out)]
    assert cli.main([*words, "--frames", "4"]) == 0
    (out / "frame_0009.png").write_bytes(b"mine")
    assert cli.main([*words, "--frames", "2"]) == 0
    names = sorted(path.name for path in out.glob("frame_*"))
    assert names == ["frame_0000.png", "frame_0001.png", "frame_0009.png"]
    assert "1 more frames, from number 2 on, that are not of this film" in capsys.readouterr().err
    (out / "statistics.json").write_text('{"frame": 7}')
    before = {path.name: path.read_bytes() for path in out.iterdir()}
    assert cli.main([*words, "--frames", "1"]) == 2, "statistics of somebody else are none"
    assert "frame_0000.png: is there, and no flight made it: give another folder" in capsys.readouterr().err
    for path in out.glob("frame_000[01].png"):
        path.unlink()
    assert cli.main([*words, "--frames", "1"]) == 2
    assert "statistics.json: is there, and no flight made it" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in out.iterdir()}.items() <= before.items()


def test_a_flight_that_was_stopped_is_flown_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "frames"
    words = ["fly", "cornell_box", "--path", "orbit", "--size", "16x16", "-o", str(out)]
    usual, count = film.write_image, iter(range(9))

    def stopped(path: Path, picture: Any) -> None:
        if next(count) == 2:
            raise KeyboardInterrupt
        usual(path, picture)

    with monkeypatch.context() as patch:
        patch.setattr(film, "write_image", stopped)
        assert cli.main([*words, "--frames", "4"]) == 130
    assert {path.name for path in out.iterdir()} == {"frame_0000.png", "frame_0001.png", "statistics.json"}
    assert cli.main([*words, "--frames", "1"]) == 0
    assert [path.name for path in out.glob("frame_*")] == ["frame_0000.png"]
    assert json.loads((out / "statistics.json").read_text())[0]["ms"] > 0


def test_cameras_of_somebody_else_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cameras.json").write_text('{"files": ["photo.png"]}')
    assert cli.main(["depth", "cornell_box", "--size", "8x8", "-o", str(tmp_path)]) == 2
    assert "cameras.json: is there, and not of an earlier run" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["cameras.json"]
    (tmp_path / "film.mp4").write_bytes(b"mine")
    assert cli.main(["batch", "cornell_box", "--orbit", "2", "--what", "film", "-o", str(tmp_path)]) == 2
    assert "holds film.mp4 that no batch made" in capsys.readouterr().err


@pytest.mark.parametrize("output", ["out", "out.exr"])
def test_depth_images_of_a_larger_run_go(output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["depth", "cornell_box", "--size", "16x16", "-o", output]
    assert cli.main([*words, "--views", "3", "--show"]) == 0
    folder = Path("out") if output == "out" else Path()
    (folder / "depth_007.exr").write_bytes(b"mine")
    assert cli.main([*words, "--views", "2"]) == 0
    stem = "depth" if output == "out" else "out"
    cameras = "cameras.json" if output == "out" else "out_cameras.json"
    wanted = {f"{stem}_000.exr", f"{stem}_001.exr", cameras, "depth_007.exr"}
    assert {path.name for path in folder.iterdir()} == wanted


@pytest.mark.parametrize("words", [("depth", "--views", "2", "-o"), ("fly", "--frames", "2", "-o")])
def test_a_folder_for_nothing_is_not_left(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(temporary: Path, *_: Any, **__: Any) -> None:
        temporary.write_bytes(b"begun")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "write_exr", full)
    monkeypatch.setattr("PIL.Image.Image.save", lambda _picture, path, **_more: full(path))
    assert cli.main([words[0], "cornell_box", "--size", "8x8", *words[1:], str(tmp_path / "new" / "out")]) == 2
    assert "No space left" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_folder_that_was_there_stays(tmp_path: Path) -> None:
    with pytest.raises(KeyError), files.new_folder(tmp_path / "a" / "b"):
        (tmp_path / "a" / "kept").write_text("")
        raise KeyError
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "kept"]
    (tmp_path / "file").write_text("")
    with pytest.raises(ImageFileError), files.new_folder(tmp_path / "file" / "b"):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_sigterm_leaves_nothing_half_written(tmp_path: Path) -> None:
    """A command that is told to end while its film is being written."""
    code = "from torchrender.cli.__main__ import run; run()"
    words = ["fly", "cornell_box", "--frames", "100000", "--size", "32x32", "-o", str(tmp_path / "film.mp4")]
    process = subprocess.Popen([sys.executable, "-c", code, *words], stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while not list(tmp_path.glob(".*.mp4")) or not any(path.stat().st_size for path in tmp_path.glob(".*.mp4")):
        assert process.poll() is None and time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGTERM)
    said = process.communicate(timeout=60)[1]
    assert process.returncode == 143 and said.splitlines()[-1] == "torchrender: terminated"
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_who_handles_sigterm_goes_on_doing_so() -> None:
    def mine(*_: object) -> None:
        pass

    usual = signal.getsignal(signal.SIGTERM)
    try:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        with pytest.raises(Terminated), ending_when_told("render"):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(1.0)
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        with ending_when_told("serve"):
            assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        signal.signal(signal.SIGTERM, mine)
        with ending_when_told("render"):
            assert signal.getsignal(signal.SIGTERM) is mine
    finally:
        signal.signal(signal.SIGTERM, usual)


def test_values_that_begin_with_a_minus() -> None:
    parser = Parser()
    parser.add_argument("--background")
    parser.add_argument("--size")
    parser.add_argument("-o", "--output")
    found = parser.parse_args(["--background", "-1,0,0", "--size", "-5x10", "-o", "a"])
    assert (found.background, found.size, found.output) == ("-1,0,0", "-5x10", "a")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("render", "cornell_box", "-o", "a.png", "--size", "-5x10"), "--size must look like 1024x768, got '-5x10'"),
        (("render", "cornell_box", "-o", "a.png", "--background", "-1,0,0"), "background must not be negative"),
        (("--threads", "100000", "scenes"), "--threads must be in [1, 1024], got 100000"),
        (("--threads", "0", "scenes"), "--threads must be in [1, 1024], got 0"),
        (("tradeoff", "cornell_box", "--seconds", "nan"), "--seconds must be >= 0, got nan"),
        (("tradeoff", "cornell_box", "--seconds", "-1"), "--seconds must be >= 0, got -1.0"),
        (("depth", "cornell_box", "-o", "d", "--size", "8x8", "--views", "1000000"), "--views must be in [1, 4096]"),
        (("depth", "cornell_box", "-o", "d", "--size", "9999x9999", "--views", "50"), "more than 1,073,741,824 pixels"),
        (("render", "cornell_box", "-o", "a.png", "--enhance", "terms="), "terms must name at least one of geometry"),
        (("render", "cornell_box", "-o", "a.png", "--camera", "eye=0,1,3", "up=0,0,0"), "up must not be 0, 0, 0"),
    ],
)
def test_what_has_a_limit_is_told(
    words: tuple[str, ...],
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(list(words)) == 2
    said = capsys.readouterr().err
    assert told in said and said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_threads_within_the_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    set_up_threads(7)
    assert os.environ["OMP_NUM_THREADS"] == "7"
    with pytest.raises(OptionError):
        set_up_threads(1025)
