"""The numbers of a text, all at once or block by block."""

from __future__ import annotations

from typing import Any

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
    stream = NumberStream(text)
    while len(block := stream.block()):
        parts.append(block)
    return parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0), *parts])


class NumberStream:
    """The numbers of a text from some byte on, handed out in order."""

    def __init__(self, text: bytes | memoryview, at: int = 0) -> None:
        self._text, self._at = memoryview(text), at
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
        while self._at < len(self._text):
            end = self._word_end(min(self._at + BLOCK, len(self._text)))
            found = _parsed(self._text[self._at : end])
            self._at = end
            if len(found):
                return found
        return np.zeros(0)

    def _word_end(self, end: int) -> int:
        """A place at or before ``end`` where no word is cut."""
        if end == len(self._text):
            return end
        tail = bytes(self._text[max(self._at, end - _LONGEST) : end])
        blank = max(tail.rfind(b) for b in _BLANKS)
        if blank < 0:
            raise ValueError(f"{tail[:40]!r} is no number")
        return end - len(tail) + blank + 1


def _parsed(text: memoryview) -> Array:
    source = np.frombuffer(text, np.uint8)
    room = len(source) // 2 + 1
    # Pages are only taken when they are written to.
    out, hard = np.empty(room), np.empty((room, 2), np.int64)
    count, left = parse_numbers(source, out, hard)
    for number, start in hard[:left].tolist():
        word = bytes(text[start : start + 400]).split(None, 1)[0]
        try:
            if b"_" in word:  # Python's digits may be grouped, those of files not
                raise ValueError
            out[number] = float(word)
        except ValueError as error:
            raise ValueError(f"{word[:40]!r} is no number") from error
    return out[:count].copy() if count < room // 2 else out[:count]
