"""Scripts of the documentation run as they stand, small; pages show them as they are."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import pytest

from torchrender.images.files import read_image

EXAMPLES = Path(__file__).resolve().parents[2] / "docs" / "examples"
# Arguments that make them small, and a picture that somebody would look at.
SCRIPTS: dict[str, tuple[tuple[str, ...], str | None]] = {
    "batch": (("24", "2", "cornell_box"), None),
    "budget": (("48",), None),
    "colors_from_photos": (("24",), "box.png"),
    "dataset": (("32", "6", "0", "cornell_box"), None),
    "depth_image": (("64",), "mesh.exr"),
    "fog_photo": (("64",), "fog_thick/frame_0000.png"),
    "light_from_shadow": (("32",), "one_lamp.png"),
    "points": (("64",), "cloud.png"),
    "pose_from_depth": (("32",), "seen.png"),
    "reflection": (("48",), "mirror_traced.png"),
    "scene_editing": (("48", "3"), None),
    "soft_shadow": (("64",), "soft_shadow.png"),
    "style": (("48",), "styled/frame_0000.png"),
    "viewer": (("48", "no"), "view.png"),
    "voxels": (("24",), None),
    "walkthrough": (("64",), "between/frame_0000.png"),
}
SERVED = {"stream"}
"""Run by tests/service/test_readme.py, where a server runs."""


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_script_runs(name: str, tmp_path: Path, monkeypatch, capsys) -> None:
    words, picture = SCRIPTS[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [f"{name}.py", *words])
    runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert capsys.readouterr().out.strip()
    assert any(tmp_path.iterdir()) or name == "budget"
    if picture is not None:
        assert float(read_image(tmp_path / picture)[..., :3].std()) > 0.02, "a reader would see a blank wall"


def test_every_script_is_run_somewhere() -> None:
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(SCRIPTS) | SERVED
