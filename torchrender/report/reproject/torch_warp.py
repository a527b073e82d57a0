"""What a user of plain torch would write: the grid of an image warped and drawn by scatter, as a yardstick."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.scene.camera import Cameras

EMPTY = (1 << 63) - 1
GAP = 0.05  # relative depth difference at which a block is cut
SIZES = ((1, 1), (2, 2), (3, 4), (5, 8), (9, 16), (17, 64))


def torch_grid_warp(images: DepthImages, camera: Cameras) -> tuple[Tensor, Tensor]:
    """Colour (H,W,3) and depth (H,W) in one camera from B depth images: two triangles per 2 x 2 pixels.

    Triangles wider than 64 target pixels are left out.
    """
    buffer = torch.full((camera.height * camera.width + 1,), EMPTY, dtype=torch.int64)
    step = images.depth[0].numel()
    for k in range(len(images)):
        _draw(images, k, camera, k * step, buffer)
    buffer = buffer[:-1]
    hit = buffer != EMPTY
    color = images.color.reshape(-1, 3).index_select(0, torch.where(hit, buffer & 0xFFFFFFFF, 0)) * hit[:, None]
    depth = torch.where(hit, (buffer >> 32).to(torch.int32).view(torch.float32), torch.inf)
    return color.reshape(camera.height, camera.width, 3), depth.reshape(camera.height, camera.width)


def _draw(images: DepthImages, k: int, camera: Cameras, first: int, buffer: Tensor) -> None:
    x, y, inverse, source = _triangles(images, k, camera)
    source = source + first
    columns = (torch.floor(x.amax(1) - 0.5) - torch.ceil(x.amin(1) - 0.5) + 1).clamp(min=0)
    rows = (torch.floor(y.amax(1) - 0.5) - torch.ceil(y.amin(1) - 0.5) + 1).clamp(min=0)
    extent = torch.maximum(columns, rows) * ((columns > 0) & (rows > 0))
    for low, high in SIZES:
        chosen = ((extent >= low) & (extent <= high)).nonzero()[:, 0]
        if not chosen.numel():
            continue
        part = (x[chosen], y[chosen], inverse[chosen], source[chosen])
        for dy in range(high):
            for dx in range(high):
                pixel, key = _fragments(*part, float(dx), float(dy), camera)
                buffer.scatter_reduce_(0, pixel, key, "amin")


def _triangles(images: DepthImages, k: int, camera: Cameras) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    own, z = images.cameras[k], images.depth[k]
    matrix = camera.camera_from_world[0] @ own.world_from_camera[0]
    turn = (camera.intrinsics[0] @ matrix[:3, :3] @ torch.linalg.inv(own.intrinsics[0])).float()
    shift = (camera.intrinsics[0] @ matrix[:3, 3]).float()
    v, u = torch.meshgrid(*(torch.arange(n, dtype=torch.float32) + 0.5 for n in z.shape), indexing="ij")
    filled = torch.where(torch.isfinite(z), z, -1.0)
    x, y, w = (filled * (turn[a, 0] * u + turn[a, 1] * v + turn[a, 2]) + shift[a] for a in range(3))
    inverse = 1.0 / w
    x, y = x * inverse, y * inverse
    upper, lower, left, right = slice(None, -1), slice(1, None), slice(None, -1), slice(1, None)
    corner = {"a": (upper, left), "b": (upper, right), "c": (lower, left), "d": (lower, right)}
    number = torch.arange(z.numel()).reshape(z.shape)
    found = []
    for names in ("acb", "bcd"):
        depths, xs, ys, qs = (
            torch.stack([image[corner[n]] for n in names], -1).reshape(-1, 3) for image in (filled, x, y, inverse)
        )
        low = depths.amin(1)
        near = 1.0 / float(camera.near[0])
        keep = (low > 0) & (depths.amax(1) - low < GAP * low) & (qs.amin(1) > 0) & (qs.amax(1) < near)
        found.append((xs[keep], ys[keep], qs[keep], number[corner[names[0]]].reshape(-1)[keep]))
    first, second = found
    return (
        torch.cat([first[0], second[0]]),
        torch.cat([first[1], second[1]]),
        torch.cat([first[2], second[2]]),
        torch.cat([first[3], second[3]]),
    )


def _fragments(
    x: Tensor, y: Tensor, inverse: Tensor, source: Tensor, dx: float, dy: float, camera: Cameras
) -> tuple[Tensor, Tensor]:
    """Target pixel and 64-bit depth key of each triangle's pixel at (dx, dy) in its bounding box."""
    px, py = torch.ceil(x.amin(1) - 0.5) + dx, torch.ceil(y.amin(1) - 0.5) + dy
    cx, cy = px + 0.5, py + 0.5
    x0, x1, x2 = x.unbind(1)
    y0, y1, y2 = y.unbind(1)
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    w0 = (x1 - cx) * (y2 - cy) - (x2 - cx) * (y1 - cy)
    w1 = (x2 - cx) * (y0 - cy) - (x0 - cx) * (y2 - cy)
    w2 = area - w0 - w1
    inside = (area < 0) & (w0 <= 0) & (w1 <= 0) & (w2 <= 0)
    inside &= (px >= 0) & (px < camera.width) & (py >= 0) & (py < camera.height)
    depth = area / (w0 * inverse[:, 0] + w1 * inverse[:, 1] + w2 * inverse[:, 2])
    key = (depth.view(torch.int32).to(torch.int64) << 32) + source
    outside = camera.height * camera.width
    return torch.where(inside, (py * camera.width + px).to(torch.int64), outside), key
