"""The kernel cache follows the text of a kernel and of what it imports."""

from __future__ import annotations

from pathlib import Path

import pytest

from torchrender.kernels import compile as module


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "low.py").write_text("x = 1\n")
    (tmp_path / "other.py").write_text("x = 2\n")
    (tmp_path / "high.py").write_text("from torchrender.kernels import low, missing\n")
    (tmp_path / "top.py").write_text("from torchrender.kernels.high import x\n")
    monkeypatch.setattr(module, "_FOLDER", tmp_path)
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    yield tmp_path
    for cached in (module._sources, module.cache_folder, module._cache_base):
        cached.cache_clear()


def key(name: str) -> Path:
    for cached in (module._sources, module.cache_folder):
        cached.cache_clear()
    return module.cache_folder(name)


def test_an_edited_helper_changes_the_key_of_all_that_use_it_and_no_other(folder):
    before = {name: key(name) for name in ("low", "high", "top", "other")}
    (folder / "low.py").write_text("x = 3\n")
    changed = {name for name in before if key(name) != before[name]}
    assert changed == {"low", "high", "top"}


@pytest.mark.usefixtures("folder")
def test_the_environment_names_the_place(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "here"))
    assert key("low") == tmp_path / "here"


@pytest.mark.usefixtures("folder")
def test_a_cache_folder_that_cannot_be_made_is_replaced(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "below"))
    module._cache_base.cache_clear()
    assert (tmp_path / "file") not in key("low").parents
