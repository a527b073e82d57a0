"""The header of PLY files.

Counts are compared with the bytes that are there before memory is taken. Source: Turk, "The PLY polygon file format".
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError

Array = np.ndarray[Any, Any]

TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8", "byte", "ubyte"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32", "long"), "i4"),
    **dict.fromkeys(("uint", "uint32", "ulong"), "u4"),
    **dict.fromkeys(("int64", "longlong"), "i8"),
    **dict.fromkeys(("uint64", "ulonglong"), "u8"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MAX_HEADER = 1 << 20


@dataclass(frozen=True)
class Property:
    """One column; a list where ``count_type`` is given."""

    name: str
    type: str
    count_type: str | None = None


@dataclass(frozen=True)
class Element:
    """Rows of the same columns."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def least_bytes(self) -> int:
        """Bytes that a binary row has at least: a list may be empty and then is its count alone."""
        return sum(np.dtype(p.count_type or p.type).itemsize for p in self.properties)


@dataclass(frozen=True)
class Header:
    """What a file declares."""

    order: str  # "" text, "<" or ">" binary
    elements: tuple[Element, ...]
    comments: tuple[str, ...] = field(default=())
    size: int = 0  # bytes

    def element(self, name: str) -> Element | None:
        """The element of that name."""
        return next((e for e in self.elements if e.name == name), None)


def read_header(path: Path, data: bytes, size: int | None = None) -> Header:
    """The header, after comparing the declared counts with the bytes that are there: ``size``, or those of ``data``.

    Raises:
        SceneFileError: it is not complete, names unknown types, or declares more than there is.
    """
    start = data[:MAX_HEADER]
    end = start.find(b"end_header")
    if not data.startswith(b"ply") or end < 0:
        raise SceneFileError(path, "damaged or no PLY file: the header is not complete")
    own = end + len(b"end_header")
    # Exactly one end of line belongs to the header; a byte of data may look like a second one.
    own += 2 if start[own : own + 2] == b"\r\n" else 1
    lines = start[:end].decode("utf-8", errors="replace").replace("\r\n", "\n").replace("\r", "\n").split("\n")
    order, comments = None, []
    elements: list[tuple[str, int, list[Property]]] = []
    for line in lines[1:]:
        words = line.split()
        if not words:
            continue
        if words[0] == "format" and len(words) > 1:
            order = ORDERS.get(words[1])
            if order is None:
                raise SceneFileError(path, f"unknown format {words[1]!r}; known: {', '.join(ORDERS)}")
        elif words[0] in ("comment", "obj_info"):
            comments.append(line.split(None, 1)[1] if len(words) > 1 else "")
        elif words[0] == "element" and len(words) == 3 and words[2].isdigit():
            elements.append((words[1], int(words[2]), []))
        elif words[0] == "property" and elements:
            elements[-1][2].append(_property(path, words))
        else:
            raise SceneFileError(path, f"damaged header: {line.strip()[:80]!r}")
    if order is None:
        raise SceneFileError(path, "damaged or no PLY file: the header names no format")
    header = Header(order, tuple(Element(n, c, tuple(p)) for n, c, p in elements), tuple(comments), own)
    _check_size(path, header, (len(data) if size is None else size) - own)
    return header


def _property(path: Path, words: list[str]) -> Property:
    is_list = words[1:2] == ["list"]
    if len(words) != (5 if is_list else 3):
        raise SceneFileError(path, f"damaged header: {' '.join(words)[:80]!r}")
    for name in words[2:4] if is_list else words[1:2]:
        if name not in TYPES:
            raise SceneFileError(path, f"unknown type {name!r} of property {words[-1]!r}")
    return Property(words[4], TYPES[words[3]], TYPES[words[2]]) if is_list else Property(words[2], TYPES[words[1]])


def _check_size(path: Path, header: Header, have: int) -> None:
    # A number in text takes two bytes at least; the last line may lack its end.
    needed = sum(e.count * (e.least_bytes if header.order else 2 * len(e.properties)) for e in header.elements)
    if needed > have + (0 if header.order else 1):
        raise SceneFileError(path, f"cut off: the header declares at least {needed} bytes of data, there are {have}")
