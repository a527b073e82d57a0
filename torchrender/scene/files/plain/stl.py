"""STL files, in text and binary, with the colours of both dialects that store some.

Colours: VisCAM and SolidView set bit 15 of a facet's attribute where the lower bits are a colour, blue first;
Materialise Magics writes ``COLOR=`` into the header for the whole; facets with other lower bits than none or all have a
colour of their own, red first, whatever their bit 15, about which writers differ.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.plain.build import linear_colors
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]

_HEAD = 84
_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_SOLID = re.compile(rb"(?im)^[ \t]*solid\b[ \t]*([^\r\n]*)")
_CORNER = re.compile(rb"(?i)\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")
_VALID = 1 << 15


@dataclass(frozen=True, eq=False)
class Solid:
    """One body."""

    name: str
    corners: Array  # (F,3,3) float64
    colors: Array | None = None  # (F,3) linear


def read_stl(path: Path, data: bytes, notes: Notes) -> list[Solid]:
    """The solids of a file.

    Raises:
        SceneFileError: damaged or cut off.
    """
    count = struct.unpack_from("<I", data, 80)[0] if len(data) >= _HEAD else 0
    exact = len(data) == _HEAD + _FACET.itemsize * count
    if not exact and _is_text(data):
        return _text(path, data)
    if len(data) < _HEAD:
        raise SceneFileError(path, f"cut off: a binary header has {_HEAD} bytes, the file {len(data)}")
    needed = _HEAD + _FACET.itemsize * count
    if needed > len(data):
        raise SceneFileError(path, f"cut off: declares {count} facets, which need {needed} bytes; has {len(data)}")
    notes.not_used("bytes behind the last facet", len(data) - needed)
    facets = np.frombuffer(data, _FACET, count, _HEAD)
    return [Solid(path.stem, facets["corners"].astype(np.float64), _colors(data[:80], facets["attribute"]))]


def _is_text(data: bytes) -> bool:
    start = data[:4096].lstrip().lower()
    return start.startswith(b"solid") and (b"facet" in start or b"endsolid" in start or b"\0" not in start)


def _text(path: Path, data: bytes) -> list[Solid]:
    heads = list(_SOLID.finditer(data))
    ends = [h.start() for h in heads[1:]] + [len(data)]
    solids = []
    for head, end in zip(heads, ends, strict=True):
        found = _CORNER.findall(data, head.end(), end)
        try:
            numbers = np.array(found, dtype="S").astype(np.float64).reshape(-1, 3)
        except ValueError as error:
            raise SceneFileError(path, f"damaged: a corner is no number ({error})") from error
        if len(numbers) % 3:
            raise SceneFileError(path, f"cut off or damaged: {len(numbers)} corners are no whole triangles")
        name = head.group(1).decode("utf-8", errors="replace").strip()
        solids.append(Solid(name or path.stem, numbers.reshape(-1, 3, 3)))
    return solids


def _colors(header: bytes, attribute: Array) -> Array | None:
    if not attribute.any() and b"COLOR=" not in header:
        return None
    five = np.stack([attribute & 31, attribute >> 5 & 31, attribute >> 10 & 31], axis=1).astype(np.uint16) * 255 // 31
    marked = (attribute & _VALID) != 0
    at = header.find(b"COLOR=")
    if at >= 0 and at + 9 <= len(header):
        whole = np.frombuffer(header, np.uint8, 3, at + 6).astype(np.uint16)
        lower = attribute & (_VALID - 1)
        codes = np.where(((lower == 0) | (lower == _VALID - 1))[:, None], whole, five)
    elif not marked.any():  # numbers of another meaning
        return None
    else:
        grey = np.uint16(231)  # code of the linear 0.8 that meshes without colours have
        codes = np.where(marked[:, None], five[:, ::-1], grey)
    return linear_colors(codes.astype(np.uint8))
