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
from typing import TextIO


def main() -> int:
    """Compile until standard input ends."""
    gc.disable()  # compilers make millions of objects and few cycles
    # A terminal interrupts the whole group; whoever started this process ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    from torchrender.kernels.keys import cache_folder
    from torchrender.kernels.signatures import Use, kernel_of, types_of

    _tell(out, {"ready": True})
    for line in sys.stdin:
        task = json.loads(line)
        use = Use(task["kernel"], task["types"], 0.0, ())
        try:
            kernel, kinds = kernel_of(use), types_of(use)
            # A module whose code calls a library of others says how to load it: without, the compiler would abort.
            getattr(sys.modules[kernel.py_func.__module__], "load_library", bool)()
            kernel.compile(kinds)
        except Exception as error:  # said by whoever asked; the kernel is compiled when it is needed
            _tell(out, {"failed": f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}"})
        else:
            kept = kernel.is_kept(kinds)
            _tell(out, {"done": True} if kept else {"failed": f"it cannot be kept in {cache_folder()}"})
    return 0


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
