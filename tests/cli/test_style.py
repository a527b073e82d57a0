"""The command ``torchrender style``."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

import torchrender as tr
from photo_scenes import room, striped_photo
from torchrender.cli import main as cli
from torchrender.images.files import read_image, write_image
from torchrender.scene.files.scene_write import write_scene

SMALL = ("--views", "8", "--size", "80x60")


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a scene and a photo."""
    write_scene(tmp_path / "room.glb", room({"sofa": (0.1, 0.5, 0.2)}))
    write_image(tmp_path / "photo.png", striped_photo())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments: str) -> int:
    return cli.main(["style", "room.glb", *arguments])


def test_a_styled_scene_a_sheet_and_times(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("--photo", "photo.png", "-o", "styled.glb", "--seed", "3", "--list", *SMALL) == 0
    said = capsys.readouterr().out
    assert "10 objects" in said and "search" in said and " ms" in said and "moves" in said
    assert "sofa" in said and "styled_sheet.png" in said
    sheet = read_image(here / "styled_sheet.png")
    assert sheet.shape[0] > 180 and float(sheet.std()) > 0.05
    scene = tr.load("styled.glb")
    assert {m.name for m in scene.meshes} == {m.name for m in room().meshes}
    assert scene.lights == () and capsys.readouterr().err == ""
    first = (here / "styled.glb").read_bytes()
    assert run("--photo", "photo.png", "-o", "again.glb", "--seed", "3", "--no-sheet", *SMALL) == 0
    assert (here / "again.glb").read_bytes() == first and not (here / "again_sheet.png").exists()


def test_locks_and_picks(here: Path) -> None:
    assert (
        run(
            "--photo",
            "photo.png",
            "-o",
            "s.toml",
            "--add-light",
            "--lock",
            "sofa",
            "--pick",
            "table=62,22,79,43",
            *SMALL,
        )
        == 0
    )
    scene = tr.load(here / "s.toml")
    # No light came with the room: it is written with the one that the fit assumes.
    assert [light.name for light in scene.lights] == ["style light"] and float(scene.ambient[0]) > 0.1
    colors = {m.name: scene.materials[m.material].diffuse for m in scene.meshes}
    assert torch.allclose(colors["sofa"], torch.tensor([0.1, 0.5, 0.2]), atol=1e-5)
    assert float(colors["table"][0]) > 5 * float(colors["table"][2])


def test_warnings_are_said_by_name(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = torch.zeros(20, 20, 4)
    image[..., 0], image[:10, :, 3] = 0.5, 1.0
    write_image(here / "clear.png", image)
    assert run("--photo", "clear.png", "-o", "s.glb", *SMALL) == 0
    assert "warning: photo is partly transparent" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--photo", "none.png", "-o", "a.glb"), "no such file"),
        (("--photo", "room.glb", "-o", "a.glb"), "cannot read .glb"),
        (("--photo", "photo.png", "-o", "a.obj"), "must be .glb, .toml"),
        (("--photo", "photo.png", "-o", "no/a.glb"), "does not exist"),
        (("--photo", "photo.png", "-o", "a.glb", "--lock", "piano"), "no object is named 'piano'"),
        (("--photo", "photo.png", "-o", "a.glb", "--pick", "table"), "--pick must look like"),
        (("--photo", "photo.png", "-o", "a.glb", "--pick", "table=1,2,x,4"), "--pick table must be 4 numbers"),
        (("--photo", "photo.png", "-o", "a.glb", "--pick", "table=0,0,999,9"), "within the photo"),
        (("--photo", "photo.png", "-o", "a.glb", "--views", "3"), "views must be in"),
        (("--photo", "photo.png", "-o", "a.glb", "--size", "9"), "--size must look like"),
        (("--photo", "photo.png", "-o", "a.glb", "--warmth", "3"), "--warmth must be in"),
        (("--photo", "photo.png", "-o", "a.glb", "--prior", "nan"), "--prior must be"),
        (("--photo", "photo.png", "-o", "a.glb", "--sheet", "a.jpg"), "output must be .png"),
        (("--photo", "photo.png", "-o", "a.glb", "--sheet", "a.png", "--no-sheet"), "exclude each other"),
        (("--photo", "photo.png", "-o", "a.glb", "--seed", "-1"), "seed must be"),
    ],
)
def test_wrong_use(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], message: str
) -> None:  # fmt: skip
    assert run(*arguments) == 2
    assert message in capsys.readouterr().err
    assert not (here / "a.glb").exists()
