"""Meshes out of what plain files hold: polygons, attributes of their corners, and normals where there are none."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.kernels.meshes.crease import turn_faces, weld_points
from torchrender.numerics.color import linear_from_srgb
from torchrender.scene.files.report import Notes
from torchrender.scene.mesh import Mesh
from torchrender.scene.smooth import CREASE_DEG, crease_normals

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False, kw_only=True)
class Surface:
    """Triangles with the attributes of their vertices."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int64
    normals: Array | None = None  # (V,3)
    uv: Array | None = None  # (V,2)
    colors: Array | None = None  # (V,3) linear float32
    alpha: Array | None = None  # (V,)
    smoothing: Array | None = None  # (F,) int64 group; 0: flat, -1: not said

    def taken(self, rows: Array, faces: Array, **changes: Any) -> Surface:
        """These vertices (N,) of it with other faces."""
        values: dict[str, Any] = {
            name: None if getattr(self, name) is None else getattr(self, name)[rows]
            for name in ("vertices", "normals", "uv", "colors", "alpha")
        }
        return Surface(**(values | {"faces": faces, "smoothing": self.smoothing} | changes))


def build_mesh(
    surface: Surface, name: str, notes: Notes, *, material: int = 0, object_id: int = 0, drop_invalid: bool = False
) -> Mesh:
    """The mesh; what is mended is noted.

    Raises:
        MeshError: vertices that are NaN or infinite, without ``drop_invalid``; faces that name missing vertices.
    """
    count = len(surface.vertices)
    inside = not surface.faces.size or 0 <= int(surface.faces.min()) <= int(surface.faces.max()) < count
    if inside:
        surface = _without_doubles(surface, notes)
        if drop_invalid:
            surface = _without_invalid(surface, notes)
        if np.isfinite(surface.vertices).all():
            surface = _with_normals(surface)
    normals = None if surface.normals is None else unit_or_zero(notes.known_normals(surface.normals))
    uv = surface.uv
    if uv is not None and not np.isfinite(uv).all():
        notes.repaired("texture coordinates that are NaN or infinite: set to 0", int((~np.isfinite(uv)).any(1).sum()))
        uv = np.nan_to_num(uv, posinf=0.0, neginf=0.0)
    return Mesh(
        vertices=torch.from_numpy(np.ascontiguousarray(surface.vertices, np.float64)),
        faces=torch.from_numpy(np.ascontiguousarray(surface.faces, np.int64)),
        name=name,
        normals=normals,
        uv=None if uv is None else torch.from_numpy(np.ascontiguousarray(uv[:, :2], np.float32)),
        colors=None if surface.colors is None else torch.from_numpy(np.ascontiguousarray(surface.colors, np.float32)),
        alpha=None if surface.alpha is None else torch.from_numpy(np.ascontiguousarray(surface.alpha, np.float32)),
        material=material,
        object_id=object_id,
    )


def _without_doubles(surface: Surface, notes: Notes) -> Surface:
    """Faces that stand in the file twice, corner by corner, are kept once."""
    if len(surface.faces) < 2:
        return surface
    # Each face from its smallest vertex on: the same face may begin anywhere.
    turned = np.empty((len(surface.faces), 3), np.int64)
    turn_faces(np.ascontiguousarray(surface.faces, np.int64), turned)
    place, kept = np.empty(len(turned), np.int64), np.empty(len(turned), np.int64)
    count = weld_points(turned, place, kept)
    if count == len(turned):
        return surface
    double = np.ones(len(turned), bool)
    double[kept[:count]] = False
    notes.repaired("faces that are there twice: kept once", int(double.sum()))
    smoothing = None if surface.smoothing is None else surface.smoothing[~double]
    return surface.taken(np.arange(len(surface.vertices)), surface.faces[~double], smoothing=smoothing)


def _without_invalid(surface: Surface, notes: Notes) -> Surface:
    lost = np.logical_not(np.isfinite(surface.vertices).all(axis=1))
    if not lost.any():
        return surface
    notes.repaired("vertices that are NaN or infinite: dropped with their faces", int(lost.sum()))
    keep = ~lost[surface.faces].any(axis=1)
    smoothing = None if surface.smoothing is None else surface.smoothing[keep]
    new = np.cumsum(~lost) - 1
    return surface.taken(np.flatnonzero(~lost), new[surface.faces[keep]], smoothing=smoothing)


def _with_normals(surface: Surface) -> Surface:
    if surface.normals is not None or not len(surface.faces):
        return surface
    if surface.smoothing is None:
        source, new, normal = crease_normals(surface.vertices, surface.faces, CREASE_DEG)
        same = len(source) == len(surface.vertices) and bool((source == np.arange(len(source))).all())
        # Without a sharp edge the vertices stay as they are: no copy of large meshes.
        return replace(surface, faces=new, normals=normal) if same else _in_order(surface, source, new, normal)
    groups = surface.smoothing
    sources, faces, normals, count = [], np.empty_like(surface.faces), [], 0
    for group in np.unique(groups).tolist():
        rows = groups == group
        # Group 0 is flat, others are smooth inside; files that say nothing keep their sharp edges.
        crease = CREASE_DEG if group < 0 else 180.0 if group else 0.0
        part = surface.faces[rows]
        used, local = np.unique(part.reshape(-1), return_inverse=True)
        if group == 0:
            used, local = part.reshape(-1), np.arange(part.size)
        source, new, normal = crease_normals(surface.vertices[used], local.reshape(-1, 3), crease)
        sources.append(used[source])
        faces[rows] = new + count
        normals.append(normal)
        count += len(source)
    return _in_order(surface, np.concatenate(sources), faces, np.concatenate(normals))


def _in_order(surface: Surface, source: Array, faces: Array, normals: Array) -> Surface:
    """Vertices as the file has them, and behind them the copies that sharp edges need.

    Args:
        source: (N,) the vertex that each of N is a copy of.
        faces: (F,3) numbers among the N.
        normals: (N,3).
    """
    count = len(surface.vertices)
    first = np.zeros(len(source), bool)
    first[np.unique(source, return_index=True)[1]] = True
    place = np.where(first, source, count - 1 + np.cumsum(~first))
    ordered = np.zeros((count + int((~first).sum()), 3), normals.dtype)
    ordered[place] = normals
    return surface.taken(np.concatenate([np.arange(count), source[~first]]), place[faces], normals=ordered)


def unit_or_zero(normals: Array) -> Tensor:
    """(V,3) float32 unit normals; zero, which stands for "not known", where there is none."""
    value = np.array(normals, dtype=np.float64)
    largest = np.abs(value).max(axis=1, keepdims=True, initial=0.0)
    value = np.divide(value, largest, out=np.zeros_like(value), where=largest > 0)
    length = np.linalg.norm(value, axis=1, keepdims=True)
    unit = np.divide(value, length, out=np.zeros_like(value), where=length > 0)
    return torch.from_numpy(unit.astype(np.float32))


def linear_colors(values: Array, notes: Notes | None = None) -> Array:
    """(N,3|4) float32 linear out of what files store: sRGB codes in whole numbers, linear light in fractions.

    Whole numbers are codes up to 255, or up to the greatest of their type where there are larger ones; fractions above
    2 are codes up to 255 that were stored as fractions. Opacity is only scaled.
    """
    numbers = np.nan_to_num(np.asarray(values, np.float64), posinf=0.0, neginf=0.0).clip(0.0)
    top = color_top(values.dtype, float(numbers.max(initial=0.0)))
    if top is None:
        return numbers.astype(np.float32)
    if values.dtype.kind not in "iu" and notes is not None:
        notes.read("colours as fractions up to 255, read as sRGB codes")
    return decoded_colors(numbers, top)


def color_top(kind: np.dtype[Any], largest: float) -> float | None:
    """The code of white in a column of that type whose largest value is this; None: it is linear light."""
    whole = kind.kind in "iu"
    if not whole and largest <= 2.0:
        return None
    if whole and kind.itemsize > 1 and largest > 255.0:
        return 65535.0 if largest <= 65535.0 else float(np.iinfo(kind).max)
    return 255.0


def decoded_colors(codes: Array, top: float) -> Array:
    """(N,3|4) float32 linear of sRGB codes of which ``top`` is white; opacity is only scaled."""
    scaled = (codes / top).clip(0.0, 1.0)
    color = linear_from_srgb(torch.from_numpy(np.ascontiguousarray(scaled[:, :3]))).numpy()
    return np.concatenate([color, scaled[:, 3:]], axis=1).astype(np.float32)
