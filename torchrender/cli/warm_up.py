"""The command ``torchrender warm-up``, and what the other commands do and tell when kernels are not compiled yet."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from torchrender.errors import OptionError

if TYPE_CHECKING:
    from torchrender.kernels.signatures import Use
    from torchrender.kernels.warm_up import Compilation

GROUPS = ("render", "depth", "points", "voxels", "serve")
FEW = 3
"""Kernels that are not worth further processes."""
EVERY_S = 2.0
"""A line about progress where no terminal shows a bar."""
_NEEDS = {"points": ("points",), "voxelize": ("voxels",), "depth": ("depth",)}
"""Parts that commands need; others make pictures."""
FIRST = ("render.any", "render.gbuffer")
"""What every picture needs: compiled while the scene is loaded and the picture is planned."""
FILES = "render.files"
"""What some files of scenes need while they are read."""
SIGN = "raster.tiles"
"""Folder of code without which no picture was made yet."""


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
        self._work: Compilation | None = None
        self.start("")

    def start(self, command: str) -> None:
        """Begin a command."""
        self.stop()
        self._command = command
        self.plan: Callable[[], list[str]] | None = None  # names of the passes of the picture, once that is known
        self._planned: set[str] | None = None
        self._wider = False
        self._told = False

    def begin(self, *, reads_file: bool) -> None:
        """A picture will be made: where nothing is compiled yet, begin with what every picture needs, and what reading
        a file may need.
        """
        from torchrender.kernels.keys import read_folders

        if any(any((folder / SIGN).glob("*.code")) for folder in read_folders()):
            return
        from torchrender.kernels.signatures import recorded
        from torchrender.kernels.warm_up import expected_seconds, missing

        self._tell(expected_seconds(use for use in recorded() if use.serves({"render"})))
        self._add(missing((*FIRST, FILES) if reads_file else FIRST))

    def stop(self) -> None:
        """End a command: what was not needed in the end is not compiled."""
        if self._work is not None:
            self._work.stop()
            self._work = None

    def __call__(self, kernel: str) -> bool:
        """Whether the kernel may have been compiled meanwhile."""
        from torchrender.kernels.warm_up import expected_seconds, missing

        def is_among(uses: list[Use]) -> bool:
            return any(use.kernel == kernel for use in uses)

        parts = self._parts(kernel)
        uses = missing(parts)
        if not is_among(uses) and not self._wider:
            # Other settings than the usual ones: what these need, too, and after that one by one.
            self._wider = True
            uses = missing({f"{part}.more" for part in parts})
        if not is_among(uses):
            uses = []
        if self._work is None and len(uses) <= FEW:
            self._tell(3.0)
            return False
        self._tell(expected_seconds(uses))
        return self._add(uses).wait_for(kernel)

    def _add(self, uses: list[Use]) -> Compilation:
        """Have these compiled, too."""
        from torchrender.kernels.warm_up import Compilation

        if self._work is None:
            self._work = Compilation(Bar())
        if uses:
            self._work.add(uses)
        return self._work

    def _tell(self, seconds: float) -> None:
        """Once for a command."""
        if self._told:
            return
        from torchrender.kernels.keys import cache_folder

        self._told = True
        sys.stderr.write(f"compiling kernels, once, about {max(seconds, 1.0):.0f} s; kept in {cache_folder()}\n")
        sys.stderr.flush()

    def _parts(self, kernel: str) -> set[str]:
        """What the command needs, as far as is known now."""
        from torchrender.kernels.signatures import recorded

        if self._command in _NEEDS:
            return set(_NEEDS[self._command])
        if self._planned is not None:
            return self._planned
        if self.plan is not None:
            plan, self.plan = self.plan, None  # planning may ask for kernels itself
            try:
                self._planned = {"render.any", *(f"render.{name}" for name in plan())}
                return self._planned
            finally:
                self.plan = plan
        known = (set(FIRST), {FILES})
        return next((p for p in known if any(u.kernel == kernel and u.serves(p) for u in recorded())), {"render"})
