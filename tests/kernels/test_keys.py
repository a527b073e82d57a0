"""The kernel cache follows the text of a kernel and of what it imports, and nothing else."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from torchrender.kernels import keys as module

CACHED = (
    module._text, module._imported, module._sources, module.module_key, module.cache_folder, module.read_folders,
    module._answers,
)  # fmt: skip


def forget() -> None:
    for cached in CACHED:
        cached.cache_clear()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name, text in {
        "low": "x = 1\n",
        "other": "x = 2\n",
        "compile": "def kernel(): ...\n",
        "high": "from torchrender.kernels import low, missing\nfrom torchrender.kernels.compile import kernel\n",
        "top": "from torchrender.kernels.high import x\n",
        "raster/low": "x = 1\n",
        "raster/tiles": "from torchrender.kernels.raster.low import (\n    x,  # why (\n    y as z,\n)\n",
        "raster/whole": "import torchrender.kernels.raster.tiles\n",
        "raster/package": "from torchrender.kernels.raster import (\n    low as ground,\n)\n",
        "rays/low": "x = 1\n",
        "rays/march": "    from torchrender.kernels.rays import low\n",
    }.items():
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    monkeypatch.setattr(module, "_FOLDER", tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    forget()
    yield tmp_path
    forget()


NAMES = (
    "low", "high", "top", "other", "raster.low", "raster.tiles", "raster.whole", "raster.package", "rays.low",
    "rays.march",
)  # fmt: skip


def changed_by(path: Path) -> set[str]:
    """Modules whose key is another one after an edit of a file."""
    before = {name: module.module_key(name) for name in NAMES}
    path.write_text(path.read_text() + "x = 3\n")
    forget()
    return {name for name in NAMES if module.module_key(name) != before[name]}


@pytest.mark.parametrize(
    ("edited", "expected"),
    [
        ("low", {"low", "high", "top"}),
        ("raster/low", {"raster.low", "raster.tiles", "raster.whole", "raster.package"}),
        ("rays/low", {"rays.low", "rays.march"}),
        ("compile", set()),
    ],
)
def test_an_edited_helper_changes_the_key_of_all_that_use_it_and_no_other(folder, edited, expected):
    """However deep it lies, and although a file of the same name lies in another folder."""
    assert changed_by(folder / f"{edited}.py") == expected


def test_the_real_modules_see_what_they_import() -> None:
    sources = module._sources("raster.tiles")
    assert {"raster.tiles", "raster.records"} <= sources and not sources & module._NO_CODE


@pytest.mark.usefixtures("folder")
def test_the_environment_names_the_place(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "here"))
    forget()
    assert module.cache_folder() == tmp_path / "here"
    assert module.read_folders() == (tmp_path / "here",)


@pytest.mark.usefixtures("folder")
def test_a_cache_folder_that_cannot_be_made_is_replaced_but_still_read(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "below"))
    monkeypatch.setenv(module.FURTHER, str(tmp_path / "image"))
    forget()
    written = module.cache_folder()
    assert (tmp_path / "file") not in written.parents and os.access(written, os.W_OK)
    assert module.read_folders() == (
        written, tmp_path / "file" / "below" / "torchrender" / "kernels", tmp_path / "image",
    )  # fmt: skip


@pytest.mark.usefixtures("folder")
def test_a_folder_that_others_may_write_is_not_trusted(monkeypatch, tmp_path):
    """Code from it is run."""
    monkeypatch.setattr(module.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(module.tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"torchrender-kernels-{os.getuid()}"
    planted.mkdir()
    planted.chmod(0o777)
    assert module._temporary_folder() != planted
    planted.chmod(0o700)
    assert module._temporary_folder() == planted


def test_an_upgrade_keeps_the_code() -> None:
    """Another version of the package, and another place of it, lead to the same key."""
    code = (
        "import torchrender; torchrender.__version__ = '99.0'\n"
        "from torchrender.kernels.keys import module_key; print(module_key('raster.tiles'))"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    assert said == module.module_key("raster.tiles")


@pytest.mark.usefixtures("folder")
def test_a_disk_that_does_not_answer_is_left_alone_and_named(monkeypatch, tmp_path, caplog):
    """As a network disk whose server is gone: calls to it never return."""
    gone, released = tmp_path / "gone", threading.Event()
    asked = os.access

    def access(path, mode):
        if str(path).startswith(str(gone)):
            released.wait(60.0)
        return asked(path, mode)

    monkeypatch.setenv("NUMBA_CACHE_DIR", str(gone))
    monkeypatch.setenv(module.FURTHER, str(gone / "image"))
    monkeypatch.setattr(module.os, "access", access)
    monkeypatch.setattr(module, "ANSWER_S", 0.2)
    forget()
    try:
        written = module.cache_folder()
        assert module.read_folders() == (written,) and gone not in (written, *written.parents)
        assert f"{gone} does not answer: compiled kernels are kept in {written}" in caplog.text
    finally:
        released.set()
        forget()


def test_kernels_of_other_files_follow_what_they_import(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """As those of tests do: what they call may change, and their own text stays."""
    file = tmp_path_factory.mktemp("elsewhere") / "test_x.py"
    file.write_text("from torchrender.kernels.top import x\n\nx = 1\n")
    before = module.file_key(str(file))
    (folder / "other.py").write_text("x = 5\n")
    forget()
    assert module.file_key(str(file)) == before
    (folder / "low.py").write_text("x = 5\n")
    forget()
    changed = module.file_key(str(file))
    file.write_text(file.read_text() + "y = 2\n")
    assert len({before, changed, module.file_key(str(file))}) == 3
