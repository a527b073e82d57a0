"""Two processes never compile the same kernel at once, unless one of them is gone or its disk takes no claims."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from torchrender.kernels import claims


@pytest.fixture
def code(tmp_path: Path) -> Path:
    """A file of code that is still to be made."""
    return tmp_path / "raster.tiles" / "draw-1.code"


def other(code: Path, pid: int, node: str = platform.node(), age_s: float = 0.0) -> Path:
    """The claim of another process."""
    file = code.with_name(code.name + claims.SUFFIX)
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"{node} {pid}")
    os.utime(file, (time.time() - age_s,) * 2)
    return file


@pytest.fixture
def dead() -> int:
    """The number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def test_a_claim_stands_until_it_is_released(code: Path) -> None:
    claim = claims.take(code)
    assert claim is not None and claim.file is not None and claim.file.read_text().split()[1] == str(os.getpid())
    assert not claims.is_taken(code), "one's own claim is in nobody's way"
    claim.release()
    assert not list(code.parent.iterdir())


def test_another_process_at_work_keeps_others_away_and_is_waited_for(code: Path) -> None:
    file = other(code, os.getppid())
    assert claims.is_taken(code) and claims.take(code) is None
    threading.Timer(0.3, file.unlink).start()
    begin = time.monotonic()
    claims.wait(code)
    assert 0.2 < time.monotonic() - begin < 5.0
    assert claims.take(code) is not None


def test_the_dead_and_the_old_claim_nothing(code: Path, dead: int) -> None:
    other(code, dead)
    assert not claims.is_taken(code)
    other(code, 1, node="another-machine", age_s=2 * claims.LONGEST_S)
    assert not claims.is_taken(code)
    other(code, 1, node="another-machine")
    assert claims.is_taken(code), "a process there cannot be looked at: its claim stands until it is old"
    other(code, dead)
    claim = claims.take(code)
    assert claim is not None and claim.file is not None


def test_a_claim_cut_short_counts_for_a_moment(code: Path) -> None:
    file = other(code, 1)
    file.write_text("")
    assert claims.is_taken(code)
    os.utime(file, (time.time() - 2 * claims.UNSIGNED_S,) * 2)
    assert not claims.is_taken(code)


def test_where_nothing_can_be_written_everybody_compiles(tmp_path: Path) -> None:
    (tmp_path / "wall").write_text("")
    claim = claims.take(tmp_path / "wall" / "draw-1.code")
    assert claim == claims.Claim(None)
    claim.release()
    assert not claims.is_taken(tmp_path / "wall" / "draw-1.code")
