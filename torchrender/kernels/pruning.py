"""Compiled kernels that nobody has used for long are removed: of earlier versions, other compilers, other processors.

Reading a file of code marks it as used (:mod:`.store`), so what any version on any machine still reads stays, whoever
prunes. Processes that run have their code in memory; one that starts again after so long compiles it again.
"""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

from torchrender.kernels import claims
from torchrender.kernels.keys import cache_folder, module_key
from torchrender.kernels.store import SUFFIX, UNFINISHED

UNUSED_S = 60 * 86400.0
"""Time without use after which code is removed."""
EVERY_S = 86400.0
"""Looking through the folder is not worth it more often."""
OLD_S = 3600.0
"""A file that is unfinished for so long was left by a process that was stopped."""
MARK = "pruned"
_FOREIGN = re.compile(r"callbacks-[0-9a-f]+")
"""Folders that the compiler itself fills, below this one; the one that this version uses stays."""
_EARLIER = re.compile(r"\d+\.\d+(\.\w+)*")
"""Folders beside this one, of versions that had one each."""
_COMPILERS = frozenset({".nbi", ".nbc"})


def prune(unused_s: float = UNUSED_S) -> int:
    """Remove what was not used for ``unused_s``, at most once a day; returns the number of files.

    Only files that this package or the compiler made for it are touched. A disk that refuses keeps them.
    """
    folder, now = cache_folder(), time.time()
    with contextlib.suppress(OSError):
        _remove(_old(folder.glob(f"*/*{UNFINISHED}"), now - OLD_S))
        _remove(_old(folder.glob(f"*/*{claims.SUFFIX}"), now - OLD_S))
        mark = folder / MARK
        if not folder.is_dir() or (mark.exists() and now - mark.stat().st_mtime < EVERY_S):
            return 0
        mark.touch()
        count = _remove(_old(folder.glob(f"*/*{SUFFIX}"), now - unused_s))
        return count + sum(_remove_folder(one, now - unused_s) for one in _whole_folders(folder))
    return 0


def _whole_folders(folder: Path) -> Iterator[Path]:
    """That are removed when nothing in them was used: their files belong together."""
    own = f"callbacks-{module_key('rays.embree')}"
    yield from (one for one in folder.iterdir() if _FOREIGN.fullmatch(one.name) and one.is_dir() and one.name != own)
    if folder.name == "kernels" and folder.parent.name == "torchrender":
        yield from (one for one in folder.parent.iterdir() if _EARLIER.fullmatch(one.name) and one.is_dir())


def _remove_folder(folder: Path, before: float) -> int:
    files = [one for one in folder.rglob("*") if one.is_file()]
    if any(one.suffix not in _COMPILERS for one in files) or len(list(_old(files, before))) < len(files):
        return 0
    count = _remove(files)
    for one in sorted((p for p in folder.rglob("*") if p.is_dir()), reverse=True):
        with contextlib.suppress(OSError):
            one.rmdir()
    with contextlib.suppress(OSError):
        folder.rmdir()
    return count


def _old(files: Iterator[Path] | list[Path], before: float) -> Iterator[Path]:
    """Those that were neither written nor read since; disks that do not note reading say when they were written."""
    for one in files:
        with contextlib.suppress(OSError):
            found = os.lstat(one)
            if max(found.st_mtime, found.st_atime) < before:
                yield one


def _remove(files: Iterator[Path] | list[Path]) -> int:
    count = 0
    for one in list(files):
        with contextlib.suppress(OSError):
            one.unlink()
            count += 1
    return count
