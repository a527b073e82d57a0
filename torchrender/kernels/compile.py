"""How kernels are compiled, cached and threaded.

The cache folder of a kernel is keyed by the text of its file and of the kernel files that it imports: numba itself does
not notice when a helper in another file changes and would run stale code. ``NUMBA_CACHE_DIR`` overrides the place.
"""

from __future__ import annotations

import hashlib
import os
import re
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba import config as numba_config
from numba import njit

from torchrender import __version__

# Two threads that enter compiled code at once abort the process under the "workqueue" layer.
numba_config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]

_FOLDER = Path(__file__).parent
_IMPORT = re.compile(
    r"^\s*(?:from torchrender\.kernels(?P<inside>[\w.]*) import (?P<names>\([^)]*\)|[\w, ]+)"
    r"|import torchrender\.kernels\.(?P<whole>[\w.]+))",
    re.MULTILINE,
)


def _is_module(name: str) -> bool:
    return bool(name) and (_FOLDER / f"{name.replace('.', '/')}.py").is_file()


@cache
def _imported(name: str) -> frozenset[str]:
    """Kernel modules that the file of ``name`` imports, as dotted names below this folder."""
    found = set()
    for match in _IMPORT.finditer((_FOLDER / f"{name.replace('.', '/')}.py").read_text()):
        if match["whole"]:
            found.add(match["whole"])
            continue
        inside = match["inside"].lstrip(".")
        names = re.findall(r"(\w+)(?:\s+as\s+\w+)?", re.sub(r"#[^\n]*", "", match["names"]))
        found |= {inside, *(f"{inside}.{one}" if inside else one for one in names)}
    return frozenset(one for one in found if _is_module(one))


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
def cache_folder(name: str) -> Path:
    """Where the compiled kernels of module ``name``, such as ``raster.tiles``, are kept between processes."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named)
    digest = hashlib.sha256()
    for source in sorted(_sources(name)):
        digest.update((_FOLDER / f"{source.replace('.', '/')}.py").read_bytes())
    return _cache_base() / "torchrender" / __version__ / f"{name}-{digest.hexdigest()[:12]}"


def _module_name(file: str) -> str:
    """Dotted name below this folder; the bare stem of a file elsewhere, as in tests."""
    path = Path(file).resolve()
    inside = path.relative_to(_FOLDER.resolve()) if path.is_relative_to(_FOLDER.resolve()) else Path(path.name)
    return ".".join(inside.with_suffix("").parts)


@cache
def _cache_base() -> Path:
    """The user's cache folder; where that cannot be written (containers), a folder for temporary files."""
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    try:
        base.mkdir(parents=True, exist_ok=True)
    except OSError:
        return Path(tempfile.gettempdir())
    return base if os.access(base, os.W_OK) else Path(tempfile.gettempdir())


def kernel(*, parallel: bool = False, inline: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Decorator for a compiled loop: cached, no ``fastmath`` (comparisons decide visibility), C division rules.

    ``inline`` makes LLVM inline it into its callers: worth its compile time for small functions in hot loops, because
    arrays that cross a real call are reference counted.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        before = numba_config.CACHE_DIR
        numba_config.CACHE_DIR = str(cache_folder(_module_name(function.__code__.co_filename)))
        try:
            options: dict[str, Any] = {"cache": True, "error_model": "numpy", "nogil": True, "parallel": parallel}
            if inline:
                options["forceinline"] = True
            return njit(**options)(function)
        finally:
            numba_config.CACHE_DIR = before

    return decorate


def thread_count() -> int:
    """Threads that parallel kernels use now."""
    return int(numba.get_num_threads())
