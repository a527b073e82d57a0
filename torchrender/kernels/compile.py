"""How kernels are compiled, cached and threaded.

A kernel has two sides. Called from Python it needs a wrapper that unpacks Python objects; called from other kernels it
does not, and most kernels are called from kernels alone. Each side is compiled when it is first used, so that no
wrapper is made in vain and a helper may still be called from anywhere.
"""

from __future__ import annotations

import hashlib
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba import config as numba_config
from numba.core import types
from numba.core.compiler import Compiler
from numba.core.registry import CPUDispatcher
from numba.np.ufunc import parallel as numba_parallel

from torchrender.clock import garbage_left
from torchrender.errors import ForkError
from torchrender.kernels.claims import Claim, take, wait
from torchrender.kernels.front_end import shorten
from torchrender.kernels.hooks import is_dealt_with
from torchrender.kernels.keys import cache_folder, file_key, module_key, module_name
from torchrender.kernels.libraries import KernelCompiler, is_used, link_overloads
from torchrender.kernels.store import CodeStore

# Two threads that enter compiled code at once abort the process under the "workqueue" layer.
numba_config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]
if is_used():
    shorten()
    link_overloads()

LOG = logging.getLogger("torchrender.kernels")


class Kernel(CPUDispatcher):
    """A compiled function, and the same function as other kernels call it."""

    loads = 0  # of all kernels so far: compiled, or read from disk

    def __init__(self, py_func: Any, locals: Any = None, targetoptions: Any = None, *, seen: bool = True) -> None:
        options = {**(targetoptions or {}), "no_cfunc_wrapper": True}
        if not seen:
            options["no_cpython_wrapper"] = True
        super().__init__(py_func, locals or {}, options, KernelCompiler if is_used() else Compiler)
        self._seen = not options.get("no_cpython_wrapper", False)
        self._inside: Kernel | None = None
        self._store: CodeStore | None = None
        self._claim: Claim | None = None

    @property
    def kernel_name(self) -> str:
        """Module below ``torchrender.kernels`` and function, such as ``raster.tiles.draw``."""
        code = self.py_func.__code__
        return f"{module_name(code.co_filename) or 'other'}.{self.py_func.__qualname__}".replace(".<locals>", "")

    @property
    def _cache(self) -> CodeStore:
        """Made when first needed: a process uses a few of all kernels."""
        if self._store is None:
            code = self.py_func.__code__
            module = module_name(code.co_filename)
            text = file_key(code.co_filename) if module is None else module_key(module)
            options = sorted((k, repr(v)) for k, v in self.targetoptions.items())
            closed = [repr(cell.cell_contents) for cell in self.py_func.__closure__ or ()]
            told = repr((text, options, is_used(), self.py_func.__qualname__, code.co_firstlineno, closed))
            missed = self._missed if self._seen else None
            self._store = CodeStore(self.kernel_name, hashlib.sha256(told.encode()).hexdigest(), missed)
        return self._store

    @_cache.setter
    def _cache(self, value: Any) -> None:
        """The class above sets one that keeps nothing."""

    @property
    def inside(self) -> Kernel:
        """What other kernels call: never put into the table that Python's calls look at."""
        if not self._seen:
            return self
        if self._inside is None:
            self._inside = Kernel(self.py_func, self.locals, self.targetoptions, seen=False)
        return self._inside

    @property
    def is_compiling(self) -> bool:
        """Either side."""
        inside = self._inside
        return bool(self._compiling_counter) or (inside is not None and inside.is_compiling)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """For a call from another kernel: constants are numbers like any others, so that all share one code."""
        if self._seen:
            return self.inside.get_call_template(args, kws)
        args = tuple(_without_value(one) for one in args)
        return super().get_call_template(args, {name: _without_value(one) for name, one in kws.items()})

    def get_overload(self, sig: Any) -> Any:
        """For a call from another kernel."""
        return super().get_overload(sig) if not self._seen else self.inside.get_overload(sig)

    def compile(self, sig: Any) -> Any:
        """For these types of arguments; other processes that want the same wait meanwhile."""
        Kernel.loads += 1
        try:
            with garbage_left():  # compilers make millions of objects and few cycles
                return super().compile(sig)
        finally:
            claim, self._claim = self._claim, None
            if claim is not None:
                claim.release()

    def code_file(self, arguments: tuple[Any, ...]) -> Path:
        """Where the code for these types of arguments is kept."""
        return self._cache.path(arguments, self.targetctx)

    def is_kept(self, arguments: tuple[Any, ...]) -> bool:
        """Whether the code for these types of arguments is on disk."""
        return self._cache.has(arguments, self.targetctx)

    def _missed(self, arguments: tuple[Any, ...]) -> bool:
        """Before a call from Python has to wait for the compiler; whether the code may be there now."""
        if is_dealt_with(self.kernel_name) and self.is_kept(arguments):
            return True
        file = self.code_file(arguments)
        self._claim = take(file)
        if self._claim is None:
            LOG.info("waiting for %s, which another process compiles", self.kernel_name)
            wait(file)
            self._claim = take(file)
        if self.is_kept(arguments):
            return True
        LOG.info("compiling %s, once; kept in %s", self.kernel_name, cache_folder())
        return False


def _without_value(kind: Any) -> Any:
    """The type of a number that is known while compiling, as of one that is not; other types as they are."""
    return types.unliteral(kind) if isinstance(kind, types.IntegerLiteral | types.BooleanLiteral) else kind


def kernel(
    *, parallel: bool = False, inline: bool = False, counted: bool = True
) -> Callable[[Callable[..., Any]], Any]:
    """Decorator for a compiled loop: cached, no ``fastmath`` (comparisons decide visibility), C division rules.

    ``inline`` makes LLVM inline it into its callers: worth its compile time for small functions in hot loops, because
    arrays that cross a real call are reference counted. Unless ``counted`` is False: for what kernels alone call, with
    arrays that these keep alive, and that makes none.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        if numba_config.DISABLE_JIT:
            return function
        options = options_of(parallel=parallel, counted=counted)
        if inline:
            options["forceinline"] = True
        return Kernel(function, targetoptions=options)

    return decorate


def options_of(*, parallel: bool = False, counted: bool = True) -> dict[str, Any]:
    """How numba compiles all of them."""
    options = {"nopython": True, "error_model": "numpy", "nogil": True, "parallel": parallel, "boundscheck": None}
    return options if counted else {**options, "_nrt": False}


def _refuse(self: Kernel, *_: Any, **__: Any) -> Any:
    raise ForkError(
        f"{self.kernel_name} cannot run in a forked process: the threads that its parent had computed with do not "
        'survive a fork. Start workers by spawn: torch.multiprocessing.get_context("spawn"), or in a DataLoader '
        'multiprocessing_context="spawn"'
    )


def _after_fork() -> None:
    """In a forked process: OpenMP would end it at the first parallel loop, without a word of ours."""
    if not numba_parallel._is_initialized:  # its parent's threads had not run
        return
    Kernel.__call__ = _refuse
    # What torch computes on the way to the first kernel would wait for threads that are not there.
    torch = sys.modules.get("torch")
    if torch is not None:
        torch.set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def thread_count() -> int:
    """Threads that parallel kernels use now."""
    return int(numba.get_num_threads())
