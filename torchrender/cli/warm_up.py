"""The command ``torchrender warm-up``, and what the other commands do and tell when kernels are not compiled yet."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import Any

from torchrender.errors import OptionError

GROUPS = ("render", "points", "voxels", "serve")
FEW = 3
"""Kernels that are not worth further processes."""
EVERY_S = 2.0
"""A line about progress where no terminal shows a bar."""
_NEEDS = {"points": ("points",), "voxelize": ("voxels",), "depth": ("render.depth", "render.any")}
"""Parts that commands need; others make pictures."""


def add_warm_up(commands: Any) -> None:
    """Describe the command to the parser."""
    parser = commands.add_parser("warm-up", help="compile kernels before they are needed, on all cores")
    parser.add_argument(
        "--for",
        dest="groups",
        metavar="WHAT",
        help=f"{', '.join(GROUPS)}, or several with commas between them (default: everything, all settings included)",
    )


def warm_up_command(arguments: argparse.Namespace) -> None:
    """Run the command."""
    from torchrender.kernels.keys import cache_folder
    from torchrender.kernels.warm_up import missing, warm_up

    wanted = () if arguments.groups is None else tuple(one.strip() for one in arguments.groups.split(","))
    unknown = [one for one in wanted if one not in GROUPS]
    if unknown:
        raise OptionError(f"--for must be of {', '.join(GROUPS)}, got {unknown[0]!r}")
    begin = time.monotonic()
    outcome = warm_up(missing(wanted), Bar())
    for failure in outcome.failed:
        sys.stderr.write(f"torchrender: warning: not compiled: {failure}\n")
    took = f" in {time.monotonic() - begin:.0f} s" if outcome.compiled else ""
    print(f"{outcome.compiled} kernels compiled{took}; kept in {cache_folder()}")


class Bar:
    """Progress on stderr: a bar on a terminal, else a line now and then."""

    def __init__(self) -> None:
        self._said = float("-inf")
        self._begun = False

    def __call__(self, done: int, total: int) -> None:
        """As ``warm_up`` tells it."""
        if total == 0:
            return
        text = f"compiling kernels, once: {done} of {total}"
        now = time.monotonic()
        if sys.stderr.isatty():
            filled = 24 * done // total
            end = "\n" if done == total else ""
            sys.stderr.write(f"\r[{'#' * filled}{'.' * (24 - filled)}] {text}{end}")
        elif done == total or now - self._said >= EVERY_S:
            self._said = now
            sys.stderr.write(f"{text}\n")
        sys.stderr.flush()


class ColdStart:
    """Asked before a kernel is compiled: has what else the command needs compiled at the same time, and says so."""

    def __init__(self) -> None:
        self.start("")

    def start(self, command: str) -> None:
        """Begin a command."""
        self._command = command
        self.plan: Callable[[], list[str]] | None = None  # names of the passes of the picture, once that is known
        self._wider = False
        self._told = False

    def __call__(self, kernel: str) -> bool:
        """Whether the kernel may have been compiled meanwhile."""
        from torchrender.kernels.keys import cache_folder
        from torchrender.kernels.warm_up import expected_seconds, missing, warm_up

        parts = self._parts()
        uses = missing(parts)
        if not any(use.kernel == kernel for use in uses):
            # Other settings than the usual ones: what these need, too, and after that one by one.
            uses = [] if self._wider else missing({f"{part}.more" for part in parts})
            self._wider = True
        few = len(uses) <= FEW or not any(use.kernel == kernel for use in uses)
        if few and self._told:
            return False
        seconds = max(1.0, expected_seconds(uses) if not few else 3.0)
        sys.stderr.write(f"compiling kernels, once, about {seconds:.0f} s; kept in {cache_folder()}\n")
        sys.stderr.flush()
        self._told = True
        if few:
            return False
        warm_up(uses, Bar())
        return True

    def _parts(self) -> set[str]:
        if self._command in _NEEDS:
            return set(_NEEDS[self._command])
        if self.plan is None:
            return {"render"}
        plan, self.plan = self.plan, None  # planning may ask for kernels itself
        try:
            return {"render.any", *(f"render.{name}" for name in plan())}
        finally:
            self.plan = plan
