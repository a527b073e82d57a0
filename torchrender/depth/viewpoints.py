"""Where the cameras of a set of depth images stand."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.checks import check_range
from torchrender.errors import OptionError
from torchrender.raster import rasterize, rasterize_visibility
from torchrender.scene.camera import Cameras, look_at_matrix
from torchrender.scene.model import Scene

DEFAULT_SPREAD = 0.2
MOST_VIEWS = 4096
"""Of one set."""
LITTLE = 0.02
"""Share of what the camera sees below which a viewpoint stands elsewhere: behind a wall, or inside something."""
NEARER = (1.0, 0.5, 0.25, 0.12)
"""Shares of its distance that such a viewpoint is tried at, before it stays at the eye."""
LOOK = 48
"""Pixels of the longer side of the pictures that are compared for it."""
SAME_DEPTH = 0.05


def viewpoints_around(scene: Scene, camera: Cameras, count: int, *, spread: float = DEFAULT_SPREAD) -> Cameras:
    """``count`` cameras like ``camera`` (a batch of one) around its eye, all looking at the scene's centre.

    The eyes are the corners of a regular polygon that faces the centre; ``spread`` is the side of the triangle with
    the same circumscribed circle, in bounding-box diagonals, so that three viewpoints form the equilateral triangle
    of non-redundant sampling with that side. One viewpoint stays at the eye. Where the eye is at the scene's centre
    the view direction is kept instead. A viewpoint from which next to nothing can be seen of what ``camera`` sees, as
    behind the wall of a room, comes so much closer to the eye that it sees more.

    Raises:
        OptionError: ``count`` outside [1, MOST_VIEWS], ``spread`` negative, or ``camera`` not a single camera.
    """
    check_range("count", count, 1, MOST_VIEWS)
    check_range("spread", spread, 0.0)
    if len(camera) != 1:
        raise OptionError(f"camera must be a single camera, got a batch of {len(camera)}")
    eye, diagonal = camera.eye[0], scene.diagonal or 1.0
    target = scene.bounds.mean(dim=0)
    distance = float((target - eye).norm())
    if distance < 1e-3 * diagonal:
        target = eye + camera.forward[0] * diagonal
    centre = look_at_matrix(eye, target, -camera.rotation[0, 1])
    right, down = centre[0, :3], centre[1, :3]
    radius = 0.0 if count == 1 else spread * diagonal / math.sqrt(3.0)
    near, far = (value.expand(count).contiguous() for value in (camera.near, camera.far))
    if not camera.orthographic:
        # The ring may come closer to the scene or reach farther than the camera that it was built from.
        near, far = torch.minimum(near, torch.tensor(1e-3 * diagonal)), torch.full_like(far, math.inf)

    def ring(shares: Tensor) -> Cameras:
        matrices = []
        for number, share in enumerate(shares.tolist()):
            # The first corner is the upper one: image y points down.
            angle = 2.0 * math.pi * number / count - math.pi / 2
            position = eye + share * radius * (math.cos(angle) * right + math.sin(angle) * down)
            matrices.append(look_at_matrix(position, target, -down))
        return replace(
            camera,
            camera_from_world=torch.stack(matrices),
            intrinsics=camera.intrinsics.expand(count, 3, 3).contiguous(),
            near=near,
            far=far,
        )

    whole = torch.ones(count, dtype=torch.float64)
    return ring(whole if radius == 0.0 else _not_elsewhere(scene, camera, ring, whole))


def _not_elsewhere(scene: Scene, camera: Cameras, ring: Callable[[Tensor], Cameras], whole: Tensor) -> Tensor:
    """Shares of their distance (N,) at which the viewpoints of ``ring`` see more than next to nothing of the view."""
    small = min(1.0, LOOK / max(camera.width, camera.height))
    view = rasterize(scene, camera.scaled(small))
    seen = view.covered[0]
    shares, left = torch.zeros_like(whole), torch.ones_like(whole, dtype=torch.bool)
    if not bool(seen.any()):
        return whole
    points, facing = view.position[0][seen], view.geometric_normal[0][seen].double()
    for share in NEARER:
        found = _seen_share(scene, ring(share * whole).scaled(small), points, facing) >= LITTLE
        shares[left & found] = share
        left &= ~found
        if not bool(left.any()):
            break
    return shares


def _seen_share(scene: Scene, cameras: Cameras, points: Tensor, facing: Tensor) -> Tensor:
    """Share of ``points`` (N,3) within each picture that show the side of ``facing``, their normal (B,); 1 for none."""
    depth = rasterize_visibility(scene.geometry, cameras).depth
    pixels, far = cameras.project(points[None].expand(len(cameras), -1, -1))
    x, y = pixels.nan_to_num(-1.0).clamp(-1.0, 2.0**20).floor().long().unbind(-1)
    inside = (far > 0) & (x >= 0) & (x < cameras.width) & (y >= 0) & (y < cameras.height)
    rows = torch.arange(len(cameras))[:, None]
    there = depth[rows, y.clamp(0, cameras.height - 1), x.clamp(0, cameras.width - 1)].double()
    before = ((cameras.eye[:, None] - points) * facing).sum(dim=-1) > 0
    free = inside & before & (far <= there * (1.0 + SAME_DEPTH))
    return torch.where(inside.any(1), free.sum(1) / inside.sum(1).clamp_min(1), 1.0)


def cameras_between(cameras: Cameras, weights: Tensor) -> Cameras:
    """F cameras whose eyes, orientations and intrinsics are weighted means of those of B cameras.

    The mean orientation is the rotation nearest to the mean matrix; where the matrices cancel out, it is that of the
    camera with the greatest weight. For cameras that look at one point from one distance the mean looks there, too.

    Args:
        weights: (F,B), each row sums to one.
    """
    weights = weights.double()
    weights = weights / weights.sum(dim=1, keepdim=True)  # of float32, to one but for rounding
    mean = torch.einsum("fb,bij->fij", weights, cameras.rotation)
    u, sizes, v = torch.linalg.svd(mean)
    flip = torch.ones(len(weights), 3, dtype=torch.float64)
    flip[:, 2] = torch.linalg.det(u @ v).sign()
    rotation = u @ (flip[..., None] * v)
    rotation = torch.where(sizes[:, 1, None, None] > 1e-6, rotation, cameras.rotation[weights.argmax(dim=1)])
    matrix = torch.eye(4, dtype=torch.float64).repeat(len(weights), 1, 1)
    matrix[:, :3, :3] = rotation
    matrix[:, :3, 3] = -(rotation @ (weights @ cameras.eye)[..., None])[..., 0]
    return replace(
        cameras,
        camera_from_world=matrix,
        intrinsics=torch.einsum("fb,bij->fij", weights, cameras.intrinsics),
        near=cameras.near.amin().expand(len(weights)),
        far=cameras.far.amax().expand(len(weights)),
    )


def viewpoints_inside(cameras: Cameras, count: int, *, first: int = 1) -> Cameras:
    """``count`` cameras between those of a set: on the segment of two, in the triangle of three, and for more in the
    triangles that fan out from the first one (a quadrilateral for four corners in turn).

    Low-discrepancy: Halton points (p, q) of bases 2 and 3 from index ``first`` on, folded into the triangle.
    """
    check_range("count", count, 1)
    p, q = halton(count, 2, first), halton(count, 3, first)
    weights = torch.zeros(count, len(cameras), dtype=torch.float64)
    rows = torch.arange(count)
    if len(cameras) < 3:
        weights[:, 0] = 1.0 if len(cameras) == 1 else 1.0 - p
        weights[:, -1] += 0.0 if len(cameras) == 1 else p
        return cameras_between(cameras, weights)
    p = p * (len(cameras) - 2)
    corner = p.floor().long()
    p = p - corner
    p, q = torch.where(p + q > 1.0, 1.0 - p, p), torch.where(p + q > 1.0, 1.0 - q, q)
    weights[:, 0] = 1.0 - p - q
    weights[rows, corner + 1] = p
    weights[rows, corner + 2] = q
    return cameras_between(cameras, weights)


def halton(count: int, base: int, first: int = 1) -> Tensor:
    """(count,) float64 in [0,1): the radical inverse of ``first``, ``first`` + 1, ... in the given base."""
    index = torch.arange(first, first + count)
    value, scale = torch.zeros(count, dtype=torch.float64), 1.0
    while bool((index > 0).any()):
        scale /= base
        value += scale * (index % base)
        index = index // base
    return value
