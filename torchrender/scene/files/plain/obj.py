"""Wavefront OBJ files: what the lines say, with indices resolved and polygons triangulated."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.kernels.files.corners import count_words
from torchrender.scene.files.plain.build import Surface, linear_colors
from torchrender.scene.files.plain.numbers import numbers_of
from torchrender.scene.files.plain.obj_corners import read_corners
from torchrender.scene.files.plain.polygons import triangulate
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]

_MARKS = ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig"))
_CONTINUED = re.compile(r"\\[ \t]*\n")
_FREE_FORM = {
    "vp",
    "cstype",
    "deg",
    "curv",
    "curv2",
    "surf",
    "parm",
    "trim",
    "hole",
    "scrv",
    "sp",
    "end",
    "con",
    "bmat",
    "step",
}
_SILENT = {
    "mg",
    "bevel",
    "c_interp",
    "d_interp",
    "lod",
    "shadow_obj",
    "trace_obj",
    "ctech",
    "stech",
    "maplib",
    "usemap",
}


def decoded(data: bytes) -> str:
    """Text of a file in UTF-8 or UTF-16, with one kind of line end, without tabs and continued lines."""
    encoding = next((name for mark, name in _MARKS if data.startswith(mark)), None)
    if encoding is None:
        head = data[:64]
        wide = len(head) >= 4 and head[1::2].count(0) > len(head) // 4
        encoding = "utf-16-le" if wide else "utf-16-be" if head[::2].count(0) > len(head) // 4 else "utf-8"
    text = data.decode(encoding, errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n").replace("\t", " ")
    return _CONTINUED.sub(" ", text) if "\\" in text else text


@dataclass(frozen=True, eq=False)
class ObjPart:
    """Triangles of one object and material."""

    name: str | None
    material: str | None
    surface: Surface


@dataclass
class _Run:
    """Faces that follow one another under the same names."""

    start: int  # line of the first face
    name: str | None
    material: str | None
    smoothing: int


@dataclass
class _Lines:
    """Lines of a file by kind."""

    v: list[str] = field(default_factory=list)
    vt: list[str] = field(default_factory=list)
    vn: list[str] = field(default_factory=list)
    f: list[str] = field(default_factory=list)
    runs: list[_Run] = field(default_factory=list)
    libraries: list[str] = field(default_factory=list)


def read_obj(path: Path, data: bytes, notes: Notes) -> tuple[list[ObjPart], list[str]]:
    """Parts in the order of the file, and the MTL files that it names.

    Raises:
        SceneFileError: numbers that are none, or indices of what is not there.
    """
    lines = _sorted_lines(decoded(data), notes)
    positions, colors = _positions(path, lines.v, notes)
    coordinates = _table(path, "vt", lines.vt, 2)
    normals = _table(path, "vn", lines.vn, 3)
    sizes = (len(positions), len(coordinates), len(normals))
    corners, counts = read_corners(path, lines.f, sizes)
    short = int((counts < 3).sum())
    notes.repaired("faces with less than three corners: left out", short)
    places, owner = triangulate(positions, corners[:, 0], counts)
    run_of = _run_of(lines.runs, len(counts))[owner]
    attributes = (positions, coordinates, normals, colors)
    parts: list[ObjPart] = []
    keys: dict[tuple[str | None, str | None], list[int]] = {}
    for number, run in enumerate(lines.runs):
        keys.setdefault((run.name, run.material), []).append(number)
    smoothing = np.array([r.smoothing for r in lines.runs], np.int64)
    for (name, material), numbers in keys.items():
        rows = np.flatnonzero(np.isin(run_of, numbers))
        if len(rows):
            surface = _surface(attributes, corners[places[rows].reshape(-1)], smoothing[run_of[rows]])
            parts.append(ObjPart(name, material, surface))
    return parts, lines.libraries


def _sorted_lines(text: str, notes: Notes) -> _Lines:
    out = _Lines()
    name: str | None = None
    named_by_object = re.search(r"(?m)^ *o ", text) is not None
    material, smoothing = None, -1
    others: Counter[str] = Counter()
    changed = True
    for raw in text.split("\n"):
        line = raw if raw[:1] != " " else raw.lstrip()
        head = line[:2]
        if head == "v ":
            out.v.append(line[2:])
        elif head == "f ":
            if changed:
                out.runs.append(_Run(len(out.f), name, material, smoothing))
                changed = False
            # Relative indices count from where they stand.
            here = f"{len(out.v)} {len(out.vt)} {len(out.vn)}|" if "-" in line else ""
            out.f.append(here + line[2:])
        elif head == "vt":
            out.vt.append(line[3:])
        elif head == "vn":
            out.vn.append(line[3:])
        elif line and head[0] != "#":
            word, _, rest = line.partition(" ")
            rest, lower = rest.strip(), word.lower()
            if lower == "usemtl":
                material, changed = rest, True
            elif lower == "o" or (lower == "g" and not named_by_object):
                name, changed = rest or None, True
            elif lower == "s":
                smoothing, changed = _smoothing(rest), True
            elif lower == "mtllib":
                out.libraries.append(rest)
            elif lower not in ("g", "f"):
                others[lower] += 1
    _say_others(others, notes)
    return out


def _smoothing(text: str) -> int:
    word = text.split()[0].lower() if text.split() else "off"
    return 0 if word in ("off", "0") else int(word) if word.isdigit() and len(word) < 10 else 1


def _say_others(others: Counter[str], notes: Notes) -> None:
    for word, count in others.items():
        if word in ("p", "l"):
            notes.not_used("points" if word == "p" else "lines", count)
        elif word in _FREE_FORM:
            notes.not_used("free-form curves and surfaces (statements)", count)
        elif word not in _SILENT:
            notes.not_used(f"statement {word[:20]!r}", count)


def _numbers(lines: list[str]) -> tuple[Array, int] | None:
    """All numbers, and how many each line has; None where lines differ or hold something else."""
    if not lines:
        return np.zeros(0), 0
    text = "\n".join(lines)
    if "#" in text:
        text = "\n".join(line.partition("#")[0] for line in lines)
    source = text.encode()
    width = len(lines[0].partition("#")[0].split())
    try:
        values = numbers_of(source)
    except ValueError:
        return None
    if not width or len(values) != width * len(lines):
        return None
    # As many words in all, and yet not in every line.
    counts = np.zeros(len(lines), np.int64)
    count_words(np.frombuffer(source, np.uint8), counts)
    return (values, width) if bool((counts == width).all()) else None


def _table(path: Path, kind: str, lines: list[str], width: int) -> Array:
    """(N,width) numbers of lines of one kind; what they lack is 0, what they have beyond is left out."""
    quick = _numbers(lines)
    if quick is not None:
        values, have = quick
        table = values.reshape(-1, have) if have else np.zeros((0, width))
        return table[:, :width] if have >= width else np.pad(table, ((0, 0), (0, width - have)))
    out = np.zeros((len(lines), width))
    for row, line in enumerate(lines):
        numbers = _row(path, kind, line)[:width]
        out[row, : len(numbers)] = numbers
    return out


def _row(path: Path, kind: str, line: str) -> list[float]:
    try:
        return [float(word) for word in line.partition("#")[0].split()]
    except ValueError as error:
        raise SceneFileError(path, f"damaged: '{kind} {line[:60]}' holds something that is no number") from error


def _positions(path: Path, lines: list[str], notes: Notes) -> tuple[Array, Array | None]:
    """Positions (V,3) and, of lines with six numbers or more, colours (V,3)."""
    quick = _numbers(lines)
    if quick is not None and quick[1] in (3, 4, 6, 7, 8):
        table = quick[0].reshape(-1, quick[1])
        color = table[:, 3:6] if quick[1] == 6 else table[:, 4:7] if quick[1] > 6 else None
        return table[:, :3].copy(), None if color is None else linear_colors(color, notes)
    positions, colors, found = np.zeros((len(lines), 3)), np.ones((len(lines), 3)), False
    for row, line in enumerate(lines):
        numbers = _row(path, "v", line)
        if len(numbers) < 3:
            raise SceneFileError(path, f"damaged: vertex {row + 1} has {len(numbers)} coordinates")
        positions[row] = numbers[:3]
        if len(numbers) >= 6:
            found = True
            colors[row] = numbers[3:6] if len(numbers) == 6 else numbers[4:7]
    return positions, linear_colors(colors, notes) if found else None


def _run_of(runs: list[_Run], count: int) -> Array:
    """(F,) number of the run of each face."""
    starts = np.array([r.start for r in runs], np.int64)
    return np.searchsorted(starts, np.arange(count), side="right") - 1


def _surface(attributes: tuple[Array, Array, Array, Array | None], corners: Array, smoothing: Array) -> Surface:
    """Triangles whose corners (3T,3) are merged where they name the same of everything."""
    positions, coordinates, normals, colors = attributes
    span = (corners.max(axis=0) + 2).astype(np.float64)
    if float(np.prod(span)) < 2**62:
        wide = span.astype(np.int64)
        key = ((corners[:, 0] + 1) * wide[1] + corners[:, 1] + 1) * wide[2] + corners[:, 2] + 1
        _, first, place = np.unique(key, return_index=True, return_inverse=True)
    else:
        _, first, place = np.unique(corners, axis=0, return_index=True, return_inverse=True)
    used = corners[first]
    vertex, texture, normal = used.T

    def of(values: Array, rows: Array) -> Array | None:
        if not (rows >= 0).any():
            return None
        return np.where((rows >= 0)[:, None], values[np.maximum(rows, 0)], 0.0)

    return Surface(
        vertices=positions[vertex],
        faces=place.reshape(-1, 3),
        normals=of(normals, normal),
        uv=of(coordinates, texture),
        colors=None if colors is None else colors[vertex, :3],
        smoothing=smoothing,
    )
