"""The command ``warm-up``, what cold commands say, and how the program ends."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
from pathlib import Path

import pytest

from torchrender.cli import output, warm_up
from torchrender.cli.main import COLD, main
from torchrender.kernels import keys
from torchrender.kernels import warm_up as compiling
from torchrender.kernels.signatures import recorded
from torchrender.kernels.warm_up import Outcome

ROOT = Path(__file__).resolve().parents[2]
PATH = os.pathsep.join([str(ROOT), str(ROOT / "service")])


@pytest.fixture
def noted(monkeypatch):
    """All is missing; what would be compiled is noted instead."""
    asked = []

    def missing(parts=()):
        wanted = frozenset(parts)
        return [use for use in recorded() if not wanted or use.serves(wanted)]

    def note(uses, tell=None):
        asked.append(uses)
        tell(0, len(uses))
        tell(len(uses), len(uses))
        return Outcome(len(uses), ())

    class Noting:
        def __init__(self, tell):
            self.tell, self.uses = tell, []

        def add(self, uses):
            asked.append(uses)
            self.uses += uses
            self.tell(0, len(self.uses))

        def wait_for(self, kernel):
            return any(use.kernel == kernel for use in self.uses)

        def stop(self):
            self.uses = []

    monkeypatch.setattr(compiling, "missing", missing)
    monkeypatch.setattr(compiling, "warm_up", note)
    monkeypatch.setattr(compiling, "Compilation", Noting)
    return asked


def test_it_compiles_what_is_asked_for_and_says_where(noted, capsys) -> None:
    assert main(["warm-up", "--for", "points, voxels"]) == 0
    told = capsys.readouterr()
    assert {use.kernel.split(".")[0] for use in noted[0]} >= {"points", "voxels"}
    assert not any(use.parts == ("serve",) for use in noted[0])
    count = len(noted[0])
    assert f"compiling kernels, once: 0 of {count}\n" in told.err and f"once: {count} of {count}" in told.err
    assert f"{count} kernels compiled" in told.out and "kept in" in told.out
    assert main(["warm-up"]) == 0
    assert len(noted[1]) == len(recorded())


def test_an_unknown_group_is_refused(capsys) -> None:
    assert main(["warm-up", "--for", "pictures"]) == 2
    assert "--for must be of render, depth, points, voxels, serve, got 'pictures'" in capsys.readouterr().err


def test_the_groups_are_those_that_are_recorded() -> None:
    from torchrender.kernels.signatures import GROUPS

    assert warm_up.GROUPS == GROUPS


def test_a_cold_picture_compiles_what_its_passes_need_at_once(noted, capsys) -> None:
    COLD.start("render")
    COLD.plan = lambda: ["gbuffer", "composite"]
    assert COLD("raster.tiles.render_tiles")
    needed = {use.kernel for use in noted[0]}
    assert "raster.tiles.render_tiles" in needed and "shadows.shadow_lookup.shadow_lookup" not in needed
    assert "compiling kernels, once, about " in capsys.readouterr().err
    # A setting that is not the usual one: first what such settings need, then nothing more to do at once.
    assert COLD.plan() == ["gbuffer", "composite"]
    assert not COLD("some.other.kernel") and not COLD("some.other.kernel")
    assert len(noted) == 1 and "about" not in capsys.readouterr().err
    COLD.stop()


def test_a_cold_picture_begins_before_its_scene_is_known(noted, monkeypatch, tmp_path, capsys) -> None:
    """With what all pictures need; what this one needs besides is added once it is planned, with one more planning."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()
    COLD.start("render")
    COLD.begin(reads_file=False)
    told = capsys.readouterr().err
    assert told.startswith("compiling kernels, once, about ") and "0 of" in told
    begun = {use.kernel for use in noted[0]}
    assert "raster.tiles.render_tiles" in begun and "shadows.shadow_lookup.shadow_lookup" not in begun
    assert not [name for name in begun if name.startswith(("meshes.crease.", "sky_shadows."))], "few scenes need them"
    assert COLD("raster.tiles.render_tiles") and {use.kernel for use in noted[1]} == begun, "while the scene is loaded"
    planned = []
    COLD.plan = lambda: planned.append(1) or ["gbuffer", "point_shadow"]
    assert COLD("raster.tiles.render_tiles") and COLD("shadows.shadow_lookup.shadow_lookup")
    assert planned == [1] and "shadows.shadow_lookup.shadow_lookup" in {use.kernel for use in noted[2]}
    COLD.stop()
    # Where a picture was made before, nothing is begun for what may be there.
    (tmp_path / warm_up.SIGN).mkdir()
    (tmp_path / warm_up.SIGN / "render_tiles-1.code").write_text("")
    count = len(noted)
    COLD.start("render")
    COLD.begin(reads_file=True)
    assert len(noted) == count
    for cached in (keys.cache_folder, keys.read_folders):
        cached.cache_clear()


def test_what_a_file_may_need_is_begun_with_or_asked_for_alone(noted, monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(keys, "read_folders", lambda: (tmp_path,))
    COLD.start("render")
    COLD.begin(reads_file=True)
    assert {"raster.tiles.render_tiles", "meshes.crease.corner_groups"} <= {use.kernel for use in noted[0]}
    COLD.start("render")
    assert COLD("meshes.crease.corner_groups")
    alone = {use.kernel for use in noted[1]}
    assert {name for name in alone if name.startswith("meshes.crease.")}
    assert all(name.startswith("meshes.") for name in alone), "reading a file draws nothing"
    COLD.stop()


def test_a_few_kernels_are_told_and_left_to_the_caller(monkeypatch, capsys) -> None:
    few = [use for use in recorded() if use.kernel == "raster.tiles.render_tiles"][: warm_up.FEW]
    monkeypatch.setattr(compiling, "missing", lambda _: few)
    COLD.start("render")
    assert not COLD("raster.tiles.render_tiles") and not COLD("raster.tiles.render_tiles")
    assert capsys.readouterr().err.count("compiling kernels, once, about") == 1


def test_a_terminal_gets_a_bar(monkeypatch, capsys) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    bar = warm_up.Bar()
    for done in range(3):
        bar(done, 2)
    assert capsys.readouterr().err.endswith(f"\r[{'#' * 24}] compiling kernels, once: 2 of 2\n")


def test_long_work_collects_garbage() -> None:
    gc.disable()
    try:
        output.collect_garbage()
        assert gc.isenabled()
    finally:
        gc.enable()
        gc.unfreeze()


def program(*words: str, code: str = "", **rest: object) -> subprocess.CompletedProcess[str]:
    """The program as installed, after ``code``."""
    run = f"import sys; sys.argv[1:] = {list(words)!r}; {code}; from torchrender.cli.__main__ import run; run()"
    environment = {**os.environ, "PYTHONPATH": PATH}
    return subprocess.run(
        [sys.executable, "-c", run], env=environment, capture_output=True, text=True, check=False, **rest
    )


ATEXIT = "import atexit; atexit.register(print, 'taken apart')"


def test_the_program_ends_at_once_with_all_that_it_said() -> None:
    """Of a pipe, too, which Python writes to in blocks."""
    done = program("scenes", code=ATEXIT)
    assert done.returncode == 0 and "living_room" in done.stdout and "taken apart" not in done.stdout
    wrong = program("render", "nowhere.glb", "-o", "x.txt", code=ATEXIT)
    assert wrong.returncode == 2 and wrong.stderr.startswith("torchrender: error:") and wrong.stdout == ""
    unknown = program("no-such-command", code=ATEXIT)
    assert unknown.returncode == 2 and "invalid choice" in unknown.stderr


def test_the_service_ends_as_python_does() -> None:
    done = program("serve", "--config", "no-such-file.toml", code=ATEXIT)
    assert done.returncode == 2 and done.stdout == "taken apart\n"
