"""Splat reconstruction: one disc in the tangent plane for each sample. Source: specification 02, section 3.5."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.checks import check_range
from torchrender.reconstruct.hybrid import Reconstruction

SEGMENTS = 8
EDGE_ON = 0.1  # cosine below which a disc no longer grows


def reconstruct_discs(images: DepthImages, *, scale: float = 1.0, colors: bool = True) -> Reconstruction:
    """Octagons of a disc's area, radius 0.5 sqrt(2) g(z) scale / max(|n.d|, 0.1); no vertices are shared.

    Args:
        images: B perspective depth images (B,H,W) with unit normals.
        scale: 0.7 to 2; small discs leave holes, large ones overdraw.

    Raises:
        OptionError: ``scale`` outside its range.
    """
    check_range("scale", scale, 0.7, 2.0)
    count = len(images)
    pixels = images.covered.reshape(-1).nonzero().reshape(-1)
    normal = facing_normals(images).reshape(-1, 3)[pixels].double()
    centre = images.position.reshape(-1, 3)[pixels].double()
    size = images.cameras.footprint(images.depth.double()).reshape(-1)[pixels]
    per_image = images.depth.shape[1] * images.depth.shape[2]
    eye = images.cameras.eye[pixels // max(per_image, 1)]
    ray = torch.nn.functional.normalize(centre - eye, dim=1)
    radius = math.sqrt(0.5) * scale * size / (normal * ray).sum(1).abs().clamp_min(EDGE_ON)
    # A regular octagon whose area is that of the disc.
    radius = radius * math.sqrt(2 * math.pi / (SEGMENTS * math.sin(2 * math.pi / SEGMENTS)))
    right, up = _frame(normal)
    turn = torch.arange(SEGMENTS, dtype=torch.float64) * (2 * math.pi / SEGMENTS)
    rim = turn.cos()[None, :, None] * right[:, None] + turn.sin()[None, :, None] * up[:, None]
    vertices = (centre[:, None] + radius[:, None, None] * rim).reshape(-1, 3)
    step = torch.arange(1, SEGMENTS - 1)
    fan = torch.stack([torch.zeros_like(step), step, step + 1], dim=1)
    faces = (torch.arange(len(pixels))[:, None, None] * SEGMENTS + fan).reshape(-1, 3).int()
    per = torch.bincount(pixels // max(per_image, 1), minlength=count).cumsum(0)
    starts = torch.cat([torch.zeros(1, dtype=torch.int64), per])
    tint = images.color.reshape(-1, 3)[pixels].repeat_interleave(SEGMENTS, 0).contiguous() if colors else None
    return Reconstruction(
        images=images,
        vertices=vertices,
        faces=faces,
        colors=tint,
        approx=torch.ones(len(vertices), dtype=torch.bool),
        corner=(pixels % max(per_image, 1)).repeat_interleave(SEGMENTS),
        face_pixel=pixels.repeat_interleave(SEGMENTS - 2),
        vertex_start=starts * SEGMENTS,
        face_start=starts * (SEGMENTS - 2),
        true_corners=torch.zeros(5, dtype=torch.int64),
    )


def facing_normals(images: DepthImages) -> Tensor:
    """(B,H,W,3) the normals; where a filled pixel has none, the direction back to the camera."""
    missing = images.covered & (images.normal == 0).all(-1)
    if not bool(missing.any()):
        return images.normal
    toward = torch.nn.functional.normalize(images.cameras.eye[:, None, None] - images.position, dim=-1)
    return torch.where(missing[..., None], toward.float(), images.normal)


def _frame(normal: Tensor) -> tuple[Tensor, Tensor]:
    """Two unit vectors (N,3) that make a right-handed frame with unit normals (N,3).

    Duff and others, Building an orthonormal basis, revisited, JCGT 2017.
    """
    x, y, z = normal.unbind(1)
    sign = torch.copysign(torch.ones_like(z), z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return torch.stack([1 + sign * x * x * a, sign * b, -sign * x], 1), torch.stack([b, sign + y * y * a, -y], 1)
