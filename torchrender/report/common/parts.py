"""Studies that are measured in pieces: what one run measured, the next takes over."""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record

FOLDER = Path("build") / "studies"


class Unfinished(Exception):
    """The time is over before all parts are measured."""


class Parts:
    """Records of a study by part, in memory, or in a file for the next run at the same commit."""

    def __init__(self, file: Path | None = None, seconds: float = math.inf) -> None:
        """``seconds``: after these no part is begun."""
        self._file, self._end = file, time.monotonic() + seconds
        self._commit = str(machine_record()["commit"])
        self._known: dict[str, Any] = {}
        if file is not None and file.exists():
            kept = json.loads(file.read_text())
            if kept["commit"] == self._commit:
                self._known = kept["parts"]

    def measured(self, name: str, measure: Callable[[], Any]) -> Any:
        """The record of a part, as JSON has it: an earlier run's, else measured now.

        Raises:
            Unfinished: there is no time left for it.
        """
        if name not in self._known:
            if time.monotonic() > self._end:
                raise Unfinished(f"{len(self._known)} parts are measured and kept, {name} and what follows are not")
            begin = time.perf_counter()
            self._known[name] = json.loads(json.dumps(measure(), default=float))
            sys.stderr.write(f"{name}: {time.perf_counter() - begin:.1f} s\n")
            if self._file is not None:
                self._file.parent.mkdir(parents=True, exist_ok=True)
                write_record(self._file, {"commit": self._commit, "parts": self._known})
        return self._known[name]

    def done(self) -> None:
        """The study is written: nothing is left to take over."""
        if self._file is not None:
            self._file.unlink(missing_ok=True)


def parts_of(name: str, seconds: float | None) -> Parts:
    """Of the study of that name: kept in a file where a run may end early, after so many seconds."""
    return Parts() if seconds is None else Parts(FOLDER / f"{name}.json", seconds)
