"""Compiled kernels on disk: one file for each function, signature, processor and version of the compiler.

Numba's own cache has an index file per function, which two processes that compile at once can make point at each
other's code. Here the name of a file is a digest of all that its code depends on, and files appear whole or not at all:
any number of processes, and machines with other processors, may share a folder, on a network disk, too.
"""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import pickle
import sys
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import _Cache
from numba.core.serialize import dumps

from torchrender.kernels.keys import cache_folder, read_folders
from torchrender.kernels.libraries import rebuild

LOG = logging.getLogger("torchrender.kernels")
SUFFIX = ".code"
UNFINISHED = ".part"
_VERSIONS = (numba.__version__, llvmlite.__version__, *sys.version_info[:2], getattr(sys, "abiflags", ""))
SLOW_S = 2.0
"""To read the code of one kernel."""
MARKED_S = 86400.0
_slow: set[Path] = set()
_unwritable: list[str] = []
"""Why nothing is kept any more; one reason is enough to stop trying."""

Missed = Callable[[tuple[Any, ...]], bool]


class CodeStore(_Cache):
    """The files of one function with one set of options.

    Args:
        name: of the module and the function, such as ``raster.tiles.draw``.
        key: digest of the text and the options that go into the code.
        missed: told the types of arguments for which there is no file, before they are compiled; returns whether it is
            worth looking again.
    """

    def __init__(self, name: str, key: str, missed: Missed | None = None) -> None:
        self._name = name
        self._key = key
        self._missed = missed

    @property
    def cache_path(self) -> str:
        """Where files are written."""
        return str(cache_folder() / self._folder)

    @property
    def _folder(self) -> str:
        return self._name.rpartition(".")[0] or "other"

    def file_name(self, arguments: tuple[Any, ...], target: Any) -> str:
        """Below each folder of code."""
        told = repr((self._key, _VERSIONS, target.codegen().magic_tuple(), [str(one) for one in arguments]))
        digest = hashlib.sha256(told.encode()).hexdigest()[:24]
        return f"{self._folder}/{self._name.rpartition('.')[2]}-{digest}{SUFFIX}"

    def path(self, arguments: tuple[Any, ...], target: Any) -> Path:
        """Where the code for these types of arguments is written."""
        return cache_folder() / self.file_name(arguments, target)

    def has(self, arguments: tuple[Any, ...], target: Any) -> bool:
        """Whether the code for these types of arguments is there."""
        name = self.file_name(arguments, target)
        return any((folder / name).is_file() for folder in read_folders())

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """What was compiled, or None."""
        arguments = tuple(getattr(sig, "args", sig))
        target_context.refresh()
        found = self._load(arguments, target_context)
        if found is None and self._missed is not None and self._missed(arguments):
            return self._load(arguments, target_context)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled. A disk that is full or cannot be written is said once and costs no picture."""
        if _unwritable or data.lifted or data.library.has_dynamic_globals:
            return
        arguments = tuple(getattr(sig, "args", sig))
        path = self.path(arguments, data.target_context)
        try:
            write_whole(path, dumps((arguments, data._reduce())))
        except OSError as error:
            _unwritable.append(str(error))
            reason = error.strerror or str(error)
            LOG.warning(
                "compiled kernels cannot be kept in %s (%s): every process compiles them again", path.parent, reason
            )

    def enable(self) -> None:
        """It always is."""

    def disable(self) -> None:
        """Nobody does."""

    def flush(self) -> None:
        """Nothing waits."""

    def _load(self, arguments: tuple[Any, ...], target: Any) -> Any:
        name = self.file_name(arguments, target)
        for folder in read_folders():
            begin = time.monotonic()
            try:
                data = (folder / name).read_bytes()
            except OSError:
                continue
            _note_slow(folder, time.monotonic() - begin)
            _mark_used(folder / name)
            try:
                kept, payload = pickle.loads(data)
                if tuple(kept) == arguments:
                    return rebuild(target, payload)
            except Exception as error:  # a damaged file may raise anything; compiling anew replaces it
                LOG.info("%s cannot be read (%s: %s)", folder / name, type(error).__name__, error)
        return None


def _note_slow(folder: Path, took_s: float) -> None:
    """Say once that reading, which should take milliseconds, is what takes the time."""
    if took_s > SLOW_S and folder not in _slow:
        _slow.add(folder)
        LOG.warning(
            "compiled kernels are read slowly from %s (%.1f s for one): NUMBA_CACHE_DIR names another folder",
            folder,
            took_s,
        )


def _mark_used(file: Path) -> None:
    """So that it is not removed as unused; not more often than once a day."""
    with contextlib.suppress(OSError):
        if time.time() - file.stat().st_mtime > MARKED_S:
            os.utime(file)


def write_whole(path: Path, data: bytes) -> None:
    """Write a file that appears complete or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{uuid.uuid4().hex[:12]}{UNFINISHED}")
    try:
        part.write_bytes(data)
        os.replace(part, path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
