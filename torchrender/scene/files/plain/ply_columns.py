"""The columns of PLY files, in text and both binary orders."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.plain.numbers import numbers_of
from torchrender.scene.files.plain.ply_format import Element, Header

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class Lists:
    """A column of lists."""

    counts: Array  # (N,) int64
    values: Array  # (sum of counts,)


Columns = dict[str, "Array | Lists"]


def read_columns(path: Path, data: bytes, header: Header) -> dict[str, Columns]:
    """All columns, by element and name.

    Raises:
        SceneFileError: cut off, or text that is no number.
    """
    source: _Text | _Binary = _Binary(path, data, header) if header.order else _Text(path, data, header)
    return {element.name: source.element(element) for element in header.elements}


class _Text:
    """Numbers in text: parsed at once, then cut into columns."""

    def __init__(self, path: Path, data: bytes, header: Header) -> None:
        self._path, self._at = path, 0
        try:
            self._numbers = numbers_of(data[header.size :])
        except ValueError as error:
            raise SceneFileError(path, f"damaged: text that is no number among the data ({error})") from error

    def element(self, element: Element) -> Columns:
        """The columns of the element that comes next."""
        if not any(p.count_type for p in element.properties):
            table = self._take(element.count * len(element.properties), element).reshape(
                element.count, len(element.properties)
            )
            return {p.name: _typed(table[:, k], p.type) for k, p in enumerate(element.properties)}
        return self._with_lists(element)

    def _with_lists(self, element: Element) -> Columns:
        numbers, at = self._numbers, self._at
        uniform = self._uniform(element)
        if uniform is not None:
            return uniform
        counts: dict[str, list[int]] = {p.name: [] for p in element.properties}
        starts: dict[str, list[int]] = {p.name: [] for p in element.properties}
        for _ in range(element.count):
            for p in element.properties:
                if p.count_type:
                    if at >= len(numbers):
                        raise self._short(element)
                    count = _count(self._path, numbers[at], element)
                    at += 1
                else:
                    count = 1
                counts[p.name].append(count)
                starts[p.name].append(at)
                at += count
            if at > len(numbers):
                raise self._short(element)
        self._at = at
        out: Columns = {}
        for p in element.properties:
            count_of, start = np.array(counts[p.name], np.int64), np.array(starts[p.name], np.int64)
            values = _typed(numbers[_ranges(start, count_of)], p.type)
            out[p.name] = Lists(count_of, values) if p.count_type else values
        return out

    def _uniform(self, element: Element) -> Columns | None:
        """All rows have lists as long as those of the first; None where they have not."""
        at, places = self._at, []
        for p in element.properties:
            if p.count_type:
                if at >= len(self._numbers):
                    return None
                places.append((p, at - self._at + 1, _count(self._path, self._numbers[at], element)))
                at += 1 + places[-1][2]
            else:
                places.append((p, at - self._at, 1))
                at += 1
        width = at - self._at
        total = width * element.count
        if not element.count or self._at + total > len(self._numbers):
            return None
        table = self._numbers[self._at : self._at + total].reshape(element.count, width)
        if any((table[:, first - 1] != count).any() for p, first, count in places if p.count_type):
            return None
        self._at += total
        out: Columns = {}
        for p, first, count in places:
            values = _typed(table[:, first : first + count].reshape(-1), p.type)
            out[p.name] = Lists(np.full(element.count, count, np.int64), values) if p.count_type else values
        return out

    def _take(self, count: int, element: Element) -> Array:
        if self._at + count > len(self._numbers):
            raise self._short(element)
        self._at += count
        return self._numbers[self._at - count : self._at]

    def _short(self, element: Element) -> SceneFileError:
        return SceneFileError(self._path, f"cut off among the {element.count} rows of element {element.name!r}")


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
            raise SceneFileError(self._path, f"cut off among the {element.count} rows of element {element.name!r}")
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
        data, at = memoryview(self._data), self._at
        sizes = [
            (np.dtype(p.count_type).itemsize if p.count_type else 0, np.dtype(p.type).itemsize)
            for p in element.properties
        ]
        endian = "little" if self._order == "<" else "big"
        starts: list[list[int]] = [[] for _ in sizes]
        counts: list[list[int]] = [[] for _ in sizes]
        end = len(data)
        for _ in range(element.count):
            for k, (head, width) in enumerate(sizes):
                count = 1
                if head:
                    count = int.from_bytes(data[at : at + head], endian)  # type: ignore[arg-type]
                    at += head
                starts[k].append(at)
                counts[k].append(count)
                at += count * width
            if at > end:
                raise SceneFileError(self._path, f"cut off among the {element.count} rows of element {element.name!r}")
        self._at = at
        raw = np.frombuffer(self._data, np.uint8)
        out: Columns = {}
        for k, p in enumerate(element.properties):
            count_of, start, width = np.array(counts[k], np.int64), np.array(starts[k], np.int64), sizes[k][1]
            places = _ranges(start, count_of, width)
            values = raw[places[:, None] + np.arange(width)].reshape(-1).view(self._order + p.type)
            out[p.name] = Lists(count_of, values) if p.count_type else values
        return out


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


def _ranges(starts: Array, counts: Array, step: int = 1) -> Array:
    """All places ``start, start + step, ...`` of each start, one range after the other."""
    ends = np.cumsum(counts)
    within = np.arange(int(ends[-1]) if len(ends) else 0) - (ends - counts).repeat(counts)
    places: Array = starts.repeat(counts) + step * within
    return places
