"""The subcommand ``torchrender points``, and what ``info`` says of points."""

from __future__ import annotations

import json
import re

import pytest
import torch

from torchrender.cli import main as cli
from torchrender.cli.main import main
from torchrender.images.files import read_image
from torchrender.numerics.tonemap import auto_exposure, tone_map


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


@pytest.fixture
def disc(tmp_path):
    """A few points in a plane that faces the usual camera."""
    rows = [(x, y) for x in range(6) for y in range(6)]
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz", "radius"))
    head = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n{names}end_header\n"
    (tmp_path / "disc.ply").write_text(head + "".join(f"{x} {y} 0 0 0 1 0.8\n" for x, y in rows))
    return tmp_path / "disc.ply"


def test_exposure_and_tone_map_show_points_as_they_show_scenes(disc, tmp_path):
    view = ["--camera", "eye=2.5,2.5,6", "target=2.5,2.5,0", "--size", "24x16"]

    def drawn(command, suffix, *words):
        picture = tmp_path / f"a{suffix}"
        assert main([command, str(disc), "-o", str(picture), *view, *words]) == 0
        return read_image(picture)

    light = drawn("render", ".exr")[..., :3]
    assert float(light.max()) > 0.3
    for words, shown in (
        (("--exposure", "-2"), tone_map(light, exposure=-2.0)),
        (("--tone-map", "aces", "--exposure", "1"), tone_map(light, "aces", exposure=1.0)),
        (("--exposure", "auto"), tone_map(light, exposure=auto_exposure(light))),
    ):
        for command in ("render", "points"):
            assert float((drawn(command, ".png", *words) - shown).abs().max()) < 0.01, words
    assert torch.equal(drawn("render", ".exr", "--exposure", "-2")[..., :3], light), "files of light keep it"
    assert main(["points", str(disc), "-o", str(tmp_path / "a.png"), *view, "--exposure", "99"]) == 2


def test_render_names_every_option_that_points_do_not_have(disc, tmp_path, capsys):
    unused = {
        "--budget-ms": ["5"], "--max-error": ["0.1"], "--enhance": [], "--supersample": ["2"], "--fog": [],
        "--no-shadows": [], "--shadows": ["traced"], "--reflections": ["traced"], "--time": ["3"], "--explain": [],
        "--triangles": ["9"], "--animation": ["a"], "--variant": ["a"], "--subscene": ["a"], "--cascades": ["2"],
        "--shadow-size": ["64"],
    }  # fmt: skip
    used = {"--exposure": ["1"], "--tone-map": ["aces"], "--background": ["1,0,0"], "--drop-invalid": [],
            "--size": ["24x16"], "--camera": ["eye=2,2,6"], "--output": [str(tmp_path / "a.png")]}  # fmt: skip
    words = [word for option, values in {**unused, **used}.items() for word in (option, *values)]
    assert main(["render", str(disc), *words]) == 0
    told = next(line for line in capsys.readouterr().err.splitlines() if "do nothing with points" in line)
    assert set(re.findall(r"--[a-z-]+", told)) == set(unused)
    known = next(a for a in cli._parser()._actions if a.dest == "command").choices["render"]
    options = {max(action.option_strings, key=len) for action in known._actions if action.option_strings}
    assert options - {"--help"} == set(unused) | set(used), "a new option of render belongs to one of both lists"
    assert main(["info", str(disc), "--time", "3"]) == 0
    assert "--time does nothing" in capsys.readouterr().err


def test_options_that_do_nothing_are_named(disc, tmp_path, capsys):
    """Each option says so with the output, or the input, that has no use for it."""
    ply, packed = str(disc), str(tmp_path / "disc.trp")
    view = {"--filter": ["squares"], "--radius": ["1"], "--two-sided": [], "--background": ["1,0,0"],
            "--camera": ["eye=2,2,6"], "--size": ["24x16"], "--exposure": ["1"], "--tone-map": ["aces"]}  # fmt: skip

    def told(source, output, options):
        words = [word for option, values in options.items() for word in (option, *values)]
        assert main(["points", source, "-o", str(tmp_path / output), *words]) == 0
        return {o for line in capsys.readouterr().err.splitlines() if "nothing with" in line
                for o in re.findall(r"--[a-z-]+", line)}  # fmt: skip

    assert told(ply, "disc.trp", view) == set(view)
    assert told(ply, "a.exr", view) == {"--exposure", "--tone-map"}
    assert told(ply, "a.png", view | {"--drop-invalid": []}) == set()
    small = {"--size": ["24x16"]}
    assert told(packed, "a.png", small | {"--memory": ["128"], "--drop-invalid": []}) == {"--memory", "--drop-invalid"}
    assert told(ply, "a.png", small | {"--memory": ["128"]}) == set()
    assert told("cornell_box", "a.png", small | {"--samples": ["99"], "--memory": ["128"]}) == {"--memory"}
    row = "0 0 0 1 0 0 0.5\n"
    names = "".join(f"property float {name}\n" for name in ("x", "y", "z", "red", "green", "blue", "alpha"))
    clear = tmp_path / "clear.ply"
    clear.write_text(f"ply\nformat ascii 1.0\nelement vertex 2\n{names}end_header\n" + row + row.replace("0", "1", 1))
    drawn = {name: view[name] for name in ("--filter", "--radius", "--two-sided", "--size")}
    assert told(str(clear), "a.png", drawn) == {"--filter", "--radius", "--two-sided"}
    assert main(["points", ply, "--memory", "128", "--samples", "9", "-o", str(tmp_path / "a.png")]) == 2
    assert "--samples is for meshes only" in capsys.readouterr().err


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
