"""The program ``torchrender``, and ``python -m torchrender.cli``."""

from __future__ import annotations

import gc
import os
import sys

from torchrender.cli.main import main
from torchrender.cli.output import LASTING


def run() -> None:
    """Run the command line and end the process.

    Most commands last seconds: they do without garbage collection until they make a second picture, and end without
    taking the interpreter and its libraries apart, which takes longer than a picture.
    """
    if LASTING.intersection(sys.argv[1:]):
        sys.exit(main())
    gc.disable()
    try:
        code = main()
    except SystemExit as error:  # as argparse ends
        if not isinstance(error.code, int | None):
            raise
        code = error.code or 0
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # nobody reads any more
            code = code or 1
    os._exit(code)


if __name__ == "__main__":
    run()
