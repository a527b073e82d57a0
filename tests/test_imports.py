"""What may be imported when: every module here costs each command its time."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TORCH = "import torch, numba, PIL.Image\n"
PROGRAM = {"torchrender.cli", "torchrender.errors", "torchrender.kernels", "torchrender.kernels.hooks"}
FOREIGN = {
    "torch",
    "numba",
    "numpy",
    "scipy",
    "PIL",
    "cv2",
    "kornia",
    "skimage",
    "trimesh",
    "OpenEXR",
    "embreex",
    "tqdm",
}


def imported(code: str) -> set[str]:
    """Full names of what a process has imported at its end.

    ``python -X importtime`` shows the same with times, but not what is imported by ``importlib.import_module``.
    """
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'service'}"}
    tell = f"{code}\nimport sys; print('modules:', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", tell], env=environment, capture_output=True, text=True, check=True)
    return set(done.stdout.rpartition("modules:")[2].split())


def heads(names: set[str]) -> set[str]:
    return {name.split(".")[0] for name in names}


def test_the_package_imports_nothing() -> None:
    found = imported("import torchrender")
    assert {name for name in found if name.startswith("torchrender")} == {"torchrender"}
    assert not heads(found) & FOREIGN


def test_help_imports_the_command_line_alone() -> None:
    found = imported("from torchrender.cli.main import main\ntry: main(['--help'])\nexcept SystemExit: pass")
    own = {name for name in found if name.startswith("torchrender.")}
    assert all(name in PROGRAM or name.startswith("torchrender.cli.") for name in own), own - PROGRAM
    assert not heads(found) & (FOREIGN | {"logging", "asyncio", "subprocess", "email"})


@pytest.fixture(scope="module")
def picture(tmp_path_factory) -> set[str]:
    """What a picture of a built-in scene imports beyond torch, numba and the reader of pictures."""
    output = tmp_path_factory.mktemp("picture") / "p.png"
    words = ["render", "cornell_box", "--size", "32x32", "-o", str(output)]
    return imported(f"{TORCH}from torchrender.cli.main import main\nmain({words!r})") - imported(TORCH)


def test_a_picture_imports_no_library_that_it_does_not_use(picture: set[str]) -> None:
    assert "torchrender.renderer" in picture
    for name in ("scipy.fft", "scipy.spatial", "OpenEXR", "kornia", "cv2", "skimage", "trimesh", "tqdm"):
        assert not any(one == name or one.startswith(f"{name}.") for one in picture), name


def test_a_picture_imports_its_own_scene_and_no_studies(picture: set[str]) -> None:
    scenes = {name.rpartition(".")[2] for name in picture if name.startswith("torchrender.scene.procedural.")}
    assert "cornell_box" in scenes and not scenes & {"city", "grass", "living_room", "nest", "tree", "washroom"}
    for name in ("report", "tuning", "quality", "photo", "walkthrough", "client", "wire", "voxels", "points"):
        assert not any(one.startswith(f"torchrender.{name}") for one in picture), name
