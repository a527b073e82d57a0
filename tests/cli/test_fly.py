"""``torchrender fly``: frames or a film, with statistics."""

from __future__ import annotations

import json

import pytest

from torchrender.cli.fly import _plot
from torchrender.cli.main import main
from torchrender.images.files import read_image

SMALL = ["fly", "washroom", "--triangles", "7500", "--size", "40x30", "--frames", "4"]


def test_frames_and_statistics(tmp_path, capsys) -> None:
    out = tmp_path / "frames"
    assert main([*SMALL, "-o", str(out)]) == 0
    files = sorted(out.glob("frame_*.png"))
    assert len(files) == 4 and tuple(read_image(files[0]).shape) == (30, 40, 3)
    assert not bool((read_image(files[0]) == read_image(files[-1])).all())
    records = json.loads((out / "statistics.json").read_text())
    assert [r["frame"] for r in records] == [0, 1, 2, 3]
    assert records[0]["key_frame"] and records[0]["reused_share"] == 0.0
    assert all(0.0 <= r["reused_share"] <= 1.0 and r["ms"] > 0 and r["reflective"] > 0 for r in records)
    assert (out / "statistics.png").stat().st_size > 1000
    assert "reused" in capsys.readouterr().out


def test_a_film(tmp_path) -> None:
    import cv2

    out = tmp_path / "walk.mp4"
    assert main([*SMALL, "-o", str(out), "--path", "walk2", "--seed", "2", "--size", "41x31"]) == 0
    film = cv2.VideoCapture(str(out))
    shapes = []
    while True:
        good, picture = film.read()
        if not good:
            break
        shapes.append(picture.shape)
    assert shapes == [(30, 40, 3)] * 4  # even sides
    assert len(json.loads((tmp_path / "walk_statistics.json").read_text())) == 4
    assert {p.name for p in tmp_path.iterdir()} == {"walk.mp4", "walk_statistics.json", "walk_statistics.png"}


def test_without_reuse_and_along_a_file(tmp_path) -> None:
    poses = {"pose": [{"eye": [0, 1, 3.5], "target": [0, 1, 0]}, {"eye": [0.2, 1, 3.4], "target": [0, 1, 0]}]}
    (tmp_path / "p.json").write_text(json.dumps(poses))
    words = ["fly", "cornell_box", "--frames", "2", "--size", "24x24", "--path", str(tmp_path / "p.json")]
    assert main([*words, "--no-reuse", "-o", str(tmp_path / "out")]) == 0
    records = json.loads((tmp_path / "out" / "statistics.json").read_text())
    assert len(records) == 2 and "reused_share" not in records[0]


def test_objects_along_paths(tmp_path) -> None:
    poses = "[[pose]]\noffset = [0, 0, 0]\n[[pose]]\noffset = [0, 0.3, 0]\nturn = 90\n"
    (tmp_path / "up.toml").write_text(poses)
    words = ["fly", "cornell_box", "--frames", "2", "--size", "24x24", "--path", "orbit"]
    moves = ["--move", "short box=0.1,0,0.1,45", "--move", f"tall box={tmp_path / 'up.toml'}"]
    for name, more in (("still", []), ("moved", moves)):
        assert main([*words, *more, "-o", str(tmp_path / name)]) == 0
    first, last = ([read_image(tmp_path / name / f"frame_{k:04d}.png") for name in ("still", "moved")] for k in (0, 1))
    assert bool((first[0] == first[1]).all()) and not bool((last[0] == last[1]).all())
    assert all(r["moved_ms"] > 0 for r in json.loads((tmp_path / "moved" / "statistics.json").read_text()))


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["-o", "film.mov"], ".mp4"),
        (["-o", "none/film.mp4"], "does not exist"),
        (["-o", "out", "--path", "nowhere"], "walk1"),
        (["-o", "out", "--path", "none.toml"], "none.toml"),
        (["-o", "out", "--frames", "0"], "frames"),
        (["-o", "out", "--fps", "0"], "--fps"),
        (["-o", "out", "--move", "nobody=0,0,1"], "has no mesh 'nobody'"),
        (["-o", "out", "--move", "0,0,1"], "NAME=X,Y,Z"),
        (["-o", "out", "--move", "basin=0,1"], "--move"),
        (["-o", "out", "--move", "basin=none.toml"], "none.toml"),
        (["-o", "out", "--threshold", "2"], "--threshold must be in"),
        (["-o", "out", "--size", "0x3"], "--size"),
        (["-o", "film.mp4", "--size", "1x1"], "2x2"),
    ],
)
def test_wrong_input_is_one_line(words, named, tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(tmp_path)
    assert main([*SMALL, *words]) == 2
    assert named in capsys.readouterr().err
    assert not list(tmp_path.glob("*.mp4"))


@pytest.mark.parametrize("count", [2, 40])
def test_plots_show_every_time(count, tmp_path, monkeypatch) -> None:
    from matplotlib.figure import Figure

    drawn: list[Figure] = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    records = [{"frame": k, "ms": 3000.0 if k == 0 else 120.0 + k} for k in range(count)]
    if count > 2:
        records = [r | {"reused_share": 0.8, "key_frame": r["frame"] == 0} for r in records]
    _plot(tmp_path / "a.png", records)
    (figure,) = drawn
    assert len(figure.axes) == (1 if count == 2 else 2), "nothing empty"
    low, high = figure.axes[0].get_ylim()
    assert low <= 121.0 and high >= 3000.0
    assert figure.axes[0].lines[0].get_marker() == ".", "a few frames are points"
