"""The command line that all studies share."""

from __future__ import annotations

import argparse
from pathlib import Path

RESULTS = Path("docs/results")


def study_parser(
    description: str | None, *, quick: str | None = None, output: Path = RESULTS
) -> argparse.ArgumentParser:
    """A parser with ``--quick`` (``quick`` says what that does; None: there is no such thing) and ``-o``.

    ``description`` is the study's docstring, of which the first line is shown.
    """
    parser = argparse.ArgumentParser(description=(description or "").partition("\n")[0] or None)
    if quick is not None:
        parser.add_argument("--quick", action="store_true", help=quick)
    what = "file" if output.suffix else "folder"
    parser.add_argument(
        "-o", "--output", type=Path, default=output, help=f"{what} to write (default {output.as_posix()})"
    )
    return parser
