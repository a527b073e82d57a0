"""What others would do with the same photos: Open3D's TSDF volume, warps of the nearest photos, the source's
baselines."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.numerics.color import srgb_table
from torchrender.reconstruct.reproject import reproject
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.build import cameras_of
from torchrender.walkthrough.density import sample_density
from torchrender.walkthrough.frames.prepare import Capture
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import PointModel, Walkthrough

Draw = Callable[[Cameras], tuple[Tensor, Tensor]]
"""From a camera to a linear picture (H,W,3) and a mask (H,W) of pixels that it has an answer for."""


def open3d_tsdf(capture: Capture, poses: Array, voxel: float, depth_max: float) -> tuple[Draw, float] | str:
    """A volume fused from the photos, drawn by its own ray cast, and the seconds of fusing; or why it cannot be
    made."""
    try:
        import open3d
        import open3d.core as o3c
    except (ImportError, OSError) as error:
        return f"open3d is not usable here: {error}"
    grid = open3d.t.geometry.VoxelBlockGrid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(o3c.float32, o3c.float32, o3c.float32),
        attr_channels=((1), (1), (3)),
        voxel_size=voxel,
        block_resolution=16,
        block_count=20000,
        device=o3c.Device("CPU:0"),
    )
    begin = time.perf_counter()
    for i in range(len(capture)):
        depth = np.where(np.isfinite(capture.depth[i]), capture.depth[i], 0).astype(np.float32)
        picture = open3d.t.geometry.Image(o3c.Tensor(np.ascontiguousarray(depth[..., None])))
        color = open3d.t.geometry.Image(o3c.Tensor(np.ascontiguousarray(capture.color[i].astype(np.float32))))
        k, pose = _matrix(capture.lens[i]), o3c.Tensor(np.linalg.inv(poses[i]))
        blocks = grid.compute_unique_block_coordinates(picture, k, pose, 1.0, depth_max)
        grid.integrate(blocks, picture, color, k, k, pose, 1.0, depth_max)
    seconds = time.perf_counter() - begin
    hashmap = grid.hashmap()
    keys = hashmap.key_tensor()[hashmap.active_buf_indices().to(o3c.int64)]
    table = torch.from_numpy(srgb_table(8).numpy())

    def draw(camera: Cameras) -> tuple[Tensor, Tensor]:
        k = camera.intrinsics[0].numpy()
        lens = _matrix(np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]]))
        pose = o3c.Tensor(camera.camera_from_world[0].numpy())
        found = grid.ray_cast(
            keys, lens, pose, camera.width, camera.height, ["depth", "color"], 1.0, 0.05, depth_max, 1.0
        )
        mask = torch.from_numpy(found["depth"].numpy()[..., 0] > 0)
        codes = torch.from_numpy(np.clip(np.rint(found["color"].numpy() * _scale(found)), 0, 255).astype(np.int64))
        return table[codes], mask

    return draw, seconds


def _scale(found: Any) -> float:
    return 255.0 if float(found["color"].max().item()) <= 1.5 else 1.0


def _matrix(lens: Array) -> Any:
    import open3d.core as o3c

    # Open3D puts pixel centres at whole numbers.
    return o3c.Tensor(np.array([[lens[0], 0, lens[2] - 0.5], [0, lens[1], lens[3] - 0.5], [0, 0, 1.0]]))


def warp_nearest(capture: Capture, count: int) -> Draw:
    """The ``count`` photos nearest to each camera, by place and direction, warped as meshes by :func:`reproject`."""
    cameras = cameras_of(capture)
    diagonal = capture.diagonal()
    table = torch.from_numpy(srgb_table(8).numpy())

    def draw(camera: Cameras) -> tuple[Tensor, Tensor]:
        gap = (cameras.eye - camera.eye).norm(dim=1) / diagonal + 1 - (cameras.forward * camera.forward).sum(1)
        rows = torch.argsort(gap)[:count].sort().values
        images = _depth_images(capture, cameras[rows], rows.numpy(), table)
        found = reproject(images, camera)
        return found.color[0], found.valid[0]

    return draw


def _depth_images(capture: Capture, cameras: Cameras, rows: Array, table: Tensor) -> DepthImages:
    depth = torch.from_numpy(np.stack([capture.depth[r] for r in rows]))
    depth = torch.where(depth > 0, depth, torch.inf)
    known = torch.isfinite(depth)
    shape = tuple(depth.shape)
    normal = np.stack([capture.normal[r] / 32767.0 @ capture.pose[r, :3, :3].T for r in rows])
    position = cameras.unproject(cameras.pixel_centres(), torch.where(known, depth, 1.0))
    return DepthImages(
        cameras=cameras,
        depth=depth,
        triangle=torch.where(known, 0, -1),
        object_id=torch.where(known, 0, -1),
        barycentric=torch.zeros(*shape, 2),
        position=position,
        normal=torch.from_numpy(normal.astype(np.float32)),
        color=table[torch.from_numpy(np.stack([capture.color[r] for r in rows]).astype(np.int64))],
        layer=torch.zeros(shape, dtype=torch.int32),
        truncated=torch.zeros(shape, dtype=torch.bool),
        parameters={},
    )


def all_points(capture: Capture, walkthrough: Walkthrough, most: int) -> Walkthrough:
    """Every pixel of every photo as a point, at most ``most`` of them evenly thinned, without comparison and planes."""
    parts: list[list[Array]] = []
    known = [(capture.depth[i] > 0) & np.isfinite(capture.depth[i]) for i in range(len(capture))]
    share = min(1.0, most / max(sum(int(k.sum()) for k in known), 1))
    rng = np.random.default_rng(0)
    for i, mask in enumerate(known):
        rows, columns = np.nonzero(mask & (rng.random(mask.shape) < share))
        turn, eye = capture.pose[i, :3, :3], capture.pose[i, :3, 3]
        density = np.log(sample_density(capture, i, rows, columns) * share)
        normal = capture.normal[i, rows, columns] / 32767.0 @ turn.T
        parts.append([capture.points(i, rows, columns) @ turn.T + eye, normal.astype(np.float32),
                      capture.color[i, rows, columns], density.astype(np.float32)])  # fmt: skip
    position, normal, color, density = (np.concatenate(p) for p in zip(*parts))
    low, high = position.min(0), position.max(0)
    node = np.concatenate([0.5 * (low + high), np.eye(3).reshape(-1), 0.5 * (high - low)])
    points = PointModel(
        position=position,
        normal=normal,
        color=color,
        log_density=density,
        object_id=np.zeros(len(position), np.int32),
        nodes=node[None],
        links=np.array([[0, len(position), 0, 0]]),
        roots=np.zeros(1, np.int64),
    )
    return replace(walkthrough, planes=(), points=points)
