"""Where compiled kernels are kept, and what names them: the text that goes into the code.

The key of a kernel module is made of its own file and of the kernel files that it imports, at any depth: numba itself
does not notice when a helper in another file changes and would run stale code. The version of this package is no part
of it, nor is the file of the decorator (only the options that it passes on are): what did not change is not compiled
again after an upgrade.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import stat
import tempfile
import threading
from functools import cache
from pathlib import Path

_FOLDER = Path(__file__).parent
_IMPORT = re.compile(
    r"^\s*(?:from torchrender\.kernels(?P<inside>[\w.]*) import (?P<names>\([^)]*\)|[\w, ]+)"
    r"|import torchrender\.kernels\.(?P<whole>[\w.]+))",
    re.MULTILINE,
)
_NO_CODE = frozenset({"claims", "compile", "front_end", "hooks", "keys", "libraries", "store"})
"""Modules that make no machine code: the decorator and what it needs."""
ANSWER_S = 5.0
"""A disk that says nothing for so long is not asked again."""
LOG = logging.getLogger("torchrender.kernels")
FURTHER = "TORCHRENDER_KERNELS"
"""Environment variable: a further folder of compiled kernels, which is only read, as an image of a container has it."""


def _file(name: str) -> Path:
    return _FOLDER / f"{name.replace('.', '/')}.py"


def _is_module(name: str) -> bool:
    return bool(name) and _file(name).is_file()


@cache
def _text(name: str) -> bytes:
    return _file(name).read_bytes()


@cache
def _imported(name: str) -> frozenset[str]:
    """Kernel modules that the file of ``name`` imports, as dotted names below this folder."""
    return _named_in(_text(name))


def _named_in(text: bytes) -> frozenset[str]:
    """Kernel modules that a Python file of this text imports."""
    found = set()
    for match in _IMPORT.finditer(text.decode()):
        if match["whole"]:
            found.add(match["whole"])
            continue
        inside = match["inside"].lstrip(".")
        names = re.findall(r"(\w+)(?:\s+as\s+\w+)?", re.sub(r"#[^\n]*", "", match["names"]))
        found |= {inside, *(f"{inside}.{one}" if inside else one for one in names)}
    return frozenset(one for one in found - _NO_CODE if _is_module(one))


@cache
def _sources(name: str) -> frozenset[str]:
    """Dotted names of the kernel modules that ``name`` depends on, itself included."""
    found: set[str] = set()
    waiting = {name}
    while waiting:
        here = waiting.pop()
        found.add(here)
        waiting |= _imported(here) - found
    return frozenset(found)


@cache
def module_key(name: str) -> str:
    """Digest of all text that goes into the kernels of module ``name``, such as ``raster.tiles``."""
    digest = hashlib.sha256()
    for source in sorted(_sources(name)):
        text = _text(source)
        digest.update(f"{source} {len(text)}\n".encode())
        digest.update(text)
    return digest.hexdigest()[:16]


def file_key(file: str) -> str:
    """The same for a file elsewhere, as in tests: its own text, and that of the kernel modules that it imports."""
    text = Path(file).read_bytes()
    digest = hashlib.sha256(text)
    for name in sorted(_named_in(text)):
        digest.update(module_key(name).encode())
    return digest.hexdigest()[:16]


def module_name(file: str) -> str | None:
    """Dotted name below this folder; None for a file elsewhere."""
    path = Path(file)
    if not path.is_relative_to(_FOLDER):
        path, folder = path.resolve(), _FOLDER.resolve()
        if not path.is_relative_to(folder):
            return None
        return ".".join(path.relative_to(folder).with_suffix("").parts)
    return ".".join(path.relative_to(_FOLDER).with_suffix("").parts)


@cache
def cache_folder() -> Path:
    """Where compiled kernels are written.

    ``NUMBA_CACHE_DIR`` if that is set, else below the user's cache folder; where that cannot be written (a home that
    is read-only, containers) or does not answer (a network disk whose server is gone), a folder of this user's own for
    temporary files.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    wanted = Path(named) if named else _home_folder()
    if not _answers(wanted):
        instead = _temporary_folder()
        LOG.warning("%s does not answer: compiled kernels are kept in %s", wanted, instead)
        return instead
    return wanted if named or _can_write(wanted) else _temporary_folder()


@cache
def read_folders() -> tuple[Path, ...]:
    """All places to look for compiled kernels, the one that is written first."""
    places = [cache_folder()]
    if not os.environ.get("NUMBA_CACHE_DIR"):
        places.append(_home_folder())
    if os.environ.get(FURTHER):
        places.append(Path(os.environ[FURTHER]))
    return tuple(one for one in dict.fromkeys(places) if _answers(one))


@cache
def _answers(folder: Path) -> bool:
    """Whether the disk says anything about a folder: a call to a network disk that is gone may never return."""
    asking = threading.Thread(target=os.access, args=(folder, os.R_OK), daemon=True)
    asking.start()
    asking.join(ANSWER_S)
    return not asking.is_alive()


def _home_folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "torchrender" / "kernels"
    except RuntimeError:  # no home is known
        return _temporary_folder()


def _can_write(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _temporary_folder() -> Path:
    """Code from this folder is run, so nobody else may write it: else one that lasts as long as the process."""
    owner = os.getuid() if hasattr(os, "getuid") else 0
    folder = Path(tempfile.gettempdir()) / f"torchrender-kernels-{owner}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        safe = stat.S_ISDIR(found.st_mode) and found.st_uid == owner and not found.st_mode & 0o022
        if safe or not hasattr(os, "getuid"):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="torchrender-kernels-"))
