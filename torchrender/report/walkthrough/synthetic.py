"""The synthetic capture of specification 13: 88 views of our own living room with exact depth, and 20 held out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from torch import Tensor

from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import built_in_path, walks_of
from torchrender.scene.model import Scene
from torchrender.scene.smooth import weld
from torchrender.walkthrough.frames.record import Array, RgbdSequence

FOV_DEG = 75.0
FLAT_DEG = 0.3
"""Greatest turn of a facet's normal within a flat piece."""


@dataclass(frozen=True, eq=False)
class SyntheticCapture:
    """Views with truth."""

    scene: Scene
    sequence: RgbdSequence  # to build from
    held: RgbdSequence
    cameras: Cameras  # of the sequence
    held_cameras: Cameras
    truth: Tensor  # (N,H,W) bool: pixels of flat pieces of at least n_min pixels
    near_flat: Tensor  # (N,H,W) bool: pixels of flat pieces of any size


def capture_cameras(scene: Scene, count: int, size: int, seed: int) -> Cameras:
    """Cameras along the walks through the room, turned in all directions."""
    rng = np.random.default_rng(seed)
    walks = walks_of(scene)
    made = []
    for n in range(count):
        walk = built_in_path(scene, walks[n % len(walks)]) if walks else built_in_path(scene, "orbit")
        path = walk.cameras(4 * count, width=size, height=size, near=1e-3 * scene.diagonal)
        eye = path.eye[(4 * n + int(rng.integers(4))) % len(path)].numpy() + rng.normal(size=3) * [0.1, 0.05, 0.1]
        yaw = 2 * np.pi * n * 0.381966 + rng.normal() * 0.1
        pitch = float(np.clip(-0.15 + 0.35 * rng.normal(), -0.9, 0.6))
        forward = np.array([np.sin(yaw) * np.cos(pitch), np.sin(pitch), np.cos(yaw) * np.cos(pitch)])
        near = 1e-3 * scene.diagonal
        made.append(
            Cameras.look_at(eye.tolist(), (eye + forward).tolist(), width=size, height=size, fov_deg=FOV_DEG, near=near)
        )
    return Cameras.cat(made)


def synthetic_capture(
    scene: Scene, *, views: int = 88, held: int = 20, size: int = 400, mirrors: bool = False, n_min: int = 400
) -> SyntheticCapture:
    """Photos of a scene with its depth.

    Args:
        mirrors: with reflections, which look different from everywhere; a walkthrough has one colour for each place.
    """
    groups = flat_pieces(scene)
    cameras, others = capture_cameras(scene, views, size, 1), capture_cameras(scene, held, size, 77)
    options = RenderOptions(reflections="clustered" if mirrors else "off")
    plain = scene if mirrors else without_highlights(scene)
    sequence, truth, flat = photos_of(plain, cameras, options, groups, n_min)
    held_sequence, _, _ = photos_of(plain, others, options, groups, n_min)
    return SyntheticCapture(plain, sequence, held_sequence, cameras, others, truth, flat)


def without_highlights(scene: Scene) -> Scene:
    """The same scene with diffuse materials: what one colour for each place can show."""
    return replace(scene, materials=tuple(replace(m, specular=0.0) for m in scene.materials))


def photos_of(
    scene: Scene, cameras: Cameras, options: RenderOptions | None, groups: Array | None = None, n_min: int = 400
) -> tuple[RgbdSequence, Tensor, Tensor]:
    """Photos with exact depth from each camera, and which of their pixels are flat."""
    options = options or RenderOptions(reflections="off")
    groups = np.full(scene.geometry.triangle_count, -1) if groups is None else groups
    images, depths, truth, flat = [], [], [], []
    history: RenderHistory | None = RenderHistory()
    for n in range(len(cameras)):
        # Shadow maps are made once.
        image = render(scene, cameras[n], options=options, history=history)
        history = image.history
        images.append(image.displayed()[0].clamp(0, 1))
        seen = rasterize_visibility(scene.geometry, cameras[n])
        depths.append(seen.depth[0])
        triangle = seen.triangle[0].numpy()
        group = np.where(triangle >= 0, groups[np.maximum(triangle, 0)], -1)
        sizes = np.bincount(group[group >= 0], minlength=max(int(groups.max()) + 1, 1))
        truth.append(torch.from_numpy((group >= 0) & (sizes[np.maximum(group, 0)] >= n_min)))
        flat.append(torch.from_numpy(group >= 0))
    sequence = RgbdSequence.from_tensors(
        torch.stack(images).permute(0, 3, 1, 2),
        torch.stack(depths)[:, None],
        cameras.intrinsics,
        cameras.rotation,
        cameras.camera_from_world[:, :3, 3],
    )
    return sequence, torch.stack(truth), torch.stack(flat)


def flat_pieces(scene: Scene) -> Array:
    """(F,) number of the flat piece of each triangle, -1 for curved ones: connected triangles of one object whose
    normals
    all lie within a third of a degree of their mean."""
    geometry = scene.geometry
    faces = weld(geometry.vertices.numpy())[1][geometry.faces.numpy()]
    normal = geometry.face_normals.double().numpy()
    count = len(faces)
    ends = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(count), 3)
    key = ends[:, 0].astype(np.int64) * (int(faces.max()) + 1) + ends[:, 1]
    order = np.argsort(key, kind="stable")
    same = key[order][1:] == key[order][:-1]
    a, b = owner[order][:-1][same], owner[order][1:][same]
    objects = geometry.object_id.numpy()
    joined = ((normal[a] * normal[b]).sum(1) > np.cos(np.radians(FLAT_DEG))) & (objects[a] == objects[b])
    graph = coo_matrix((np.ones(joined.sum()), (a[joined], b[joined])), shape=(count, count))
    pieces, label = connected_components(graph, directed=False)
    corners = geometry.vertices.numpy()[geometry.faces.numpy()]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    mean = np.stack([np.bincount(label, weights=area * normal[:, k], minlength=pieces) for k in range(3)], axis=1)
    mean = mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-30)
    off = (normal * mean[label]).sum(1) < np.cos(np.radians(FLAT_DEG))
    curved = np.bincount(label, weights=off & (area > 0), minlength=pieces) > 0
    return np.where(curved[label], -1, label)
