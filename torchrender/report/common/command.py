"""The command line that all studies share."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from torchrender.report.common.parts import Parts, Unfinished, parts_of

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


def run_study(
    description: str | None,
    run: Callable[[Path, bool], Iterable[Path]],
    *,
    quick: str,
    argv: Sequence[str] | None = None,
) -> None:
    """The command of a study that ``run(folder, quick)`` measures and writes; names its files."""
    arguments = study_parser(description, quick=quick).parse_args(argv)
    write_named(arguments.output, lambda folder: run(folder, arguments.quick))


def write_named(folder: Path, write: Callable[[Path], Iterable[Path]]) -> None:
    """Have files written into a folder, which is made, and name them."""
    folder.mkdir(parents=True, exist_ok=True)
    for file in write(folder):
        sys.stdout.write(f"{file}\n")


def parts_parser(description: str | None, *, quick: str) -> argparse.ArgumentParser:
    """:func:`study_parser` of a study that takes long: with ``--seconds`` it ends early, and the next run goes on."""
    parser = study_parser(description, quick=quick)
    parser.add_argument("--seconds", type=float, help="begin no part after so long; run it again to go on")
    return parser


def write_in_parts(arguments: argparse.Namespace, write: Callable[[Path, Parts], Iterable[Path]], name: str) -> None:
    """Have a study written that :func:`parts_parser` was asked for.

    ``name``: of the file in ``build/studies`` that keeps what was measured.
    """
    parts = parts_of(f"{name}{'-quick' if arguments.quick else ''}", arguments.seconds)
    try:
        write_named(arguments.output, lambda folder: write(folder, parts))
    except Unfinished as unfinished:
        sys.exit(f"unfinished: {unfinished}")
    parts.done()


def run_in_parts(
    description: str | None,
    run: Callable[[Path, bool, Parts], Iterable[Path]],
    name: str,
    *,
    quick: str,
    argv: Sequence[str] | None = None,
) -> None:
    """:func:`run_study` of a study that takes long; see :func:`parts_parser` and :func:`write_in_parts`."""
    arguments = parts_parser(description, quick=quick).parse_args(argv)
    write_in_parts(arguments, lambda folder, parts: run(folder, arguments.quick, parts), name)
