"""A process that compiles kernels: ``python -m torchrender.kernels.worker``.

Reads lines of JSON (kernel, types) from its standard input and answers each with a line of JSON. It knows neither torch
nor scenes, so it starts quickly; and it needs pipes alone, no shared memory.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
from typing import TYPE_CHECKING, Any, TextIO

from torchrender.kernels.claims import is_taken
from torchrender.kernels.keys import cache_folder

if TYPE_CHECKING:
    from torchrender.kernels.compile import Kernel


def main() -> int:
    """Compile until standard input ends."""
    gc.disable()  # compilers make millions of objects and few cycles
    # A terminal interrupts the whole group; whoever started this process ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from torchrender.kernels.signatures import Use, kernel_of, types_of

    _tell(out, {"ready": True})
    for line in sys.stdin:
        task = json.loads(line)
        use = Use(task["kernel"], task["types"], 0.0, ())
        try:
            answer = _compile(kernel_of(use), types_of(use))
        except Exception as error:  # said by whoever asked; the kernel is compiled when it is needed
            told = str(error).splitlines()[0] if str(error) else ""
            answer = {"failed": f"{type(error).__name__}: {told}"}
        _tell(out, answer)
    return 0


def _compile(kernel: Kernel, kinds: tuple[Any, ...]) -> dict[str, object]:
    """Make a kernel be kept: ``made`` tells whether here; ``busy`` where another process is doing so."""
    if kernel.is_kept(kinds):
        return {"made": False}
    if is_taken(kernel.code_file(kinds)):
        return {"busy": True}
    # A module whose code calls a library of others says how to load it: without, the compiler would abort.
    getattr(sys.modules[kernel.py_func.__module__], "load_library", bool)()
    before = sum(kernel._cache_misses.values())
    kernel.compile(kinds)
    if not kernel.is_kept(kinds):
        return {"failed": f"it cannot be kept in {cache_folder()}"}
    return {"made": sum(kernel._cache_misses.values()) > before}


def _tell(out: TextIO, message: dict[str, object]) -> None:
    try:
        out.write(json.dumps(message) + "\n")
        out.flush()
    except BrokenPipeError:  # nobody waits any more
        os._exit(1)


if __name__ == "__main__":
    code = main()
    sys.stderr.flush()
    os._exit(code)
