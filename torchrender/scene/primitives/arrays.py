"""Arrays of simple shapes about the origin, y up, with normals and texture coordinates; faces turn outwards."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.checks import ArrayLike, as_vector, check_range
from torchrender.errors import InputError

MAX_SEGMENTS = 2048


class ShapeArrays(NamedTuple):
    """What a mesh is made of."""

    vertices: Tensor  # (V,3) float64
    faces: Tensor  # (F,3) int64, counter-clockwise seen from outside
    normals: Tensor  # (V,3) float32
    uv: Tensor  # (V,2) float32


def box(size: ArrayLike) -> ShapeArrays:
    """Box with edge lengths ``size`` (3,); each side has its own vertices and the whole texture."""
    half = _positive("size", size, 3) / 2
    eye = torch.eye(3, dtype=torch.float64)
    corners = torch.tensor([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]], dtype=torch.float64)
    vertices, normals = [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            normal = eye[axis] * sign
            up = eye[1] if axis != 1 else eye[2] * -sign
            right = torch.linalg.cross(up, normal)
            vertices.append((normal + corners[:, :1] * right + corners[:, 1:] * up) * half)
            normals.append(normal.expand(4, 3))
    faces = torch.tensor([[0, 1, 2], [0, 2, 3]]).repeat(6, 1) + torch.arange(6).repeat_interleave(2)[:, None] * 4
    uv = ((corners + 1) / 2).repeat(6, 1)
    return ShapeArrays(torch.cat(vertices), faces, torch.cat(normals).float(), uv.float())


def plane(size: ArrayLike, segments: int = 1, tiles: float = 1.0) -> ShapeArrays:
    """Horizontal rectangle ``size`` (2,) along x and z that faces up, in ``segments`` x ``segments`` cells.

    The texture repeats ``tiles`` times along each side.
    """
    extent = _positive("size", size, 2)
    _check_segments(segments, 1)
    t = torch.linspace(0, 1, segments + 1, dtype=torch.float64)
    v, u = torch.meshgrid(t, t, indexing="ij")
    vertices = torch.stack([(u - 0.5) * extent[0], torch.zeros_like(u), (0.5 - v) * extent[1]], dim=-1).reshape(-1, 3)
    normals = torch.tensor([0.0, 1.0, 0.0]).expand(len(vertices), 3).contiguous()
    uv = torch.stack([u, v], dim=-1).reshape(-1, 2).float() * tiles
    return ShapeArrays(vertices, _grid_faces(segments, segments), normals, uv)


def quad(corner: ArrayLike, edge_u: ArrayLike, edge_v: ArrayLike) -> ShapeArrays:
    """Parallelogram from a corner and two edges (3,); it faces ``edge_u x edge_v``."""
    c, u, v = (as_vector(n, x, dtype=torch.float64) for n, x in (("corner", corner), ("u", edge_u), ("v", edge_v)))
    normal = torch.linalg.cross(u, v)
    if not normal.norm() > 0:
        raise InputError("edge_u and edge_v must span an area")
    vertices = torch.stack([c, c + u, c + u + v, c + v])
    return ShapeArrays(
        vertices=vertices,
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        normals=(normal / normal.norm()).float().expand(4, 3).contiguous(),
        uv=torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]),
    )


def sphere(radius: float = 1.0, segments: int = 64) -> ShapeArrays:
    """Sphere of ``segments`` meridians and half as many parallels; u runs around, v from pole to pole."""
    check_range("radius", radius, 1e-12)
    _check_segments(segments, 4)
    polar = torch.linspace(0, 1, segments // 2 + 1, dtype=torch.float64)
    profile = torch.stack([torch.sin(math.pi * polar), -torch.cos(math.pi * polar)], dim=1)
    profile[0, 0] = profile[-1, 0] = 0.0
    return _revolved(profile * radius, profile, segments)


def cylinder(radius: float = 1.0, height: float = 1.0, segments: int = 64) -> ShapeArrays:
    """Closed upright cylinder about the origin, with hard edges at its caps."""
    check_range("radius", radius, 1e-12)
    check_range("height", height, 1e-12)
    _check_segments(segments, 3)
    r, h = radius, height / 2
    profile = torch.tensor([[0, -h], [r, -h], [r, -h], [r, h], [r, h], [0, h]], dtype=torch.float64)
    normals = torch.tensor([[0, -1], [0, -1], [1, 0], [1, 0], [0, 1], [0, 1]], dtype=torch.float64)
    return _revolved(profile, normals, segments)


def cone(radius: float = 1.0, height: float = 1.0, segments: int = 64) -> ShapeArrays:
    """Closed upright cone; the origin is half-way up its axis."""
    check_range("radius", radius, 1e-12)
    check_range("height", height, 1e-12)
    _check_segments(segments, 3)
    slope = math.hypot(radius, height)
    profile = torch.tensor([[0, 0], [radius, 0], [radius, 0], [0, height]], dtype=torch.float64)
    profile[:, 1] -= height / 2
    side = [height / slope, radius / slope]
    normals = torch.tensor([[0, -1], [0, -1], side, side], dtype=torch.float64)
    return _revolved(profile, normals, segments)


def torus(radius: float = 1.0, tube: float = 0.3, segments: int = 64) -> ShapeArrays:
    """Ring about the y axis: ``radius`` to the middle of a tube of radius ``tube``."""
    check_range("tube", tube, 1e-12)
    check_range("radius", radius, tube)
    _check_segments(segments, 4)
    angle = torch.linspace(-math.pi, math.pi, segments // 2 + 1, dtype=torch.float64)
    around = torch.stack([torch.cos(angle), torch.sin(angle)], dim=1)
    around[-1] = around[0]
    return _revolved(around * tube + torch.tensor([radius, 0.0]), around, segments)


def _revolved(profile: Tensor, normals: Tensor, segments: int) -> ShapeArrays:
    """Surface of revolution about y from a profile (P,2) of radius and height, bottom to top, with its normals.

    A profile point used twice in a row makes a hard edge. Triangles that would collapse on the axis are left out.
    """
    angle = torch.arange(segments + 1, dtype=torch.float64) * (2 * math.pi / segments)
    angle[-1] = 0.0  # the seam closes exactly
    circle = torch.stack([torch.sin(angle), torch.cos(angle)], dim=1)

    def sweep(pairs: Tensor) -> Tensor:
        x = pairs[:, None, 0] * circle[None, :, 0]
        z = pairs[:, None, 0] * circle[None, :, 1]
        return torch.stack([x, pairs[:, None, 1].expand_as(x), z], dim=-1).reshape(-1, 3)

    vertices = sweep(profile)
    rows = len(profile)
    u = torch.linspace(0, 1, segments + 1).expand(rows, segments + 1)
    v = torch.linspace(0, 1, rows)[:, None].expand(rows, segments + 1)
    faces = _grid_faces(rows - 1, segments)
    corners = vertices[faces]
    whole = ((corners != corners.roll(1, dims=1)).any(dim=-1)).all(dim=1)
    return ShapeArrays(
        vertices=vertices,
        faces=faces[whole],
        normals=sweep(normals).float(),
        uv=torch.stack([u, v], dim=-1).reshape(-1, 2).contiguous(),
    )


def _grid_faces(rows: int, columns: int) -> Tensor:
    """(2 rows columns, 3) triangles of a grid of vertices, counter-clockwise for u right and v up."""
    start = torch.arange(rows)[:, None] * (columns + 1) + torch.arange(columns)
    a, b, c, d = start, start + 1, start + columns + 2, start + columns + 1
    return torch.stack([torch.stack([a, b, c], dim=-1), torch.stack([a, c, d], dim=-1)], dim=2).reshape(-1, 3)


def _positive(name: str, value: ArrayLike, size: int) -> Tensor:
    vector = as_vector(name, value, size, dtype=torch.float64)
    if not bool((vector > 0).all()):
        raise InputError(f"{name} must be positive, got {vector.tolist()}")
    return vector


def _check_segments(segments: int, low: int) -> None:
    check_range("segments", segments, low, MAX_SEGMENTS)
