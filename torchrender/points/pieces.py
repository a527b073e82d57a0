"""Files of points that are read piece by piece, so that they need not fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import PointFileError, SceneFileError
from torchrender.scene.files.plain.build import color_top, decoded_colors
from torchrender.scene.files.plain.numbers import NumberStream
from torchrender.scene.files.plain.ply import (
    COLORS,
    GAUSSIAN,
    NORMALS,
    OPACITIES,
    RADII,
    declares_faces,
    group_of,
    say_unused_columns,
)
from torchrender.scene.files.plain.ply_columns import text_rows
from torchrender.scene.files.plain.ply_format import MAX_HEADER, Element, read_header
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]

ROWS = 1 << 17
"""Points that are read at a time."""
RECORD = np.dtype([("position", "<f8", 3), ("normal", "<f4", 3), ("color", "<f4", 3), ("radius", "<f4")])
"""What is kept of a point; a normal or radius of zero is unknown."""


@dataclass(frozen=True, eq=False)
class Survey:
    """What one look through a file finds."""

    count: int  # points that are finite
    invalid: int  # points that are not
    unknown: int  # points whose normals are not
    bounds: Array  # (2,3) float64
    sample: Array  # (S,3) float64 positions, evenly through the file
    color_top: float | None  # code of white; None: linear light, or no colours


class PointPieces:
    """The points of a PLY file without faces.

    Raises:
        SceneFileError: damaged, cut off, or not readable.
        PointFileError: it holds surfaces, 3D Gaussians, or no points.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            with path.open("rb") as file:
                start = file.read(MAX_HEADER)
            self._header = read_header(path, start, path.stat().st_size)
        except FileNotFoundError as error:
            raise SceneFileError(path, "no such file") from error
        except OSError as error:
            raise SceneFileError(path, error.strerror or str(error)) from error
        if declares_faces(self._header):
            raise PointFileError(path, "holds surfaces, not points: load_points samples them")
        element = self._header.element("vertex")
        names = {p.name.lower() for p in element.properties} if element is not None else set()
        if element is None or not element.count or not names >= {"x", "y", "z"}:
            raise PointFileError(path, "holds no points with x, y and z")
        if names >= set(GAUSSIAN):
            raise PointFileError(path, "holds 3D Gaussians, which only load_points reads")
        before = self._header.elements[: self._header.elements.index(element)]
        if any(p.count_type for e in (*before, element) for p in e.properties):
            raise PointFileError(path, "has lists before or among its points: only load_points reads them")
        self._before, self._element = before, element
        self.has_color = any(names >= set(group) for group in COLORS)
        self.has_normals = any(names >= set(group) for group in NORMALS)

    def say_unused(self, notes: Notes) -> None:
        """Name what the file holds besides."""
        say_unused_columns(self._header, notes)
        for element in self._header.elements:
            if element is not self._element:
                notes.not_used(f"element {element.name!r}", element.count)

    def survey(self, most: int) -> Survey:
        """Count, bounds and about ``most`` positions."""
        step = -(-self._element.count // most)
        count = row = unknown = 0
        low, high, largest, kind = np.full(3, np.inf), np.full(3, -np.inf), 0.0, np.dtype(np.float64)
        chosen = []
        for columns in self._columns():
            position = _position(columns)
            finite: Any = np.isfinite(position).all(axis=1)
            chosen.append(position[-row % step :: step][finite[-row % step :: step]])
            row += len(position)
            position = position[finite]
            count += len(position)
            low, high = (
                np.minimum(low, position.min(0, initial=np.inf)),
                np.maximum(high, position.max(0, initial=-np.inf)),
            )
            normal, color = group_of(columns, NORMALS), group_of(columns, COLORS)
            if normal is not None:
                unknown += int((~np.isfinite(normal).all(axis=1)).sum())
            if color is not None:
                kind = color.dtype
                largest = max(largest, float(np.nan_to_num(color, posinf=0.0, neginf=0.0).max(initial=0)))
            self._refuse_clear(columns)
        top = color_top(kind, largest) if self.has_color else None
        return Survey(count, row - count, unknown, np.stack([low, high]), np.concatenate(chosen), top)

    def records(self, survey: Survey) -> Iterator[Array]:
        """All finite points, piece by piece: (N,) of type ``RECORD``."""
        for columns in self._columns():
            position = _position(columns)
            out = np.zeros(len(position), RECORD)
            out["position"] = position
            normal, color = group_of(columns, NORMALS), group_of(columns, COLORS)
            if normal is not None:
                out["normal"] = np.where(np.isfinite(normal).all(axis=1, keepdims=True), normal, 0.0)
            if color is not None:
                codes = np.nan_to_num(np.asarray(color, np.float64), posinf=0.0, neginf=0.0).clip(0.0)
                out["color"] = codes if survey.color_top is None else decoded_colors(codes, survey.color_top)
            radius = next((columns[n] for n in RADII if n in columns), None)
            if radius is not None:
                out["radius"] = np.nan_to_num(radius, posinf=0.0, neginf=0.0).clip(0.0)
            yield out[np.isfinite(position).all(axis=1)]

    def _refuse_clear(self, columns: dict[str, Array]) -> None:
        opacity = next((columns[n] for n in OPACITIES if n in columns), None)
        if opacity is None or not self.has_color:
            return
        top = 1.0 if opacity.dtype.kind == "f" and float(opacity.max(initial=0)) <= 2.0 else 255.0
        if bool((opacity < top).any()):
            raise PointFileError(self.path, "has points that are not opaque, which only load_points reads")

    def _columns(self) -> Iterator[dict[str, Array]]:
        """The columns of the points, :data:`ROWS` at a time."""
        with self.path.open("rb") as file:
            file.seek(self._header.size)
            try:
                yield from self._packed(file) if self._header.order else self._text(file)
            except ValueError as error:
                raise SceneFileError(self.path, f"damaged: text that is no number among the data ({error})") from error

    def _packed(self, file: Any) -> Iterator[dict[str, Array]]:
        order = self._header.order
        file.seek(sum(_row(e, order).itemsize * e.count for e in self._before), 1)
        row = _row(self._element, order)
        for rows in self._portions():
            data = file.read(rows * row.itemsize)
            if len(data) < rows * row.itemsize:
                raise SceneFileError(self.path, "cut off among its points")
            table = np.frombuffer(data, row)
            yield {p.name: table[f"{k}"] for k, p in enumerate(self._element.properties)}

    def _text(self, file: Any) -> Iterator[dict[str, Array]]:
        numbers = NumberStream(file)
        for element in self._before:
            for start in range(0, element.count, ROWS):
                text_rows(self.path, numbers, element, min(ROWS, element.count - start))
        for rows in self._portions():
            found = text_rows(self.path, numbers, self._element, rows)
            yield {p.name: values for p, values in zip(self._element.properties, found, strict=True)}

    def _portions(self) -> Iterator[int]:
        for start in range(0, self._element.count, ROWS):
            yield min(ROWS, self._element.count - start)


def _row(element: Element, order: str) -> np.dtype[Any]:
    return np.dtype([(f"{k}", order + p.type) for k, p in enumerate(element.properties)])


def _position(columns: dict[str, Array]) -> Array:
    position = group_of(columns, (("x", "y", "z"),))
    assert position is not None
    return position.astype(np.float64)
