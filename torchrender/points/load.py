"""Point clouds from PLY files, and from meshes by sampling their surfaces."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from trimesh.exchange.ply import load_ply

from torchrender.checks import check_range
from torchrender.errors import InputError, MeshError, SceneFileError
from torchrender.numerics.texture import color_pyramid, sample_texture
from torchrender.points.cloud import PointCloud
from torchrender.scene.files.plain.read import check_ply, linear_colors
from torchrender.scene.files.source import read_bytes
from torchrender.scene.load import load
from torchrender.scene.model import Scene

SAMPLES = 1_000_000
"""Points that a mesh is sampled by, if not told otherwise."""

OPEN = 0.1
"""Share of its area that the area vectors of a closed surface may add up to: scanned meshes have small holes."""

COVER = 1.7
"""Radius of sampled points over the square root of the area that each stands for: random points leave few holes."""


def load_points(path: str | Path, *, samples: int | None = None, seed: int = 0) -> PointCloud:
    """A point cloud from a PLY file without faces, or ``samples`` points on the surfaces of anything else.

    PLY vertices may have normals (nx, ny, nz), colours (red, green, blue: integers are sRGB, floats linear) and radii
    (``radius``, in scene units); missing normals and radii are estimated. Other mesh and scene files, and the names
    of built-in scenes, are loaded as by :func:`torchrender.load` and sampled.

    Raises:
        SceneFileError: missing, damaged or unsupported file.
        InputError: positions that are not finite; an unknown name; ``samples`` given for a file of points.
    """
    source = Path(path)
    if source.suffix.lower() == ".ply":
        data = read_bytes(source)
        if not has_faces(source, data):
            if samples is not None:
                raise InputError(f"samples is for meshes only, {source} holds points")
            return _read_points(source, data)
    return sample_points(load(path), SAMPLES if samples is None else samples, seed=seed)


def has_faces(path: Path, data: bytes) -> bool:
    """Whether a PLY file declares faces."""
    header = check_ply(path, data)
    rows = [line.split() for line in header.splitlines() if line.startswith("element face ")]
    return any(int(row[2]) > 0 for row in rows)


def holds_points(path: str | Path) -> bool:
    """Whether a file is a PLY file without faces."""
    source = Path(path)
    return source.suffix.lower() == ".ply" and source.is_file() and not has_faces(source, read_bytes(source))


def _read_points(path: Path, data: bytes) -> PointCloud:
    try:
        loaded = load_ply(io.BytesIO(data), skip_materials=True)
        position = np.asarray(loaded.get("vertices", np.zeros((0, 3))), np.float64)
        raw: Any = loaded.get("metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data", {})
        radius = _column(raw, "radius", len(position))
    # trimesh raises whatever its parsing runs into.
    except Exception as error:
        raise SceneFileError(path, f"damaged or no PLY file ({error})") from error
    if not len(position):
        raise SceneFileError(path, "holds no points")
    wrong = ~np.isfinite(position).all(axis=1)
    if wrong.any():
        reason = f"{int(wrong.sum())} of {len(position)} points are NaN or infinite, first {int(wrong.argmax())}"
        raise SceneFileError(path, reason)
    normal = loaded.get("vertex_normals")
    return PointCloud(
        position=torch.from_numpy(position),
        normal=None if normal is None else torch.from_numpy(np.array(normal, np.float64)),
        radius=None if radius is None else torch.from_numpy(radius),
        color=linear_colors(loaded.get("vertex_colors"), len(position)),
        name=path.stem,
    ).completed()


def _column(raw: Any, name: str, count: int) -> np.ndarray[Any, Any] | None:
    """A vertex property that trimesh does not know."""
    known = raw if isinstance(raw, dict) else getattr(getattr(raw, "dtype", None), "names", None) or ()
    if name not in known:
        return None
    column = np.asarray(raw[name], np.float64).reshape(-1)
    return column if len(column) == count else None


def sample_points(scene: Scene, count: int, *, seed: int = 0) -> PointCloud:
    """``count`` points spread evenly over all surfaces of a scene, with normals, colours and radii.

    A closed surface that is inside out is turned; an open one gives points that are drawn from both sides. Stratified
    along the triangles by area. Radius: 1.7 times the square root of the area per point. Colours are those
    of the material, texture and vertices, unlit.

    Raises:
        MeshError: a scene without surfaces.
        OptionError: ``count`` < 1.
    """
    check_range("count", count, 1, 2**31)
    geometry = scene.geometry
    corners = geometry.vertices[geometry.faces.long()]
    area = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1)
    total = float(area.sum())
    if not total > 0:
        raise MeshError(f"scene {scene.name!r} has no surface to sample")
    sign, two_sided = _sides(corners, area)
    generator = torch.Generator().manual_seed(seed)
    place = (torch.arange(count, dtype=torch.float64) + torch.rand(count, generator=generator).double()) / count
    triangle = torch.searchsorted(area.cumsum(0), place * total).clamp_max(len(area) - 1)
    # Points of area zero at the end of the list are no place for a sample.
    triangle = triangle.clamp_max(int((area > 0).nonzero().max()))
    # Roberts' two-dimensional golden ratio: neighbours within a triangle keep apart, so that few discs leave no hole.
    steps = torch.arange(count, dtype=torch.float64)[None] * torch.tensor([[0.7548776662466927], [0.5698402909980532]])
    u, v = (steps + torch.rand(2, 1, generator=generator).double()) % 1.0
    root = u.sqrt()
    weights = torch.stack([1 - root, root * (1 - v), root * v], dim=1)
    chosen = geometry.faces[triangle].long()
    return PointCloud(
        position=(weights[:, :, None] * corners[triangle]).sum(1),
        normal=sign * _normals(scene, triangle, chosen, weights),
        radius=torch.full((count,), COVER * math.sqrt(total / count)),
        color=_colors(scene, triangle, chosen, weights.float(), math.sqrt(total / count)),
        two_sided=two_sided,
        name=scene.name,
    )


def _sides(corners: Tensor, area: Tensor) -> tuple[float, bool]:
    """-1 if a closed surface is inside out, else 1; and whether it is open, so that both sides have to be drawn.

    The area vectors of a closed surface add up to nothing, and the volume below it tells where its outside is.
    """
    corners = corners - corners.reshape(-1, 3).mean(0)
    vector = 0.5 * torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if float(vector.sum(0).norm()) > OPEN * float(area.sum()):
        return 1.0, True
    volume = float((vector * corners.mean(1)).sum())
    return (-1.0 if volume < 0 else 1.0), False


def _normals(scene: Scene, triangle: Tensor, chosen: Tensor, weights: Tensor) -> Tensor:
    """Shading normals; the triangle's own where there is none, and never on its other side."""
    geometry = scene.geometry
    flat = geometry.face_normals[triangle]
    if geometry.normals is None:
        return flat
    smooth = (weights[:, :, None].float() * geometry.normals[chosen]).sum(1)
    usable = (smooth.norm(dim=1) > 1e-6) & ((smooth * flat).sum(1) > 0)
    return torch.where(usable[:, None], smooth, flat)


def _colors(scene: Scene, triangle: Tensor, chosen: Tensor, weights: Tensor, spacing: float) -> Tensor:
    """Diffuse reflectance of each point, textures filtered to the spacing of the points."""
    geometry = scene.geometry
    material = geometry.material[triangle]
    color = scene.material_table.diffuse[material].clone()
    if geometry.colors is not None:
        color = color * (weights[:, :, None] * geometry.colors[chosen]).sum(1)
    if geometry.uv is None:
        return color
    uv = (weights[:, :, None] * geometry.uv[chosen]).sum(1)
    # Texture coordinates per scene unit, from the areas of the triangles here and in the texture.
    edges = geometry.uv[chosen[:, 1:]] - geometry.uv[chosen[:, :1]]
    sides = geometry.vertices[chosen[:, 1:]] - geometry.vertices[chosen[:, :1]]
    span = (edges[:, 0, 0] * edges[:, 1, 1] - edges[:, 0, 1] * edges[:, 1, 0]).abs()
    extent = torch.linalg.cross(sides[:, 0], sides[:, 1]).norm(dim=1).float().clamp_min(1e-30)
    footprint = spacing * (span / extent).sqrt()
    for number, one in enumerate(scene.materials):
        if one.diffuse_texture is None:
            continue
        rows = (material == number).nonzero().reshape(-1)
        if len(rows):
            texels = sample_texture(color_pyramid(one.diffuse_texture), uv[rows], footprint[rows])
            color[rows] = color[rows] * texels[..., :3]
    return color
