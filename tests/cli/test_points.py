"""The subcommand ``torchrender points``, and what ``info`` says of points."""

from __future__ import annotations

import json

import pytest

from torchrender.cli.main import main
from torchrender.images.files import read_image


def test_compress_then_draw_then_describe(tmp_path, capsys):
    packed, picture = tmp_path / "box.trp", tmp_path / "box.png"
    assert main(["points", "cornell_box", "--samples", "5000", "-o", str(packed)]) == 0
    said = capsys.readouterr().out
    assert "5,000 points" in said and f"{packed.stat().st_size:,} bytes" in said
    assert main(["points", str(packed), "-o", str(picture), "--size", "60x40", "--background", "0,0,1"]) == 0
    assert "60x40  5,000 points" in capsys.readouterr().out
    image = read_image(picture)
    assert image.shape == (40, 60, 3) and float(image[..., 0].max()) > 0.1
    assert main(["info", str(packed), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["points"] == 5000 and info["bytes_per_node"] == 8 and info["colors"] is True


def test_a_picture_with_depth(tmp_path):
    picture = tmp_path / "box.exr"
    words = ["points", "cornell_box", "--samples", "2000", "-o", str(picture), "--size", "32x32"]
    assert main([*words, "--filter", "squares", "--two-sided", "--radius", "4"]) == 0
    assert read_image(picture).shape[:2] == (32, 32)


def test_info_of_a_cloud(tmp_path, capsys):
    cloud = tmp_path / "three.ply"
    cloud.write_text(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
        "0 0 0\n1 0 0\n0 2 0\n"
    )
    assert main(["info", str(cloud)]) == 0
    said = capsys.readouterr().out
    assert "points                 3" in said and "(1, 2, 0)" in said


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["none.trp", "-o", "a.png"], "no such file"),
        (["cornell_box", "-o", "a.jpg"], "the output must be .png, .exr, .trp"),
        (["bad.trp", "-o", "a.png"], "no file of compressed points"),
        (["cornell_box", "-o", "a.png", "--radius", "99"], "--radius must be"),
        (["bad.trp", "-o", "a.png", "--samples", "9"], "--samples is for meshes only"),
        (["cornell_box", "--samples", "0", "-o", "a.png"], "--samples must be"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, monkeypatch, capsys, words, reason):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.trp").write_bytes(b"nothing of use")
    assert main(["points", *words]) == 2
    said = capsys.readouterr().err
    assert reason in said and said.count("\n") == 1
    assert not (tmp_path / "a.png").exists()
