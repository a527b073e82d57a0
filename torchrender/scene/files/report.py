"""What a file was read as: what is in it, what was repaired, and what was not used."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import NotUsedWarning, RepairedWarning
from torchrender.scene.files.texture_file import MissingTextureWarning

Array = np.ndarray[Any, Any]
UNKNOWN_NORMALS = "normals that are NaN or infinite: taken as not known"


@dataclass(frozen=True)
class Note:
    """One kind of thing, and how often it was met."""

    what: str
    count: int = 1

    def __str__(self) -> str:
        return f"{self.what} ({self.count})"


@dataclass(frozen=True)
class LoadReport:
    """The outcome of a load. Empty for a scene that was built, not read."""

    source: str = ""
    read: tuple[Note, ...] = ()
    repaired: tuple[Note, ...] = ()
    not_used: tuple[Note, ...] = ()

    def lines(self) -> list[str]:
        """One line for each part that has something to say."""
        parts = (("read", self.read), ("repaired", self.repaired), ("not used", self.not_used))
        return [f"{title}: {', '.join(map(str, notes))}" for title, notes in parts if notes]

    def __str__(self) -> str:
        return "; ".join(self.lines()) or "nothing to say"

    def __add__(self, other: LoadReport) -> LoadReport:
        """Both reports in one; counts of the same thing add up."""
        return LoadReport(
            self.source or other.source,
            *(_merged(getattr(self, n), getattr(other, n)) for n in ("read", "repaired", "not_used")),
        )

    def plain(self) -> dict[str, list[str]]:
        """Lists of text that JSON can hold."""
        return {n: [str(note) for note in getattr(self, n)] for n in ("read", "repaired", "not_used")}


NOTHING = LoadReport()


class Notes:
    """Collects what a reader meets; said once, in one warning of each kind."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read: Counter[str] = Counter()
        self._repaired: Counter[str] = Counter()
        self._unused: Counter[str] = Counter()
        self._missing: Counter[str] = Counter()

    def read(self, what: str, count: int = 1) -> None:
        """Something that was read."""
        if count:
            self._read[what] += count

    def repaired(self, what: str, count: int = 1) -> None:
        """Something that was not as it should be, and what was done."""
        if count:
            self._repaired[what] += count

    def not_used(self, what: str, count: int = 1) -> None:
        """Something that has no effect on the scene."""
        if count:
            self._unused[what] += count

    def missing(self, where: str, reason: str) -> None:
        """A picture, or a file of materials, that cannot be read: said at once, and not used."""
        told = f"{where}: {reason}; the plain colour is used"
        warnings.warn(f"{self._path}: {told}", MissingTextureWarning, stacklevel=3)
        self._missing[told] += 1

    def known_normals(self, values: Array) -> Array:
        """Normals (N,3) of a file, zero, which stands for "not known", where they are NaN or infinite."""
        wrong: Any = ~np.isfinite(values).all(axis=1)
        if not wrong.any():
            return values
        self.repaired(UNKNOWN_NORMALS, int(wrong.sum()))
        return np.where(wrong[:, None], 0.0, values).astype(values.dtype)

    def report(self) -> LoadReport:
        """What was collected."""
        unused = (*_notes(self._missing), *_notes(self._unused))
        return LoadReport(str(self._path), _notes(self._read), _notes(self._repaired), unused)

    def close(self) -> LoadReport:
        """The report, after warning about what was repaired and what was not used."""
        report = self.report()
        for title, notes, kind in (
            ("repaired", report.repaired, RepairedWarning),
            ("not used", _notes(self._unused), NotUsedWarning),  # what is missing was said
        ):
            if notes:
                warnings.warn(f"{self._path}: {title}: {', '.join(map(str, notes))}", kind, stacklevel=2)
        return report


def _notes(counter: Counter[str]) -> tuple[Note, ...]:
    return tuple(Note(what, count) for what, count in counter.items())


def _merged(first: tuple[Note, ...], second: tuple[Note, ...]) -> tuple[Note, ...]:
    total: Counter[str] = Counter()
    for note in (*first, *second):
        total[note.what] += note.count
    return _notes(total)
