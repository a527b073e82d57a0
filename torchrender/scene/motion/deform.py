"""Shapes bent by morph targets and skins, and put in their place.

Source: glTF 2.0 specification, sections 3.7.2.2 (morph targets) and 3.7.3 (skins).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.scene.motion.records import Array, Shape, Skin
from torchrender.scene.place import place_arrays, place_tangents


class Placed(NamedTuple):
    """A shape in world space."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int64
    normals: Array | None  # (V,3) float32
    tangents: Array | None  # (V,4) float32


def placed(shape: Shape, world: Array, weights: Array | None, skin: Skin | None, worlds: Array) -> Placed:
    """The shape with these weights of its morph targets, hung on the joints of its skin or on its node's ``world``."""
    shaped = _morphed(shape, weights)
    if skin is None or shape.joints is None:
        vertices, faces, normals = place_arrays(*shaped[:3], world)
        return Placed(vertices, faces, normals, place_tangents(shaped.tangents, world))
    return _skinned(shape, shaped, worlds[skin.joints] @ skin.inverse_bind)


def _morphed(shape: Shape, weights: Array | None) -> Placed:
    """The shape in its own frame."""
    rest = Placed(shape.vertices, shape.faces, shape.normals, shape.tangents)
    if shape.target_positions is None or weights is None or not np.any(weights):
        return rest
    used = np.flatnonzero(weights[: len(shape.target_positions)])
    share = weights[used]
    with np.errstate(over="ignore", invalid="ignore"):
        vertices = shape.vertices + np.tensordot(share, shape.target_positions[used].astype(np.float64), 1)
    normals, tangents = shape.normals, shape.tangents
    if shape.target_normals is not None:
        normals = normals + np.tensordot(share, shape.target_normals[used], 1).astype(np.float32)
    elif not shape.own_normals:
        normals = _derived(shape, vertices)
    if tangents is not None and shape.target_tangents is not None:
        tangents = tangents.copy()
        tangents[:, :3] += np.tensordot(share, shape.target_tangents[used], 1).astype(np.float32)
    return Placed(vertices, shape.faces, normals, tangents)


def _derived(shape: Shape, vertices: Array) -> Array:
    """(V,3) float32 normals weighted by area, shared by those that shared one in rest."""
    corners = vertices[shape.faces]
    with np.errstate(over="ignore", invalid="ignore"):
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    labels = shape.smooth_groups
    groups, count = labels[shape.faces].reshape(-1), int(labels.max(initial=-1)) + 1
    weighted = np.nan_to_num(cross).repeat(3, axis=0)
    sums = np.stack([np.bincount(groups, weights=weighted[:, k], minlength=count) for k in range(3)], axis=1)
    return _unit(sums)[labels].astype(np.float32)


def _skinned(shape: Shape, shaped: Placed, joints: Array) -> Placed:
    """After the weighted maps (J,4,4) of the joints."""
    with np.errstate(over="ignore", invalid="ignore"):
        flat = joints[: shape.skinning.shape[1], :3].reshape(-1, 12)
        maps = (shape.skinning @ flat).reshape(-1, 3, 4)
        linear = maps[:, :, :3]
        vertices = np.einsum("vij,vj->vi", linear, shaped.vertices) + maps[:, :, 3]
        # The cofactor matrix is the inverse transpose times the determinant, and exists for singular maps too.
        cofactor = np.stack([np.cross(linear[:, :, (k + 1) % 3], linear[:, :, (k + 2) % 3]) for k in range(3)], axis=2)
        volume = np.einsum("vi,vi->v", linear[:, :, 0], cofactor[:, :, 0])
        sign = np.where(volume < 0, -1.0, 1.0)
        normals = None
        if shaped.normals is not None:
            turned = np.einsum("vij,vj->vi", cofactor, shaped.normals.astype(np.float64)) * sign[:, None]
            normals = _unit(np.nan_to_num(turned)).astype(np.float32)
        tangents = None
        if shaped.tangents is not None:
            along = _unit(np.nan_to_num(np.einsum("vij,vj->vi", linear, shaped.tangents[:, :3].astype(np.float64))))
            tangents = np.concatenate([along, shaped.tangents[:, 3:] * sign[:, None]], axis=1).astype(np.float32)
    mirrored = float(np.nan_to_num(volume).sum()) < 0
    faces = np.ascontiguousarray(shaped.faces[:, ::-1]) if mirrored else shaped.faces
    return Placed(vertices, faces, normals, tangents)


def _unit(vectors: Array) -> Array:
    largest = np.abs(vectors).max(axis=-1, keepdims=True, initial=0.0)
    scaled = np.divide(vectors, largest, out=np.zeros_like(vectors), where=largest > 0)
    length = np.linalg.norm(scaled, axis=-1, keepdims=True)
    unit: Array = np.divide(scaled, length, out=np.zeros_like(scaled), where=length > 0)
    return unit
