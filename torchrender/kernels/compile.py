"""How kernels are compiled, cached and threaded.

The cache folder is keyed by the text of all kernels: numba itself does not notice when a helper in another file
changes and would run stale code. ``NUMBA_CACHE_DIR`` overrides the place.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import config as numba_config
from numba import njit
from torch import Tensor

from torchrender import __version__

# Two threads that enter compiled code at once abort the process under the "workqueue" layer.
numba_config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]


def _source_key() -> str:
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def cache_folder() -> Path:
    """Where compiled kernels are kept between processes."""
    named = os.environ.get("NUMBA_CACHE_DIR")
    if named:
        return Path(named)
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "torchrender" / f"{__version__}-{_source_key()}"


_CACHE = str(cache_folder())


def kernel(*, parallel: bool = False, inline: bool = False) -> Callable[[Callable[..., Any]], Any]:
    """Decorator for a compiled loop: cached, no ``fastmath`` (comparisons decide visibility), C division rules."""

    def decorate(function: Callable[..., Any]) -> Any:
        before = numba_config.CACHE_DIR
        numba_config.CACHE_DIR = _CACHE
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


def view(tensor: Tensor, dtype: type | np.dtype[Any]) -> np.ndarray[Any, Any]:
    """A contiguous numpy view of a CPU tensor, copied only where type or layout differ."""
    return np.ascontiguousarray(tensor.detach().cpu().numpy(), dtype=dtype)
