"""What the rays of one cluster meet: its depth image is drawn, asked, and let go.

Planar clusters: the picture of the mirrored eye, pixel for pixel, of what lies behind the mirror's plane as that eye
sees it; nothing has to be marched. Curved ones: specification 03, section 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import RayHits, VisibilityBuffer
from torchrender.effects.reflections.clusters.bundle import ClusterCameras
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.kernels.rays.depth_march import CLEAR, HIT
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

PIXELS_PER_CELL = 4.0
LEAST_FACING = 0.02
CLOSE, ROUNDING = 2.0**-8, 1e-6
"""Distance from a planar mirror from which on it shows things, in widths of a pixel, and of the way from the eye at
least: rays of curved ones start farther off, but a mirrored eye sees the plane where the eye does."""


@dataclass(frozen=True, eq=False)
class ClusterAnswer:
    """What N rays of a cluster met. A clear ray met nothing for sure; an unknown one left the image or went behind."""

    state: Tensor  # (N,) uint8 CLEAR, HIT or UNKNOWN
    hits: RayHits
    steps: int  # texels visited


def mirror_camera(cameras: Cameras, index: int, centre: Tensor, normal: Tensor) -> Cameras:
    """Camera ``index`` mirrored at a plane. Its image is that camera's, left and right exchanged."""
    mirror = torch.eye(4, dtype=torch.float64)
    mirror[:3, :3] -= 2.0 * torch.outer(normal, normal)
    mirror[:3, 3] = 2.0 * (normal @ centre) * normal
    flip = torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0], dtype=torch.float64))
    k = cameras.intrinsics[index].clone()
    k[0, 1], k[0, 2] = -k[0, 1], cameras.width - k[0, 2]
    return Cameras(
        (flip @ cameras.camera_from_world[index] @ mirror)[None],
        k[None],
        cameras.width,
        cameras.height,
        cameras.near[index : index + 1],
        torch.tensor([torch.inf]) if not cameras.orthographic else cameras.far[index : index + 1],
        cameras.orthographic,
    )


def mirror_view(geometry: Geometry, pixels: ReflectivePixels, made: ClusterCameras, number: int) -> ClusterAnswer:
    """The first hits of a planar cluster's mirrored rays, one per pixel in the order of its members."""
    rows = made.clusters.members(number)
    width, height = pixels.shape[2], pixels.shape[1]
    part = pixels.pixel[rows]
    camera = int(part[0]) // (width * height)
    x0, y0, x1, y1 = made.pixel_box[number].tolist()
    whole = mirror_camera(pixels.cameras, camera, made.frame[number, 0], made.frame[number, 3])
    seen_from = whole.sub_camera(width - 1 - x1, y0, x1 - x0 + 1, y1 - y0 + 1)
    column, row = x1 - part % width, part // width % height - y0
    depth = pixels.depth[rows]
    cosine = (pixels.view[rows] * pixels.cameras.forward[camera]).sum(-1)
    beyond = torch.full((1, seen_from.height, seen_from.width), torch.inf, dtype=torch.float64)
    # A tile a little above the common plane would see itself: it is seen where the mirrored tile is, below.
    facing = (pixels.view[rows] * made.frame[number, 3]).sum(-1).abs().clamp_min(LEAST_FACING)
    off = (CLOSE * pixels.pixel_angle[rows]).clamp_min(ROUNDING) * pixels.length[rows]
    beyond[0, row, column] = depth + (off + 2.0 * made.relief[number] / facing) * cosine
    seen = rasterize_visibility(geometry, seen_from, tests=FragmentTests(beyond=beyond))
    triangle = seen.triangle[0, row, column]
    t = torch.where(triangle >= 0, (seen.depth[0, row, column].double() - depth) / cosine, torch.inf)
    hits = RayHits(t, triangle, seen.barycentric[0, row, column])
    return ClusterAnswer(torch.where(triangle >= 0, HIT, CLEAR).to(torch.uint8), hits, len(rows))


def cluster_camera(made: ClusterCameras, number: int) -> Cameras:
    """The camera of a curved cluster."""
    low, high = made.box[number, :2], made.box[number, 2:]
    width, height = (int(n) for n in made.size[number])
    focal = made.size[number] / (high - low)
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = made.look[number]
    matrix[:3, 3] = -(made.look[number] @ made.eye[number])
    k = torch.diag(torch.cat([focal, torch.ones(1, dtype=torch.float64)]))
    k[:2, 2] = -low * focal
    return Cameras(matrix[None], k[None], width, height, made.near[number], torch.tensor(torch.inf))


def reflector_depth(camera: Cameras, position: Tensor) -> Tensor:
    """(1,H,W) depth below which nothing can be reflected: what lies between the camera and the reflector itself.

    Beyond the thesis, whose single near plane lies at the deepest point of a curved reflector and lets the reflector's
    own inside cover what its rim reflects. Cells of texels take the smallest depth of the pixels (N,3) that fall into
    them.
    """
    texels = camera.width * camera.height
    cell = max(1, math.ceil(math.sqrt(PIXELS_PER_CELL * texels / len(position))))
    columns, rows = -(-camera.width // cell), -(-camera.height // cell)
    uv, z = camera.project(position[None])
    inside = (z[0] > 0) & (uv[0, :, 0] >= 0) & (uv[0, :, 1] >= 0)
    inside &= (uv[0, :, 0] < camera.width) & (uv[0, :, 1] < camera.height)
    at = (uv[0][inside] / cell).long()
    least = torch.full((columns * rows,), torch.inf, dtype=torch.float64)
    least = least.scatter_reduce(0, at[:, 1] * columns + at[:, 0], z[0][inside], "amin")
    least = least.reshape(1, 1, rows, columns)
    around = -torch.nn.functional.max_pool2d(-least, 3, stride=1, padding=1)  # the rim lies between cells
    least = torch.where(torch.isinf(least), around, least)[0, 0]
    least = torch.where(torch.isinf(least), 0.0, least)
    fine = least.repeat_interleave(cell, 0).repeat_interleave(cell, 1)
    return fine[None, : camera.height, : camera.width]


def cluster_image(geometry: Geometry, camera: Cameras, position: Tensor, cull: str) -> VisibilityBuffer:
    """The depth image of a curved cluster: what ``camera`` sees behind the reflector's pixels at (N,3) ``position``."""
    beyond = reflector_depth(camera, position)
    return rasterize_visibility(geometry, camera, cull=cull, tests=FragmentTests(beyond=beyond))
