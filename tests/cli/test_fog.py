"""``torchrender fog``."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from torchrender.cli.main import main

MARKS = """
[camera]
horizon = 25.0
[[region]]
label = "sky"
polygon = [[0, 0], [80, 0], [80, 25], [0, 25]]
[outdoor]
near = 3.0
far = 90.0
"""


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    pixels = np.full((60, 80, 3), 60, np.uint8)
    pixels[:25] = (150, 170, 210)
    Image.fromarray(pixels).save(tmp_path / "photo.png")
    (tmp_path / "marks.toml").write_text(MARKS)
    return tmp_path / "photo.png", tmp_path / "marks.toml"


def test_marks_in_picture_out(files, tmp_path: Path, capsys) -> None:
    photo, marks = files
    out = [str(tmp_path / name) for name in ("o.png", "t.png", "v.exr", "d.npz")]
    more = ["--write-transmittance", out[1], "--write-scattered", out[2], "--write-depth", out[3], "--json"]
    status = main(["fog", str(photo), "--marks", str(marks), "-o", out[0], "--visibility", "80", *more])
    assert not status and all(Path(f).is_file() for f in out)
    assert json.loads(capsys.readouterr().out)["timings_ms"]["scattered"] > 0
    foggy = np.array(Image.open(out[0])).astype(int)
    assert foggy[28].mean() > foggy[58].mean() > 60


@pytest.mark.parametrize(
    ("words", "text"),
    [
        ([], "needs --marks"),
        (["--marks", "M", "--visibility", "80", "--scattering", "0.1"], "exclude each other"),
        (["--stereo", "P", "P"], "needs --baseline"),
        (["--marks", "M", "--baseline", "1"], "goes with --stereo"),
        (["--depth", "none.npy"], "no such file"),
        (["--marks", "M", "--write-transmittance", "O"], "need files of their own, got o.png twice"),
        (["--depth", "D", "--depth-unit", "-1"], "--depth-unit must be in"),
    ],
)
def test_wrong_words_are_named(files, tmp_path: Path, capsys, words: list[str], text: str) -> None:
    photo, marks = files
    depth = tmp_path / "depth.npy"
    np.save(depth, np.ones((60, 80), np.float32))
    names = {"M": str(marks), "P": str(photo), "D": str(depth), "O": str(tmp_path / "o.png")}
    words = [names.get(w, w) for w in words]
    assert main(["fog", str(photo), "-o", str(tmp_path / "o.png"), *words])
    assert text in capsys.readouterr().err
