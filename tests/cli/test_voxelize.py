"""The command ``torchrender voxelize``, and ``info`` of its files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from torchrender.cli import main as cli
from torchrender.images.files import read_image
from torchrender.voxels.file import read_voxels

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


@pytest.fixture
def obj(tmp_path: Path) -> Path:
    path = tmp_path / "corner.obj"
    path.write_text(OBJ)
    return path


def run(*arguments: object) -> int:
    return cli.main([str(a) for a in arguments])


def test_surface_and_info(obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "corner.npz"
    assert run("voxelize", obj, "--resolution", 24, "-o", output) == 0
    assert "surface voxels of 4 triangles" in capsys.readouterr().out
    assert run("info", output, "--json") == 0
    info = json.loads(capsys.readouterr().out)
    assert info["kind"] == "surface" and max(info["cells"]) == 24 and info["name"] == "corner"
    assert run("info", output) == 0
    assert "torchrender.voxels 1" in capsys.readouterr().out


def test_solid_has_the_volume(obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("voxelize", obj, "--resolution", 100, "--solid", "-o", tmp_path / "corner.npz") == 0
    assert capsys.readouterr().err == ""
    model = read_voxels(tmp_path / "corner.npz")
    assert model.kind == "solid" and float(model.voxels.volume[0]) == pytest.approx(1 / 6, rel=0.02)


def test_open_meshes_are_told(obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    obj.write_text(OBJ.rsplit("f", 1)[0])
    assert run("voxelize", obj, "--resolution", 24, "--solid", "-o", tmp_path / "open.npz") == 0
    said = capsys.readouterr().err
    assert "not closed" in said and "% of the columns" in said


def test_pictures_and_vox(obj: Path, tmp_path: Path) -> None:
    for more in ((), ("--solid",), ("--transparent",), ("--solid", "--transparent"), ("--thin",)):
        output = tmp_path / "picture.png"
        assert run("voxelize", obj, "--resolution", 20, "--size", "40x30", *more, "-o", output) == 0
        picture = read_image(output)
        assert picture.shape == (30, 40, 3) and float(picture.std()) > 0.01
    assert run("voxelize", obj, "--resolution", 20, "-o", tmp_path / "corner.vox") == 0
    assert (tmp_path / "corner.vox").read_bytes().startswith(b"VOX ")


def test_an_outcome_without_voxels_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = tmp_path / "empty.toml"
    empty.write_text('name = "void"\n[[light]]\ntype = "point"\nposition = [0, 1, 0]\nintensity = 3\n')
    assert run("voxelize", empty, "--resolution", 8, "-o", tmp_path / "empty.npz") == 0
    assert "void: the scene has no triangles, so there are no voxels" in capsys.readouterr().err
    flat = tmp_path / "flat.obj"
    flat.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert run("voxelize", flat, "--resolution", 8, "--solid", "-o", tmp_path / "flat.npz") == 0
    assert "flat: no cell is inside, so there are no voxels" in capsys.readouterr().err


def test_options_of_pictures_are_named_where_none_is_made(
    obj: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("--resolution", 12, "--transparent", "--size", "40x30")
    assert run("voxelize", obj, *words, "-o", tmp_path / "corner.vox") == 0
    assert "--transparent, --size do nothing with .vox files" in capsys.readouterr().err
    assert run("voxelize", obj, *words, "-o", tmp_path / "corner.png") == 0
    assert "nothing" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("-o", "out.obj"), "the output must be"),
        (("-o", "out.npz", "--resolution", "0"), "--resolution must be in"),
        (("-o", "out.npz", "--method", "vote"), "--method is for --solid"),
        (("-o", "out.npz", "--thin", "--solid"), "--thin is for surfaces"),
        (("-o", "out.png", "--size", "big"), "--size must look like"),
        (("-o", "missing/out.npz"), "does not exist"),
        (("-o", "out.vox", "--resolution", "300"), "at most 256 cells"),
    ],
)
def test_wrong_use(
    obj: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...], message: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert run("voxelize", obj, *arguments) == 2
    assert message in capsys.readouterr().err


def test_damaged_voxel_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bad.npz"
    path.write_bytes(b"PK\x03\x04 nothing")
    assert run("info", path) == 2
    assert "damaged" in capsys.readouterr().err
    assert run("info", tmp_path / "none.npz") == 2
