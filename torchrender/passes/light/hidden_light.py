"""How much light from everywhere nearby surfaces hide, told from the depth of a few pixels.

Where a picture leaves ambient visibility out, the error of that follows this: a picture that traced rays would tell it
better, but none has.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.ambient.horizon import FACES, cube_cameras
from torchrender.passes.senses import few
from torchrender.raster import rasterize_visibility
from torchrender.scene.model import Scene

SIDE = 32
"""Pixels along each side, at most."""

DISTANCES = (1, 2, 4, 8, 16)
"""In these pixels, at which surfaces are looked for in each of eight directions."""


TEXELS = 12
"""Along the sides of the six depth images around the eye."""

FIRST_MS, TRIANGLE_MS = 2.0, 2e-5
"""About what they take, at most: to begin with, and for each triangle of the scene."""

MOST_EYES = 4
"""Cameras of a batch that look around."""


def _steps() -> Tensor:
    """(8,S,2) rows and columns."""
    ways = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1)]
    return torch.tensor([[(row * far, column * far) for far in DISTANCES] for row, column in ways])


def depth_visibility(gbuffer: GBuffer, reach: float = math.inf) -> Tensor:
    """Cosine-weighted share (B,h,w) of the hemisphere that no surface in the picture hides, of a few of its pixels.

    Args:
        reach: scene units within which something hides.
    """
    place, normal, covered = (few(image, SIDE) for image in (gbuffer.position, gbuffer.normal, gbuffer.covered))
    place = place.float()
    height, width = covered.shape[1:]
    steps = _steps()
    rows = torch.arange(height)[:, None] + steps[..., 0, None, None]
    columns = torch.arange(width) + steps[..., 1, None, None]
    inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
    rows, columns = rows.clamp(0, height - 1), columns.clamp(0, width - 1)
    way = place[:, rows, columns] - place[:, None, None]  # (B,8,S,h,w,3)
    length = way.norm(dim=-1)
    sine = (way * normal[:, None, None]).sum(dim=-1) / length.clamp_min(1e-30)
    hides = inside & covered[:, rows, columns] & (length <= reach)
    highest = torch.where(hides, sine, 0.0).clamp(0.0, 1.0).amax(dim=2)
    return torch.where(covered, 1.0 - highest.square().mean(dim=1), 1.0)


def eye_visibility(
    scene: Scene, gbuffer: GBuffer, spare_ms: float, reaches: Sequence[float] = (math.inf,)
) -> list[Tensor] | None:
    """Cosine-weighted shares (B,h,w) of the hemisphere over a few pixels that nothing hides from the eye, either.

    What stands around the eye stands around what it sees: a closed room has no sky, whatever part of it is in the
    picture. What is nearer to the eye than half of a pixel's distance hides as much less of it as it looks smaller
    from there. None: parallel views, which have no eye, several cameras, or not time enough.

    Args:
        reaches: scene units from a pixel within which something hides; a share for each.
    """
    cameras = gbuffer.cameras
    dear = FIRST_MS + TRIANGLE_MS * scene.geometry.triangle_count > spare_ms
    if cameras.orthographic or dear or not 0 < len(cameras) <= MOST_EYES:
        return None
    found = [_around_eye(scene, gbuffer, k, reaches) for k in range(len(cameras))]
    return [torch.stack(shares) for shares in zip(*found, strict=True)]


def _around_eye(scene: Scene, gbuffer: GBuffer, k: int, reaches: Sequence[float]) -> list[Tensor]:
    camera = gbuffer.cameras[k]
    place, normal, covered = (few(i[k : k + 1], SIDE)[0] for i in (gbuffer.position, gbuffer.normal, gbuffer.covered))
    depth = rasterize_visibility(scene.geometry, cube_cameras(camera, TEXELS)).depth.reshape(-1)
    way, solid = _texels()
    world = way @ camera.rotation[0].float()
    far = depth * way.abs().amax(dim=-1).reciprocal()  # along unit directions
    seen = (place - camera.eye[0]).float().reshape(-1, 3)
    distance = seen.norm(dim=-1, keepdim=True)
    facing = (normal.reshape(-1, 3) @ world.T).clamp_min(0.0) * solid
    smaller = (2.0 * far / distance.clamp_min(1e-30)).clamp_max(1.0).square()
    whole = facing.sum(dim=-1).clamp_min(1e-6)
    shares = []
    for reach in reaches:
        hides = torch.isfinite(far)
        if math.isfinite(reach):
            hides = hides & (torch.cdist(seen, torch.where(hides, far, 0.0)[:, None] * world) <= reach)
        share = (facing * torch.where(hides, smaller, 0.0)).sum(dim=-1) / whole
        shares.append(torch.where(covered, 1.0 - share.reshape(covered.shape), 1.0))
    return shares


def _texels() -> tuple[Tensor, Tensor]:
    """Unit directions (N,3) of texels in the camera's frame, and the solid angles (N,) they take."""
    across = (torch.arange(TEXELS) + 0.5) * (2.0 / TEXELS) - 1.0
    rows, columns = torch.meshgrid(across, across, indexing="ij")
    way = torch.zeros(6, TEXELS, TEXELS, 3)
    for face, (right, down) in enumerate(FACES):
        way[face, ..., right], way[face, ..., down] = columns, rows
        way[face, ..., face // 2] = 1.0 - 2.0 * (face % 2)
    way = way.reshape(-1, 3)
    length = way.norm(dim=-1)
    return way / length[:, None], length**-3
