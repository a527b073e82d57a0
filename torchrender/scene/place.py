"""Moving what a scene holds: meshes by any affine map, lights, cameras and media by a similarity."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.errors import InputError
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.medium import Medium
from torchrender.scene.mesh import Mesh

Array = np.ndarray[Any, Any]
_SIMILAR = 1e-6


def place_arrays(
    vertices: Array, faces: Array, normals: Array | None, world_from_local: Array
) -> tuple[Array, Array, Array | None]:
    """Vertices (V,3) float64, faces (F,3) int64 and normals (V,3) float32 or None after the affine map (4,4).

    Normals go by the inverse transpose; a mirroring map turns the faces over, so that outside stays outside. A
    singular map, which flattens the mesh, leaves no normals.
    """
    linear = world_from_local[:3, :3]
    # Multiplication may overflow for damaged matrices; the mesh then says that its vertices are not finite.
    with np.errstate(over="ignore", invalid="ignore"):
        moved = vertices @ linear.T + world_from_local[:3, 3]
        largest = np.abs(linear).max()
        linear = linear / (largest or 1.0)  # only directions count from here on: powers of tiny numbers would be 0
        volume = float(np.linalg.det(linear))
        # The cofactor matrix is the inverse transpose times the determinant and exists for singular maps too.
        cofactor = np.stack([np.cross(linear[:, (k + 1) % 3], linear[:, (k + 2) % 3]) for k in range(3)], axis=1)
    faces = faces.astype(np.int64)
    if volume < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    size = np.abs(cofactor).max()
    if normals is None or volume == 0 or not np.isfinite(size):
        return moved, faces, None
    turned = normals.astype(np.float64) @ (cofactor / size * np.sign(volume)).T
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    unit = np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)
    return moved, faces, unit.astype(np.float32)


def place_tangents(tangents: Array | None, world_from_local: Array) -> Array | None:
    """Tangents (V,4) float32 after the affine map (4,4); a mirroring map turns the sign of the bitangent.

    A map that flattens them away leaves zero, which stands for "not known".
    """
    if tangents is None:
        return None
    linear = world_from_local[:3, :3] / (np.abs(world_from_local[:3, :3]).max() or 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        along = np.nan_to_num(tangents[:, :3].astype(np.float64) @ linear.T)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    unit = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    sign = -1.0 if np.linalg.det(linear) < 0 else 1.0
    return np.concatenate([unit, tangents[:, 3:] * sign], axis=1).astype(np.float32)


def place_mesh(mesh: Mesh, world_from_local: Tensor) -> Mesh:
    """The mesh after the affine map (4,4)."""
    vertices, faces, normals = place_arrays(
        mesh.vertices.detach().double().numpy(),
        mesh.faces.numpy(),
        None if mesh.normals is None else mesh.normals.detach().numpy(),
        world_from_local.double().numpy(),
    )
    own = None if mesh.tangents is None else mesh.tangents.detach().numpy()
    tangents = place_tangents(own, world_from_local.double().numpy())
    return replace(
        mesh,
        vertices=torch.from_numpy(vertices),
        faces=torch.from_numpy(faces),
        normals=None if normals is None else torch.from_numpy(normals),
        tangents=None if tangents is None else torch.from_numpy(tangents),
    )


def similarity_scale(matrix: Tensor) -> float:
    """Scale of a map (4,4) made of rotation, uniform scale and translation.

    Raises:
        InputError: the map also shears, mirrors, or scales its axes differently.
    """
    linear = matrix[:3, :3].double()
    volume = float(torch.linalg.det(linear))
    scale = math.copysign(abs(volume) ** (1 / 3), volume)
    if scale <= 0 or not torch.allclose(linear @ linear.T / scale**2, torch.eye(3).double(), atol=_SIMILAR):
        raise InputError("lights, cameras and media can only be moved, turned and scaled evenly")
    return scale


def place_light(light: Light, matrix: Tensor) -> Light:
    """The light after a similarity (4,4); point and spot lights get brighter with the square of the scale, and their
    range grows with it, so that what they light looks the same.

    Raises:
        InputError: the map is no similarity.
    """
    matrix = matrix.double()
    scale = similarity_scale(matrix)
    linear = matrix[:3, :3]

    def point(p: Tensor) -> Tensor:
        return linear @ p.double() + matrix[:3, 3]

    if isinstance(light, DirectionalLight):
        return replace(light, direction=linear @ light.direction.double())
    if isinstance(light, RectLight):
        u, v = linear @ light.edge_u.double(), linear @ light.edge_v.double()
        return replace(light, corner=point(light.corner), edge_u=u, edge_v=v)
    intensity, reach = light.intensity * scale**2, light.range * scale
    if isinstance(light, SpotLight):
        direction = linear @ light.direction.double()
        return replace(light, position=point(light.position), direction=direction, intensity=intensity, range=reach)
    assert isinstance(light, PointLight)
    return replace(light, position=point(light.position), intensity=intensity, range=reach)


def place_cameras(cameras: Cameras, matrix: Tensor) -> Cameras:
    """The cameras after a similarity (4,4): they see the moved scene as they saw it before.

    Raises:
        InputError: the map is no similarity.
    """
    matrix = matrix.double()
    scale = similarity_scale(matrix)
    moved = cameras.camera_from_world @ torch.linalg.inv(matrix)
    moved[:, :3] *= scale
    intrinsics = cameras.intrinsics.clone()
    if cameras.orthographic:
        intrinsics[:, :2, :2] /= scale
    return replace(
        cameras, camera_from_world=moved, intrinsics=intrinsics, near=cameras.near * scale, far=cameras.far * scale
    )


def place_medium(medium: Medium, matrix: Tensor) -> Medium:
    """The medium after a move and an even scale; coefficients keep the optical depth of the box.

    Raises:
        InputError: the map also turns, which a box along the axes cannot follow.
    """
    matrix = matrix.double()
    scale = similarity_scale(matrix)
    if not torch.allclose(matrix[:3, :3] / scale, torch.eye(3).double(), atol=_SIMILAR):
        raise InputError(f"medium {medium.name!r} cannot be turned, its box lies along the axes")
    return replace(
        medium,
        low=medium.low.double() * scale + matrix[:3, 3],
        high=medium.high.double() * scale + matrix[:3, 3],
        absorption=medium.absorption / scale,
        scattering=medium.scattering / scale,
        emission=medium.emission,
        falloff=medium.falloff / scale,
        floor=None if medium.floor is None else medium.floor * scale + float(matrix[1, 3]),
    )
