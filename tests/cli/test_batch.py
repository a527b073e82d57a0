"""The command ``batch``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.batch.local import Outcome
from torchrender.batch.work import ChunkMaker
from torchrender.cli.main import main


@pytest.fixture
def inside(monkeypatch: pytest.MonkeyPatch):
    """Chunks are made in this process."""
    jobs = []

    def run(job, folder, *, workers=None, tell=None):
        jobs.append((job, workers))
        scene = job.scene.load()
        Path(folder).mkdir(exist_ok=True)
        for chunk in range(job.chunks):
            ChunkMaker(scene, job, Path(folder)).make(chunk)
        tell(len(job.cameras), len(job.cameras))
        return Outcome(len(job.cameras), len(job.cameras), {}, 0)

    monkeypatch.setattr("torchrender.batch.local.run", run)
    return jobs


def batch(*words: object) -> int:
    return main(["batch", "cornell_box", "--size", "24x16", *map(str, words)])


def test_one_bad_row_is_named_counted_and_told_by_the_exit_code(inside, tmp_path, capsys) -> None:
    row = {"eye": [0.0, 1.0, 3.0], "target": [0.0, 1.0, 0.0], "roll": 3}
    (tmp_path / "cameras.json").write_text(json.dumps([row, {"eye": 3}, row]))
    assert batch("--cameras", tmp_path / "cameras.json", "-o", tmp_path / "out", "--workers", 1) == 2
    said = capsys.readouterr()
    assert "2 of 2 cameras" in said.out
    assert "not used: roll" in said.err and "left out: row 1: eye must be three finite numbers" in said.err
    assert "error: 1 of 3 rows were left out" in said.err
    assert sorted(p.name for p in (tmp_path / "out").glob("*.png")) == ["000000.png", "000002.png"]
    assert inside[0][1] == 1


def test_a_film_is_put_together(inside, tmp_path) -> None:
    assert batch("--orbit", 3, "--what", "film", "--shadows", "hard", "-o", tmp_path / "out") == 0
    assert (tmp_path / "out" / "film.mp4").stat().st_size > 500
    assert inside[0][0].wishes == {"shadows": "hard"}


@pytest.mark.usefixtures("inside")
@pytest.mark.parametrize(
    ("words", "message"),
    [(("--grid", "2x2"), "--grid must look like"), (("--orbit", 0), "--orbit must be >= 1"),
     (("--orbit", 999999999), "--orbit has 999999999 cameras, a batch at most 250000"),
     (("--orbit", 2, "--what", "noise"), "what"), (("--orbit", 2, "--outputs", "depth"), "without --what depth"),
     (("--orbit", 2, "--fps", 9), "nothing without --what film"), (("--orbit", 2, "--frames", 9), "without --path"),
     (("--orbit", 2, "--what", "depth", "--outputs", "noise"), "--outputs must be"),
     (("--orbit", 2, "--what", "depth", "--outputs", ""), "--outputs must name at least one of "),
     (("--cameras", "none.json"), "no such file")],
)  # fmt: skip
def test_wrong_wishes_are_refused(tmp_path, capsys, words, message) -> None:
    assert batch(*words, "-o", tmp_path / "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_bad_rows_are_told_before_the_first_picture(tmp_path, monkeypatch, capsys) -> None:
    seen = []

    def run(job, folder, *, workers=None, tell=None):
        del folder, workers, tell
        seen.append(capsys.readouterr().err)
        return Outcome(len(job.cameras), 0, {}, 0)

    monkeypatch.setattr("torchrender.batch.local.run", run)
    row = {"eye": [0.0, 1.0, 3.0], "target": [0.0, 1.0, 0.0]}
    (tmp_path / "cameras.json").write_text(json.dumps([row, *[{"eye": 3}] * 12]))
    assert batch("--cameras", tmp_path / "cameras.json", "-o", tmp_path / "out") == 2
    (before,) = seen
    assert before.count("left out: row ") == 10 and "left out: 2 more rows" in before
    after = capsys.readouterr().err
    assert "12 of 13 rows were left out" in after and "left out: row" not in after


def test_a_folder_in_place_of_the_cameras_is_told(tmp_path, capsys) -> None:
    assert batch("--cameras", tmp_path, "-o", tmp_path / "out") == 2
    assert capsys.readouterr().err == f"torchrender: error: {tmp_path}: is a folder, not a file\n"
