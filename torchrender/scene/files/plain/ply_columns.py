"""The columns of PLY files, in text and both binary orders."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.kernels.files.rows import byte_rows, join_bytes, join_numbers, number_rows
from torchrender.scene.files.plain.numbers import NumberStream
from torchrender.scene.files.plain.ply_format import Element, Header
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class Lists:
    """A column of lists."""

    counts: Array  # (N,) int64
    values: Array  # (sum of counts,)


Columns = dict[str, "Array | Lists"]
ROWS = 1 << 17
"""Rows that are cut into columns at a time: what is needed beside text and columns does not grow with the file."""


def read_columns(path: Path, data: bytes, header: Header, notes: Notes) -> dict[str, Columns]:
    """All columns, by element and name; ``notes`` are told of data that no element declares.

    Raises:
        SceneFileError: cut off, or text that is no number.
    """
    source: _Text | _Binary = _Binary(path, data, header) if header.order else _Text(path, data, header)
    try:
        found = {element.name: source.element(element) for element in header.elements}
    except ValueError as error:
        raise SceneFileError(path, f"damaged: text that is no number among the data ({error})") from error
    if source.goes_on():
        notes.not_used("data behind the rows that the header declares")
    return found


class _Text:
    """Numbers in text, cut into columns block by block."""

    def __init__(self, path: Path, data: bytes, header: Header) -> None:
        text = io.BytesIO(data)
        text.seek(header.size)
        self._path, self._numbers = path, NumberStream(text)

    def element(self, element: Element) -> Columns:
        """The columns of the element that comes next."""
        if any(p.count_type for p in element.properties):
            return self._with_lists(element)
        width = len(element.properties)
        out = [np.empty(element.count, _column_type(p.type)) for p in element.properties]
        for row in range(0, element.count if width else 0, ROWS):
            rows = min(ROWS, element.count - row)
            for k, values in enumerate(text_rows(self._path, self._numbers, element, rows)):
                out[k][row : row + rows] = values
        return {p.name: values for p, values in zip(element.properties, out, strict=True)}

    def _with_lists(self, element: Element) -> Columns:
        mask = np.array([p.count_type is not None for p in element.properties])
        parts = _Parts(element)
        left, numbers = element.count, np.zeros(0)
        while left:
            block = self._numbers.block()
            if not len(block):
                raise _short(self._path, element)
            numbers = np.concatenate([numbers, block]) if len(numbers) else block
            rows = asked = 0
            while left and rows == asked:
                asked = min(left, ROWS)
                starts, counts = np.empty((asked, len(mask)), np.int64), np.empty((asked, len(mask)), np.int64)
                rows, at = number_rows(numbers, mask, starts, counts)
                if rows < 0:
                    reason = f"damaged: a list of {numbers[at]:g} values in element {element.name!r}"
                    raise SceneFileError(self._path, reason)
                for k, p in enumerate(element.properties):
                    count, start = counts[:rows, k].copy(), starts[:rows, k].copy()
                    values = np.empty(int(count.sum()))
                    join_numbers(numbers, start, count, values)
                    parts.add(k, count, _typed(values, p.type))
                numbers, left = numbers[at:], left - rows
        self._numbers.back(numbers)
        return parts.columns()

    def goes_on(self) -> bool:
        """Whether there is more than was read."""
        try:
            return len(self._numbers.take(1)) > 0
        except ValueError:  # words
            return True


def text_rows(path: Path, numbers: NumberStream, element: Element, rows: int) -> list[Array]:
    """The next rows of an element without lists: a column for each property.

    Raises:
        SceneFileError: the text ends before. ValueError: a word that is no number.
    """
    width = len(element.properties)
    found = numbers.take(rows * width)
    if len(found) < rows * width:
        raise _short(path, element)
    table = found.reshape(rows, width)
    return [_typed(table[:, k], p.type) for k, p in enumerate(element.properties)]


class _Parts:
    """The columns of an element with lists, as they come."""

    def __init__(self, element: Element) -> None:
        self._element = element
        self._counts: list[list[Array]] = [[] for _ in element.properties]
        self._values: list[list[Array]] = [[] for _ in element.properties]

    def add(self, column: int, counts: Array, values: Array) -> None:
        """The next rows of a column."""
        self._counts[column].append(counts)
        self._values[column].append(values)

    def columns(self) -> Columns:
        """All of them; the parts are given up."""
        out: Columns = {}
        for k, p in enumerate(self._element.properties):
            values = np.concatenate(self._values[k] or [np.zeros(0, _column_type(p.type))])
            self._values[k] = []
            out[p.name] = Lists(np.concatenate(self._counts[k] or [np.zeros(0, np.int64)]), values)
            if p.count_type is None:
                out[p.name] = values
        return out


class _Binary:
    """Packed rows."""

    def __init__(self, path: Path, data: bytes, header: Header) -> None:
        self._path, self._data, self._at, self._order = path, data, header.size, header.order

    def element(self, element: Element) -> Columns:
        """The columns of the element that comes next."""
        if not any(p.count_type for p in element.properties):
            plain = [(f"{k}", self._order + p.type) for k, p in enumerate(element.properties)]
            table = self._table(element, np.dtype(plain))
            return {p.name: table[f"{k}"] for k, p in enumerate(element.properties)}
        uniform = self._uniform(element)
        return self._walk(element) if uniform is None else uniform

    def _table(self, element: Element, row: np.dtype[Any]) -> Array:
        size = row.itemsize * element.count
        if self._at + size > len(self._data):
            raise _short(self._path, element)
        table = np.frombuffer(self._data, row, element.count, self._at)
        self._at += size
        return table

    def _uniform(self, element: Element) -> Columns | None:
        """All rows have lists as long as those of the first; None where they have not."""
        at, fields, lengths = self._at, [], []
        for k, p in enumerate(element.properties):
            value = np.dtype(self._order + p.type)
            if not p.count_type:
                fields.append((f"{k}", value))
                at += value.itemsize
                continue
            kind = np.dtype(self._order + p.count_type)
            if at + kind.itemsize > len(self._data):
                return None
            count = _count(self._path, np.frombuffer(self._data, kind, 1, at)[0], element)
            fields += [(f"n{k}", kind), (f"{k}", value, (count,))]  # type: ignore[list-item]
            lengths.append((k, count))
            at += kind.itemsize + count * value.itemsize
        row = np.dtype(fields)
        if not element.count or self._at + row.itemsize * element.count > len(self._data):
            return None
        table = np.frombuffer(self._data, row, element.count, self._at)
        if any((table[f"n{k}"] != count).any() for k, count in lengths):
            return None
        self._at += row.itemsize * element.count
        of = dict(lengths)
        return {
            p.name: Lists(np.full(element.count, of[k], np.int64), table[f"{k}"].reshape(-1))
            if k in of
            else table[f"{k}"]
            for k, p in enumerate(element.properties)
        }

    def _walk(self, element: Element) -> Columns:
        heads = np.array([np.dtype(p.count_type).itemsize if p.count_type else 0 for p in element.properties])
        widths = np.array([np.dtype(p.type).itemsize for p in element.properties])
        raw = np.frombuffer(self._data, np.uint8)
        parts, left = _Parts(element), element.count
        while left:
            asked = min(left, ROWS)
            starts, counts = np.empty((asked, len(heads)), np.int64), np.empty((asked, len(heads)), np.int64)
            rest = raw[self._at :]
            rows, size = byte_rows(rest, heads, widths, self._order == ">", starts, counts)
            if rows < asked:
                raise _short(self._path, element)
            for k, p in enumerate(element.properties):
                count, start = counts[:, k].copy(), starts[:, k].copy()
                values = np.empty(int(count.sum()) * int(widths[k]), np.uint8)
                join_bytes(rest, start, count, int(widths[k]), values)
                parts.add(k, count, values.view(self._order + p.type))
            self._at += size
            left -= asked
        return parts.columns()

    def goes_on(self) -> bool:
        """Whether there is more than was read, but for an end of line or zeros."""
        return bool(self._data[self._at : self._at + 4096].strip(b"\0 \t\r\n"))


def _short(path: Path, element: Element) -> SceneFileError:
    return SceneFileError(path, f"cut off among the {element.count} rows of element {element.name!r}")


def _column_type(kind: str) -> np.dtype[Any]:
    """Numbers of text keep all their digits, whatever fraction they are declared as."""
    dtype = np.dtype(kind)
    return np.dtype(np.float64) if dtype.kind == "f" else dtype


def _typed(values: Array, kind: str) -> Array:
    """Numbers of text as their declared type, where that does not lose them."""
    dtype = np.dtype(kind)
    if dtype.kind == "f":
        return values
    limits = np.iinfo(dtype)
    whole = np.nan_to_num(values, posinf=0.0, neginf=0.0)
    return whole.clip(limits.min, limits.max).astype(dtype)


def _count(path: Path, value: Any, element: Element) -> int:
    if not 0 <= value <= 2**31 or value != int(value):
        raise SceneFileError(path, f"damaged: a list of {value} values in element {element.name!r}")
    return int(value)
