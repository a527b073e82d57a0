"""Pieces of geometry as numpy arrays: boxes, extruded masks, sheets and rounded solids.

Everything is vectorised, y is up, lengths are metres, and triangles run counter-clockwise seen from outside. A zero
normal means: use the face's own normal. Texture coordinates of flat pieces are metres, so that one texture scale fits
a whole room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Vector = Sequence[float] | Array


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles without a material."""

    vertices: Array  # (V,3)
    faces: Index  # (F,3)
    normals: Array | None = None  # (V,3) unit, or zero for flat shading
    uv: Array | None = None  # (V,2)
    colors: Array | None = None  # (V,3)

    @property
    def count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    def moved(self, offset: Vector = (0.0, 0.0, 0.0), *, yaw_deg: float = 0.0, tilt_deg: float = 0.0) -> Part:
        """Tilted about z, then turned about y, then shifted."""
        return self.transformed(yaw_matrix(yaw_deg) @ tilt_matrix(tilt_deg), offset)

    def transformed(self, matrix: Array, offset: Vector = (0.0, 0.0, 0.0)) -> Part:
        """Vertices ``M v + offset``; a mirroring matrix also turns the triangles round."""
        normals = self.normals
        if normals is not None:
            normals = unit(normals @ np.linalg.inv(matrix))
        faces = self.faces if np.linalg.det(matrix) > 0 else self.faces[:, ::-1].copy()
        return replace(self, vertices=self.vertices @ matrix.T + np.asarray(offset), faces=faces, normals=normals)

    def tinted(self, color: Array) -> Part:
        """The same triangles with vertex colours: one (3,) or one per vertex (V,3)."""
        return replace(self, colors=np.broadcast_to(np.asarray(color, dtype=np.float64), self.vertices.shape).copy())

    def mapped(self, scale: float | tuple[float, float]) -> Part:
        """The same triangles with texture coordinates multiplied by ``scale``."""
        return self if self.uv is None else replace(self, uv=self.uv * np.asarray(scale))


def unit(v: NDArray[Any]) -> Array:
    """Rows of length one; zero rows stay zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.asarray(v / np.where(length > 0, length, 1.0), dtype=np.float64)


def yaw_matrix(degrees: float) -> Array:
    """(3,3) turn about +y; positive turns +z towards +x."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def tilt_matrix(degrees: float) -> Array:
    """(3,3) turn about +z; positive turns +x towards +y."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def pitch_matrix(degrees: float) -> Array:
    """(3,3) turn about +x; positive turns +y towards +z."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def merge(parts: Sequence[Part]) -> Part:
    """One part from several; missing normals, coordinates and colours become zero, zero and one."""
    sizes = [len(p.vertices) for p in parts]
    starts = np.concatenate([[0], np.cumsum(sizes)])

    def column(name: str, width: int, missing: float) -> Array | None:
        values = [getattr(p, name) for p in parts]
        if all(v is None for v in values):
            return None
        return np.concatenate([np.full((n, width), missing) if v is None else v for v, n in zip(values, sizes)])

    return Part(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.faces + s for p, s in zip(parts, starts)]),
        column("normals", 3, 0.0),
        column("uv", 2, 0.0),
        column("colors", 3, 1.0),
    )


def quads(index: Index) -> Index:
    """Two triangles for each cell of an index grid (..., n, m): rows run along u, columns along v, u x v outwards."""
    a, b = index[..., :-1, :-1], index[..., 1:, :-1]
    c, d = index[..., 1:, 1:], index[..., :-1, 1:]
    return np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=-2).reshape(-1, 3)


def repeat_pattern(faces: Index, vertices_each: int, copies: int) -> Index:
    """The same triangle pattern for ``copies`` bodies of ``vertices_each`` vertices that follow one another."""
    offsets = np.arange(copies, dtype=np.int64) * vertices_each
    return (faces[None] + offsets[:, None, None]).reshape(-1, 3)


_CUBE_SIDES = (  # axis u, axis v, fixed axis, its sign; u x v points outwards
    (1, 2, 0, 1.0),
    (2, 1, 0, -1.0),
    (2, 0, 1, 1.0),
    (0, 2, 1, -1.0),
    (0, 1, 2, 1.0),
    (1, 0, 2, -1.0),
)


def boxes(centres: Array, sizes: Array, yaw_deg: Array | None = None) -> Part:
    """N closed boxes (N,3), each with 24 vertices, 12 triangles and texture coordinates in metres."""
    centres, sizes = np.atleast_2d(centres).astype(float), np.atleast_2d(sizes).astype(float)
    corner, coordinate = np.zeros((6, 4, 3)), np.zeros((6, 4), dtype=np.int64)
    for k, (u, v, w, sign) in enumerate(_CUBE_SIDES):
        corner[k, :, w] = sign
        corner[k, :, u] = (-1, 1, 1, -1)
        corner[k, :, v] = (-1, -1, 1, 1)
        coordinate[k] = (u, v, u, v)
    local = corner.reshape(24, 3)[None] * (sizes[:, None] / 2)
    world = local + centres[:, None]
    uv = np.zeros((len(centres), 24, 2))
    for k, (u, v, _, _) in enumerate(_CUBE_SIDES):
        across, along = (v, u) if u == 1 else (u, v)
        uv[:, 4 * k : 4 * k + 4] = world[:, 4 * k : 4 * k + 4][:, :, (across, along)]
    if yaw_deg is not None:
        c, s = np.cos(np.radians(yaw_deg))[:, None], np.sin(np.radians(yaw_deg))[:, None]
        x, z = local[..., 0].copy(), local[..., 2].copy()
        world = np.stack([c * x + s * z, local[..., 1], -s * x + c * z], -1) + centres[:, None]
    pattern = (np.array([[0, 1, 2], [0, 2, 3]])[None] + 4 * np.arange(6)[:, None, None]).reshape(-1, 3)
    return Part(world.reshape(-1, 3), repeat_pattern(pattern, 24, len(centres)), uv=uv.reshape(-1, 2))


def box(low: Vector, high: Vector, *, cell: float | None = None) -> Part:
    """A closed box between two corners; with ``cell`` its sides are cut into squares of about that many metres."""
    a, b = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    if cell is None:
        return boxes((a + b) / 2, b - a)
    return gridded_box(a, b, np.maximum(np.ceil((b - a) / cell), 1).astype(int))


def gridded_box(low: Array, high: Array, cells: Sequence[int] | Index) -> Part:
    """A closed box whose sides are cut into ``cells`` (3,) equal parts; 4 (ab + bc + ca) triangles."""
    lines = [np.linspace(low[k], high[k], int(cells[k]) + 1) for k in range(3)]
    return merge([_side(lines, *side) for side in _CUBE_SIDES])


def _side(lines: Sequence[Array], u: int, v: int, w: int, sign: float) -> Part:
    p = np.zeros((len(lines[u]), len(lines[v]), 3))
    p[..., u], p[..., v] = lines[u][:, None], lines[v][None]
    p[..., w] = lines[w][-1 if sign > 0 else 0]
    flat = p.reshape(-1, 3)
    across, along = (v, u) if u == 1 else (u, v)
    return Part(flat, quads(np.arange(len(flat)).reshape(p.shape[:2])), uv=flat[:, (across, along)])


def rounded_box(size: Vector, radius: float, *, steps: int = 2, cells: int = 1, puff: float = 0.0) -> Part:
    """A closed box about the origin with rounded edges and smooth normals; ``puff`` swells its sides like a cushion.

    ``steps`` cells round each edge and ``cells`` between them: 12 (2 steps + cells)^2 triangles. Without steps it is a
    plain box.
    """
    half = np.asarray(size, dtype=float) / 2
    if steps == 0:
        return boxes(np.zeros(3), 2 * half)
    radius = min(radius, float(half.min()) * 0.999)
    curve = np.tan((np.arange(steps + 1) / steps - 1) * np.pi / 4) * radius
    lines = []
    for h in half:
        inner = np.linspace(-(h - radius), h - radius, cells + 1)
        lines.append(np.concatenate([inner[0] + curve[:-1], inner, inner[-1] - curve[:-1][::-1]]))
    part = merge([_side(lines, *side) for side in _CUBE_SIDES])
    v = part.vertices
    core = np.clip(v, -(half - radius), half - radius)
    normals = unit(v - core)
    surface = core + radius * normals
    if puff > 0:
        share = np.cos(np.clip(surface / half, -1, 1) * np.pi / 2).clip(0)
        bulge = (share + np.abs(normals) * (1 - share)).prod(axis=1)
        surface = surface + normals * (puff * bulge)[:, None]
        normals = smooth_normals(surface, part.faces)
    return replace(part, vertices=surface, normals=normals)


def smooth_normals(vertices: Array, faces: Index) -> Array:
    """Area-weighted vertex normals; vertices at the same place (to 1e-7 m) share one."""
    _, same = np.unique(np.round(vertices, 7), axis=0, return_inverse=True)
    same = same.reshape(-1)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    corner = same[faces].reshape(-1)
    weight = np.repeat(cross, 3, axis=0)
    total = np.stack([np.bincount(corner, weight[:, k], minlength=same.max() + 1) for k in range(3)], axis=1)
    return unit(total)[same]


def sheet(points: Array, *, smooth: bool = True, uv: Array | None = None) -> Part:
    """An open surface through the grid ``points`` (n,m,3); d/drow x d/dcolumn points outwards."""
    n, m, _ = points.shape
    normals = None
    if smooth:
        normals = unit(np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))).reshape(-1, 3)
    if uv is None:
        uv = np.stack(np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, m), indexing="ij"), axis=-1)
    return Part(points.reshape(-1, 3), quads(np.arange(n * m).reshape(n, m)), normals, uv.reshape(-1, 2))


def thick_sheet(points: Array, thickness: float) -> Part:
    """A closed body of constant thickness behind the grid ``points`` (n,m,3)."""
    front = sheet(points)
    assert front.normals is not None
    back = points - thickness * front.normals.reshape(points.shape)
    rim = [np.concatenate([p[:, 0], p[-1, 1:], p[-2::-1, -1], p[0, -2::-1]]) for p in (points, back)]
    return merge([front, sheet(back[:, ::-1]), sheet(np.stack([rim[1], rim[0]], axis=1), smooth=False)])


def extruded(xs: Vector, ys: Vector, mask: Sequence[Sequence[int]], depth: float) -> Part:
    """A closed plate from z = 0 to ``depth`` made of the cells of an x/y grid that ``mask`` (rows y, columns x) keeps.

    Walls with windows, frames and shelves: neighbouring cells share their edges, so no light leaks at joints.
    """
    x, y, keep = np.asarray(xs, dtype=float), np.asarray(ys, dtype=float), np.asarray(mask, dtype=bool)
    padded = np.pad(keep, 1)
    corners: list[Array] = []

    def add(cells: tuple[Index, ...], steps: Sequence[tuple[int, int, float]]) -> None:
        j, i = cells
        if len(j):
            corners.append(
                np.stack([np.stack([x[i + di], y[j + dj], np.full(len(i), z)], -1) for di, dj, z in steps], 1)
            )

    d = depth
    add(np.nonzero(keep), [(0, 0, d), (1, 0, d), (1, 1, d), (0, 1, d)])
    add(np.nonzero(keep), [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)])
    add(np.nonzero(keep & ~padded[1:-1, :-2]), [(0, 0, 0), (0, 0, d), (0, 1, d), (0, 1, 0)])
    add(np.nonzero(keep & ~padded[1:-1, 2:]), [(1, 0, 0), (1, 1, 0), (1, 1, d), (1, 0, d)])
    add(np.nonzero(keep & ~padded[:-2, 1:-1]), [(0, 0, 0), (1, 0, 0), (1, 0, d), (0, 0, d)])
    add(np.nonzero(keep & ~padded[2:, 1:-1]), [(0, 1, 0), (0, 1, d), (1, 1, d), (1, 1, 0)])
    v = np.concatenate(corners)
    faces = repeat_pattern(np.array([[0, 1, 2], [0, 2, 3]]), 4, len(v))
    flat = v.reshape(-1, 3)
    return Part(flat, faces, uv=flat[:, :2].copy())


def frame(width: float, height: float, border: float, depth: float) -> Part:
    """A rectangular frame about the origin, from z = 0 to ``depth``."""
    w, h = width / 2, height / 2
    return extruded(
        (-w, -w + border, w - border, w), (-h, -h + border, h - border, h), ((1, 1, 1), (1, 0, 1), (1, 1, 1)), depth
    )
