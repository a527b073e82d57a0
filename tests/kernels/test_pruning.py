"""Old code goes, code that anybody reads stays, and files of others are never touched."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from torchrender.kernels import keys, pruning
from torchrender.kernels.keys import module_key
from torchrender.kernels.pruning import MARK, OLD_S, UNUSED_S, prune
from torchrender.kernels.store import MARKED_S, _mark_used


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache folder where a user has it."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = tmp_path / "torchrender" / "kernels"
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()
    assert keys.cache_folder() == made
    yield made
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()


def file(path: Path, age_s: float, read_s: float | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("code")
    now = time.time()
    os.utime(path, (now - (age_s if read_s is None else read_s), now - age_s))
    return path


LONG = 2 * UNUSED_S


def test_only_what_was_not_used_for_long_is_removed(folder) -> None:
    gone = [
        file(folder / "raster.tiles" / "draw-1.code", LONG),
        file(folder / "raster.tiles" / "draw-2.code.abc.part", 2 * OLD_S),
        file(folder / "raster.tiles" / "draw-3.code.claim", 2 * OLD_S),
        file(folder / "callbacks-0123456789abcdef" / "rays_1" / "hit.nbc", LONG),
        file(folder.parent / "0.1.0" / "tiles-123" / "draw.nbi", LONG),
    ]
    stay = [
        file(folder / "raster.tiles" / "draw-4.code", 0.5 * UNUSED_S),
        file(folder / "raster.tiles" / "draw-5.code", LONG, read_s=0.0),
        file(folder / "raster.tiles" / "draw-6.code.abc.part", 0.0),
        file(folder / "raster.tiles" / "notes.txt", LONG),
        file(folder / "notes" / "a.nbc", LONG),
        file(folder / f"callbacks-{module_key('rays.embree')}" / "hit.nbc", LONG),
        file(folder / "callbacks-fedcba9876543210" / "hit.nbc", 0.0),
        file(folder / "callbacks-fedcba9876543210" / "hit.nbi", LONG),
        file(folder.parent / "0.2.0" / "tiles-123" / "draw.nbc", LONG),
        file(folder.parent / "0.2.0" / "tiles-123" / "mine.txt", LONG),
    ]
    assert prune() == 3
    assert not any(one.exists() for one in gone) and all(one.exists() for one in stay)
    assert not (folder.parent / "0.1.0").exists()


def test_it_looks_once_a_day(folder) -> None:
    file(folder / "raster.tiles" / "draw-1.code", LONG)
    assert prune() == 1
    old = file(folder / "raster.tiles" / "draw-2.code", LONG)
    assert prune() == 0 and old.exists()
    os.utime(folder / MARK, (time.time() - 2 * pruning.EVERY_S,) * 2)
    assert prune() == 1 and not old.exists()


def test_reading_marks_as_used_where_disks_do_not_note_it(folder) -> None:
    old = file(folder / "raster.tiles" / "draw-1.code", LONG)
    _mark_used(old)
    assert time.time() - old.stat().st_mtime < 60.0 and prune() == 0
    fresh = file(old, 0.5 * MARKED_S)
    before = fresh.stat().st_mtime
    _mark_used(fresh)
    assert fresh.stat().st_mtime == before, "not a write for each reading"


def test_no_folder_and_a_folder_that_refuses_are_no_reason_to_fail(folder, monkeypatch) -> None:
    assert not folder.exists() or prune() == 0

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError("read-only")

    old = file(folder / "raster.tiles" / "draw-1.code", LONG)
    (folder / MARK).unlink(missing_ok=True)
    monkeypatch.setattr(Path, "unlink", refuse)
    assert prune() == 0 and old.exists()
