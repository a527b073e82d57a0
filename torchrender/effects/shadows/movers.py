"""Shadow maps of what stands still, with what moves drawn into a copy where a light can see it.

The nearest depth of two sets of triangles is the lesser of both, so nothing is lost by drawing them apart.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import ShadowMap
from torchrender.raster import rasterize_depth
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

Window = tuple[int, int, int, int]


def with_movers(still: ShadowMap, movers: Geometry, cull: str = "none") -> ShadowMap:
    """The map with further triangles drawn into it; the same object where no view sees any."""
    windows = windows_of(still.cameras, movers)
    if not windows:
        return still
    depth = torch.from_numpy(np.empty(tuple(still.depth.shape), np.float32)).copy_(still.depth)
    for number, (left, top, right, bottom) in windows.items():
        camera = still.cameras[number].sub_camera(left, top, right - left, bottom - top)
        part = depth[number, top:bottom, left:right]
        torch.minimum(part, rasterize_depth(movers, camera, cull=cull)[0], out=part)
    return replace(still, depth=depth)


def windows_of(cameras: Cameras, movers: Geometry) -> dict[int, Window]:
    """Left, top, right and bottom of the texels that triangles may cover, by number of the view that sees them."""
    if not movers.triangle_count or not len(cameras):
        return {}
    corners = torch.stack([movers.bounds[list(which), range(3)] for which in itertools.product((0, 1), repeat=3)])
    uv, depth = cameras.project(corners)
    found = {number: _window(uv[number], depth[number], cameras, number) for number in range(len(cameras))}
    return {number: window for number, window in found.items() if window is not None}


def covers(kept: Cameras, wanted: Cameras) -> bool:
    """The kept views show what the wanted ones do, texel by texel, and at least as deep."""
    if len(kept) != len(wanted) or kept.orthographic != wanted.orthographic:
        return False
    if (kept.width, kept.height) != (wanted.width, wanted.height):
        return False
    equal = all(torch.equal(getattr(kept, n), getattr(wanted, n)) for n in ("camera_from_world", "intrinsics"))
    return equal and bool((kept.near <= wanted.near).all()) and bool((kept.far >= wanted.far).all())


def deeper(cameras: Cameras) -> Cameras:
    """Views that still :func:`covers` what is wanted when something comes nearer to the light or leaves it."""
    if cameras.orthographic:
        return cameras
    return replace(cameras, near=cameras.near / 8, far=cameras.far * 2)


def _window(uv: Tensor, depth: Tensor, cameras: Cameras, number: int) -> Window | None:
    width, height = cameras.width, cameras.height
    if float(depth.max()) < float(cameras.near[number]) or float(depth.min()) > float(cameras.far[number]):
        return None
    if not cameras.orthographic and float(depth.min()) <= 1e-6 * float(depth.max()):
        return 0, 0, width, height  # a corner beside or behind the light has no image
    low, high = uv.amin(0).tolist(), uv.amax(0).tolist()
    left, top = (max(0, math.floor(min(max(v, 0.0), size)) - 1) for v, size in zip(low, (width, height), strict=True))
    right, bottom = (
        min(size, math.ceil(min(max(v, 0.0), size)) + 1) for v, size in zip(high, (width, height), strict=True)
    )
    inside = low[0] < width and low[1] < height and high[0] > 0 and high[1] > 0
    return (left, top, right, bottom) if inside and left < right and top < bottom else None
