"""Files beside the one that is written: they take names of their own, never those of files that others made."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

MARK = "# beside: "
"""Begins the lines, at the top of a scene file, that tell what was written beside it: a digest and a name."""


class Beside:
    """Names for the files beside a text file, and the lines in it by which its next writer knows them again.

    A file that is there is written over only where an earlier writer of the same text file made it, and nobody has
    changed it since; else the new one is numbered.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._known = path, _noted(path)
        self.files: list[Path] = []

    def place(self, ending: str) -> Path:
        """Where a file of this ending goes: ``.glb`` is ``room.glb`` beside ``room.toml``, or ``room_2.glb`` …"""
        number, place = 1, self._path.with_name(self._path.stem + ending)
        bare, dot, suffix = ending.rpartition(".")
        while place in self.files or (os.path.lexists(place) and self._known.get(place.name) != _digest(place)):
            number += 1
            place = self._path.with_name(f"{self._path.stem}{bare}_{number}{dot}{suffix}")
        self.files.append(place)
        return place

    def lines(self) -> list[str]:
        """What the text file begins with, once all files are written."""
        return [f"{MARK}{_digest(file)} {json.dumps(file.name)}" for file in self.files]


def _noted(path: Path) -> dict[str, str]:
    """Digests by name."""
    found = {}
    try:
        with path.open(encoding="utf-8") as file:
            for line in file:
                if not line.startswith(MARK):
                    break
                digest, _, name = line.removeprefix(MARK).partition(" ")
                found[str(json.loads(name))] = digest
    except (OSError, ValueError):  # none yet, or not ours
        pass
    return found


def _digest(path: Path) -> str:
    """Of a file's content; nothing where it is no file that can be read."""
    digest = hashlib.sha256()
    try:
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    except OSError:
        return ""
    return digest.hexdigest()
