"""The numbers of a text, all at once or block by block."""

from __future__ import annotations

import io
from typing import Any, BinaryIO

import numpy as np

from torchrender.kernels.files.numbers import parse_numbers

Array = np.ndarray[Any, Any]

BLOCK = 1 << 22
"""Bytes of text that are parsed at a time: the numbers of more would take several times the memory of the text."""
_LONGEST = 1 << 16
"""No number has more characters."""
_BLANKS = tuple(bytes([c]) for c in b" \n\t\r\v\f")


def numbers_of(text: bytes) -> Array:
    """(N,) float64 of the words between blanks, as Python's ``float`` reads each.

    Raises:
        ValueError: a word that is no number; names it.
    """
    parts = []
    stream = NumberStream(io.BytesIO(text))
    while len(block := stream.block()):
        parts.append(block)
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0), *parts])


class NumberStream:
    """The numbers of a text file from where it stands on, handed out in order."""

    def __init__(self, file: BinaryIO) -> None:
        self._file, self._word = file, b""
        self._left = np.zeros(0)

    def take(self, count: int) -> Array:
        """The next ``count`` numbers, fewer where the text ends.

        Raises:
            ValueError: a word that is no number; names it.
        """
        parts, have = [self._left], len(self._left)
        while have < count and len(block := self._parse()):
            parts.append(block)
            have += len(block)
        whole = parts[0] if len(parts) == 1 else np.concatenate(parts)
        self._left = whole[count:]
        return whole[:count]

    def back(self, numbers: Array) -> None:
        """Hand these numbers out once more."""
        self._left = np.concatenate([numbers, self._left])

    def block(self) -> Array:
        """A block of numbers; empty at the end.

        Raises:
            ValueError: as :meth:`take`.
        """
        if len(self._left):
            left, self._left = self._left, np.zeros(0)
            return left
        return self._parse()

    def _parse(self) -> Array:
        """The numbers of the next bytes; none only at the end."""
        while read := self._file.read(BLOCK):
            text = self._word + read
            # The last word may go on in the next block.
            end = max(text.rfind(b) for b in _BLANKS) + 1
            self._word = text[end:]
            if len(self._word) > _LONGEST:
                raise ValueError(f"{self._word[:40]!r} is no number")
            found = _parsed(text[:end])
            if len(found):
                return found
        text, self._word = self._word, b""
        return _parsed(text)


def _parsed(text: bytes) -> Array:
    source = np.frombuffer(text, np.uint8)
    room = len(source) // 2 + 1
    # Pages are only taken when they are written to.
    out, hard = np.empty(room), np.empty((room, 2), np.int64)
    count, left = parse_numbers(source, out, hard)
    for number, start in hard[:left].tolist():
        word = text[start : start + 400].split(None, 1)[0]
        try:
            if b"_" in word:  # Python's digits may be grouped, those of files not
                raise ValueError
            out[number] = float(word)
        except ValueError as error:
            raise ValueError(f"{word[:40]!r} is no number") from error
    return out[:count].copy() if count < room // 2 else out[:count]
