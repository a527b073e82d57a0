"""Who compiles what: a process that begins to compile a kernel says so in a file beside the code that is to be.

Others compile something else meanwhile, or wait. A claim is a courtesy, not a lock: where a disk takes none, or its
maker has died, the kernel is compiled twice and one of two equal files stays.
"""

from __future__ import annotations

import contextlib
import os
import platform
import time
from dataclasses import dataclass
from pathlib import Path

SUFFIX = ".claim"
LONGEST_S = 300.0
"""No kernel takes so long, on a busy machine either: an older claim was left behind."""
UNSIGNED_S = 5.0
"""A claim without a name for so long was made on a full disk, or by a process that was stopped just then."""
PATIENCE_S = 20.0
"""Whoever needs a kernel at once waits so long for another process, which may be starved, before compiling it, too."""
POLL_S = 0.05


@dataclass(frozen=True)
class Claim:
    """Of this process."""

    file: Path | None  # None: nothing could be written

    def release(self) -> None:
        """The code is there, or cannot be made."""
        if self.file is not None:
            with contextlib.suppress(OSError):
                self.file.unlink()


def take(code: Path) -> Claim | None:
    """Claim the file ``code``; None where another process has done so and is at work."""
    file = _file(code)
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
    for _ in range(2):
        try:
            handle = os.open(file, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o644)
        except FileExistsError:
            if _is_held(file):
                return None
            with contextlib.suppress(OSError):
                file.unlink()
        except OSError:
            return Claim(None)
        else:
            with contextlib.suppress(OSError), os.fdopen(handle, "w") as out:
                out.write(f"{platform.node()} {os.getpid()}")
            return Claim(file)
    return Claim(None)


def is_taken(code: Path) -> bool:
    """Whether another process compiles it."""
    return _is_held(_file(code))


def wait(code: Path, longest_s: float = PATIENCE_S) -> None:
    """Until no other process compiles it, or patience ends."""
    end = time.monotonic() + longest_s
    while is_taken(code) and time.monotonic() < end:
        time.sleep(POLL_S)


def _file(code: Path) -> Path:
    return code.with_name(code.name + SUFFIX)


def _is_held(file: Path) -> bool:
    """Whether its maker may still be at work: told by the process on this machine, by age on others."""
    try:
        age = time.time() - file.stat().st_mtime
        node, _, pid = file.read_text().rpartition(" ")
    except (OSError, ValueError):
        return False
    if age > LONGEST_S:
        return False
    if not pid.isdigit():
        return age < UNSIGNED_S
    if node != platform.node() or os.name != "posix":
        return True
    return int(pid) != os.getpid() and _runs(int(pid))


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # another user's
        return True
    return True
