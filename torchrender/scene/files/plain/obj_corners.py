"""Corners of faces in OBJ files: 1, 1/2, 1//3, 1/2/3, and the same with relative indices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.kernels.files.corners import parse_corners

Array = np.ndarray[Any, Any]
_WHAT = ("vertex", "texture coordinate", "normal")


def read_corners(path: Path, lines: list[str], sizes: tuple[int, int, int]) -> tuple[Array, Array]:
    """(C,3) int64 place of vertex, texture coordinate and normal of each corner, -1: none; corners of each face."""
    table, counts = _quick(lines) or _by_words(path, lines)
    for k, (what, size) in enumerate(zip(_WHAT, sizes, strict=True)):
        wrong = (table[:, k] > size) | (table[:, k] < (1 if k == 0 else 0))
        if wrong.any():
            row = int(np.searchsorted(counts.cumsum(), int(wrong.argmax()), side="right"))
            value = int(table[int(wrong.argmax()), k])
            raise SceneFileError(path, f"face {row + 1} names {what} {value}, there are {size}")
    table -= 1
    return table, counts


def _quick(lines: list[str]) -> tuple[Array, Array] | None:
    """What most files hold: indices that count from the start. None where there is anything else."""
    text = "\n".join(lines).encode()
    # A corner takes two bytes at least.
    table, counts = np.empty((len(text) // 2 + 1, 3), np.int64), np.zeros(len(lines), np.int64)
    found = parse_corners(np.frombuffer(text, np.uint8), table, counts)
    return None if found < 0 else (table[:found].copy(), counts)


def _by_words(path: Path, lines: list[str]) -> tuple[Array, Array]:
    """Relative indices, comments, and what is damaged."""
    words: list[str] = []
    counts = np.zeros(len(lines), np.int64)
    for row, line in enumerate(lines):
        here = None
        if "#" in line:
            line = line.partition("#")[0]
        if "|" in line:
            head, _, line = line.partition("|")
            here = [int(n) for n in head.split()]
        own = line.split()
        if here is not None:
            own = [_absolute(path, word, here, row) for word in own]
        counts[row] = len(own)
        words += own
    return _indices(path, words), counts


def _absolute(path: Path, word: str, here: list[int], row: int) -> str:
    """A corner with relative indices, of the face in that row, as one with absolute ones."""
    out = []
    for k, part in enumerate(word.split("/")[:3]):
        if part.startswith("-"):
            if not part[1:].isdigit():
                raise SceneFileError(path, f"damaged: a corner of a face is {word[:40]!r}")
            number = here[k] + 1 + int(part)
            if number < 1:
                raise SceneFileError(path, f"face {row + 1} names {_WHAT[k]} {part}, there are {here[k]} before it")
            part = str(number)
        out.append(part)
    return "/".join(out)


def _indices(path: Path, words: list[str]) -> Array:
    """(C,3) int64 indices from 1 on, 0: none, of corners such as 1, 1/2, 1//3 and 1/2/3."""
    if not words:
        return np.zeros((0, 3), np.int64)
    text = " ".join(words)
    slashes = words[0].count("/")
    try:
        whole = "/ " not in text and not text.endswith("/")
        if whole and slashes == 2 and text.count("//") == len(words):
            return np.array(text.replace("//", " 0 ").split(), np.int64).reshape(-1, 3)
        if whole and "//" not in text and all(w.count("/") == slashes for w in words):
            flat = np.array(text.replace("/", " ").split(), np.int64).reshape(-1, slashes + 1)
            return np.pad(flat, ((0, 0), (0, 2 - slashes)))
        rows = [[int(p or 0) for p in [*word.split("/"), "", ""][:3]] for word in words]
        return np.array(rows, np.int64)
    except (ValueError, OverflowError) as error:
        raise SceneFileError(path, f"damaged: a corner of a face is no index ({error})") from error
