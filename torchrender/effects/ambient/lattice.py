"""One point for every few pixels of a picture, and what these know for all pixels between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import GBuffer
from torchrender.kernels.ambient.spread import Few, Many, spread_points


class Lattice(NamedTuple):
    """Points of one camera's picture, one for every ``step`` pixels and side, in the camera's frame."""

    rows: Tensor  # (h,) int64
    columns: Tensor  # (w,) int64
    ray: Tensor  # (h,w,3) to what is seen, of depth one
    position: Tensor  # (h,w,3); 0 where nothing is seen
    normal: Tensor  # (h,w,3)
    seen: Tensor  # (h,w) bool
    lens: Tensor  # (4,) fx, fy, cx, cy
    turn: Tensor  # (3,3) float32 camera from world
    step: int


def lattice_of(gbuffer: GBuffer, k: int, step: int) -> Lattice:
    """The points of camera ``k``, which is no orthographic one."""
    depth, cameras = gbuffer.depth[k], gbuffer.cameras
    rows, columns = (torch.arange(min(step // 2, n - 1), n, step) for n in depth.shape)
    matrix, turn = cameras.intrinsics[k], cameras.rotation[k].float()
    lens = torch.stack([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]])
    fx, fy, cx, cy = lens.tolist()
    depth = depth[rows][:, columns]
    x, y = (columns + 0.5 - cx) / fx, (rows + 0.5 - cy) / fy
    ray = torch.stack([x.expand(len(rows), -1), y[:, None].expand(-1, len(columns)), torch.ones_like(depth)], dim=-1)
    seen = torch.isfinite(depth)
    position = ray * torch.where(seen, depth, 0.0)[..., None]
    normal = gbuffer.normal[k][rows][:, columns] @ turn.T
    return Lattice(rows, columns, ray, position, normal, seen, lens, turn, step)


def spread(gbuffer: GBuffer, k: int, points: Lattice, values: Tensor, out: Tensor) -> None:
    """Fill the covered pixels of ``out`` (H,W,C) by means of ``values`` (h,w,C) of the points on their surface."""
    normal = points.normal * points.seen[..., None]
    position, facing, known = (view(v, np.float32) for v in (points.position, normal, values))
    few = Few(position, facing, known, points.step)
    many = Many(*(view(v, np.float32) for v in (gbuffer.depth[k], gbuffer.normal[k], points.turn, points.lens)))
    spread_points(few, many, out.numpy())
