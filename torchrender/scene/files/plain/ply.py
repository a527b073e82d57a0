"""PLY files: meshes, points and 3D Gaussians, whatever names and types their writers chose."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.plain.build import Surface, linear_colors
from torchrender.scene.files.plain.ply_columns import Columns, Lists, read_columns
from torchrender.scene.files.plain.ply_format import Header, read_header
from torchrender.scene.files.plain.polygons import triangulate
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]

NORMALS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"))
COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
OPACITIES = ("alpha", "diffuse_alpha", "a")
COORDINATES = (("texture_u", "texture_v"), ("u", "v"), ("s", "t"), ("texture_s", "texture_t"))
RADII = ("radius", "radii")
FACE_LISTS = ("vertex_indices", "vertex_index")
GAUSSIAN = (
    *(f"f_dc_{k}" for k in range(3)),
    "opacity",
    *(f"scale_{k}" for k in range(3)),
    *(f"rot_{k}" for k in range(4)),
)
"""What a vertex of a file of 3D Gaussians has (Kerbl et al. 2023)."""
_HARMONIC = 0.28209479177387814  # of degree 0
_TEXTURE = re.compile(r"TextureFile\s+(.+)", re.IGNORECASE)


@dataclass(frozen=True, eq=False, kw_only=True)
class Gaussians:
    """Shape, opacity and colour of N Gaussians."""

    scale: Array  # (N,3) float32 standard deviations along the own axes, scene units
    rotation: Array  # (N,4) float32 unit quaternions w, x, y, z
    opacity: Array  # (N,) float32 in [0,1]
    color: Array  # (N,3) float32 linear


@dataclass(frozen=True, eq=False, kw_only=True)
class PlyModel:
    """What a file holds."""

    position: Array  # (V,3) float64
    normals: Array | None
    uv: Array | None
    colors: Array | None  # (V,3|4) linear
    radius: Array | None  # (V,)
    corners: Array  # (C,) int64 vertex of each corner of each face
    counts: Array  # (P,) int64 corners of each face
    corner_uv: Array | None  # (C,2)
    face_colors: Array | None  # (P,3|4) linear
    gaussians: Gaussians | None
    textures: tuple[str, ...]


def has_faces(path: Path, data: bytes) -> bool:
    """Whether a PLY file declares faces or strips."""
    return declares_faces(read_header(path, data))


def declares_faces(header: Header) -> bool:
    """Whether a header declares faces or strips."""
    return any(e.count and e.name in ("face", "tristrips") for e in header.elements)


def read_ply(path: Path, data: bytes, notes: Notes) -> PlyModel:
    """The content of a file.

    Raises:
        SceneFileError: damaged, cut off, or without positions.
    """
    header = read_header(path, data)
    elements = read_columns(path, data, header, notes)
    vertex = {k: v for k, v in elements.get("vertex", {}).items() if not isinstance(v, Lists)}
    position = group_of(vertex, (("x", "y", "z"),))
    if position is None:
        raise SceneFileError(path, "has no vertices with x, y and z")
    count = len(position)
    face = elements.get("face", {})
    corners, counts = _faces(path, elements, count)
    for name in elements:
        if name not in ("vertex", "face", "tristrips") and header.element(name):
            notes.not_used(f"element {name!r}", header.element(name).count)  # type: ignore[union-attr]
    say_unused_columns(header, notes)
    corner_uv = _corner_uv(face, counts) if "face" in elements else None
    face_colors = _colors({k: v for k, v in face.items() if not isinstance(v, Lists)}, notes)
    return PlyModel(
        position=position.astype(np.float64, copy=False),
        normals=group_of(vertex, NORMALS),
        uv=group_of(vertex, COORDINATES),
        colors=_colors(vertex, notes),
        radius=next((np.asarray(vertex[n], np.float64) for n in RADII if n in vertex), None),
        corners=corners,
        counts=counts,
        corner_uv=corner_uv,
        face_colors=face_colors if face_colors is not None and len(face_colors) == len(counts) else None,
        gaussians=_gaussians(vertex, notes),
        textures=tuple(m.group(1).strip() for c in header.comments if (m := _TEXTURE.match(c))),
    )


def say_unused_columns(header: Header, notes: Notes) -> None:
    """Name the columns of vertices and faces that nothing is made of."""
    element = header.element("vertex")
    if element is not None and element.count:
        names = {p.name.lower() for p in element.properties}
        gaussian = {n for n in names if names >= set(GAUSSIAN) and (n in GAUSSIAN or n.startswith("f_rest_"))}
        groups = [next((g for g in groups if names >= set(g)), ()) for groups in (NORMALS, COLORS, COORDINATES)]
        used = {"x", "y", "z", *gaussian, *(n for g in groups for n in g)}
        used |= {n for n in OPACITIES if groups[1]} | set(RADII)
        left = sorted(names - used)
        notes.not_used(f"columns of vertices: {', '.join(left)[:200]}", len(left))
    element = header.element("face")
    if element is not None and element.count:
        names = {p.name.lower() for p in element.properties}
        group = next((g for g in COLORS if names >= set(g)), ())
        left = sorted(names - {*FACE_LISTS, "texcoord", *group, *(OPACITIES if group else ())})
        notes.not_used(f"columns of faces: {', '.join(left)[:200]}", len(left))


def group_of(columns: dict[str, Array], names: tuple[tuple[str, ...], ...]) -> Array | None:
    """The first group of columns that is there, side by side; names do not care about case."""
    lower = {k.lower(): v for k, v in columns.items()}
    for group in names:
        if all(n in lower for n in group):
            return np.stack([lower[n] for n in group], axis=1)
    return None


def _colors(columns: dict[str, Array], notes: Notes) -> Array | None:
    color = group_of(columns, COLORS)
    if color is None:
        return None
    opacity = next((columns[n] for n in OPACITIES if n in columns), None)
    if opacity is not None and opacity.dtype == color.dtype:
        color = np.concatenate([color, opacity[:, None]], axis=1)
    return linear_colors(color, notes)


def _faces(path: Path, elements: dict[str, Columns], vertices: int) -> tuple[Array, Array]:
    """Corners and their counts, of faces and of strips of triangles."""
    found = next((elements.get("face", {}).get(n) for n in FACE_LISTS if n in elements.get("face", {})), None)
    strips = next(
        (elements.get("tristrips", {}).get(n) for n in FACE_LISTS if n in elements.get("tristrips", {})), None
    )
    if isinstance(strips, Lists):
        corners = _strips(strips.values.astype(np.int64))
        counts = np.full(len(corners) // 3, 3, np.int64)
    elif isinstance(found, Lists):
        corners, counts = found.values.astype(np.int64), found.counts
    else:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    if corners.size and not 0 <= int(corners.min()) <= int(corners.max()) < vertices:
        reason = f"faces must index {vertices} vertices, got {int(corners.min())} to {int(corners.max())}"
        raise SceneFileError(path, reason)
    return corners, counts


def _strips(values: Array) -> Array:
    """Corners of the triangles of strips, which -1 ends; every other triangle of a strip is turned."""
    if len(values) < 3:
        return np.zeros(0, np.int64)
    ends = values < 0
    # Place within the own strip.
    starts = np.maximum.accumulate(np.where(ends, np.arange(len(values)) + 1, 0))
    within = np.arange(len(values)) - starts
    windows = np.stack([values[:-2], values[1:-1], values[2:]], axis=1)
    whole = ~(ends[:-2] | ends[1:-1] | ends[2:])
    odd = within[:-2] % 2 == 1
    windows[odd] = windows[odd][:, ::-1]
    different = (windows[:, 0] != windows[:, 1]) & (windows[:, 1] != windows[:, 2]) & (windows[:, 0] != windows[:, 2])
    return windows[whole & different].reshape(-1)


def _corner_uv(face: Columns, counts: Array) -> Array | None:
    """Texture coordinates of the corners of faces: a list of u, v, u, v ..."""
    found = face.get("texcoord")
    if not isinstance(found, Lists) or not np.array_equal(found.counts, 2 * counts):
        return None
    return found.values.reshape(-1, 2)


def _gaussians(vertex: dict[str, Array], notes: Notes) -> Gaussians | None:
    if not all(n in vertex for n in GAUSSIAN):
        return None

    def columns(name: str, count: int) -> Array:
        return np.stack([np.asarray(vertex[f"{name}_{k}"], np.float32) for k in range(count)], axis=1)

    higher = sum(n.startswith("f_rest_") for n in vertex)
    notes.not_used("colours that change with the direction of view (higher harmonics)", higher)
    turn = columns("rot", 4)
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    unit = np.where(length > 0, turn / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0, 0.0])
    with np.errstate(over="ignore"):
        opacity = 1.0 / (1.0 + np.exp(-np.asarray(vertex["opacity"], np.float64)))
        scale = np.exp(columns("scale", 3).astype(np.float64)).clip(0.0, 1e30)
    codes = (0.5 + _HARMONIC * columns("f_dc", 3).astype(np.float64)).clip(0.0, 1.0)
    return Gaussians(
        scale=scale.astype(np.float32),
        rotation=unit.astype(np.float32),
        opacity=np.nan_to_num(opacity).astype(np.float32),
        color=linear_colors(np.rint(codes * 65535.0).astype(np.uint16)),
    )


def surface_of(model: PlyModel, notes: Notes) -> Surface:
    """The triangles of a file with faces; attributes of faces and corners go to vertices of their own."""
    split = model.corner_uv is not None or (model.face_colors is not None and model.colors is None)
    if not split and bool((model.counts == 3).all()):  # most large files: nothing to cut, nothing to split
        return _plain_surface(model)
    places, owner = triangulate(model.position, model.corners, model.counts)
    few = int((model.counts < 3).sum())
    notes.repaired("faces with less than three corners: left out", few)
    rows = model.corners[places.reshape(-1)] if split else np.arange(len(model.position))
    faces = np.arange(len(rows)).reshape(-1, 3) if split else model.corners[places]
    colors, uv = model.colors, model.uv
    if colors is not None:
        colors = colors[rows]
    elif model.face_colors is not None:
        colors = model.face_colors[owner.repeat(3)]
    if model.corner_uv is not None:
        uv = model.corner_uv[places.reshape(-1)]
    elif uv is not None:
        uv = uv[rows]
    return Surface(
        vertices=model.position[rows],
        faces=faces,
        normals=None if model.normals is None else model.normals[rows],
        uv=None if uv is None else uv.astype(np.float64),
        **_tint(colors),
    )


def _plain_surface(model: PlyModel) -> Surface:
    return Surface(
        vertices=model.position,
        faces=model.corners.reshape(-1, 3),
        normals=model.normals,
        uv=None if model.uv is None else model.uv.astype(np.float64),
        **_tint(model.colors),
    )


def _tint(colors: Array | None) -> dict[str, Any]:
    has_alpha = colors is not None and colors.shape[1] == 4 and bool((colors[:, 3] < 1.0).any())
    return {
        "colors": None if colors is None else colors[:, :3],
        "alpha": colors[:, 3] if colors is not None and has_alpha else None,
    }
