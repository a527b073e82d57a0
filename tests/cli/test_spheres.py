"""The command ``torchrender spheres``."""

from __future__ import annotations

from pathlib import Path

import pytest

from torchrender.cli.main import main
from torchrender.effects.sky_shadows.occluder import read_spheres
from torchrender.images.files import read_image

CUBE = """v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 3 4 8 7
f 2 3 7 6
f 1 5 8 4
"""


def test_it_writes_a_set_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    output = tmp_path / "set.npz"
    arguments = ["-n", "8", "--resolution", "16", "--starts", "1", "--size", "64x32", "-o", str(output)]
    assert main(["spheres", str(tmp_path / "cube.obj"), *arguments]) == 0
    assert "8 spheres" in capsys.readouterr().out
    assert len(read_spheres(output).radii) == 8
    picture = read_image(tmp_path / "set_spheres.png")
    assert picture.shape[:2] == (32, 64)
    assert float((picture[:, :32, :3] - picture[:, 32:, :3]).abs().max()) > 0.1


def test_it_says_what_is_wrong(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cube.obj").write_text(CUBE)
    assert main(["spheres", str(tmp_path / "cube.obj"), "-n", "0", "-o", str(tmp_path / "set.npz")]) == 2
    assert "spheres" in capsys.readouterr().err
