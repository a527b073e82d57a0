"""What one view shows of another: visibility between views, and how surfaces move from picture to picture."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.buffers import GBuffer, check_fixed_buffers
from torchrender.checks import check_choice, check_class
from torchrender.errors import InputError
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.triangles import Shape, geometry_of
from torchrender.shading.attributes import SeenSurface

METHODS = ("rays", "depth")
NEARER = 1e-6
"""A hit before this share of the way hides what lies at its end."""
SLACK = 2.0
"""Pixel widths on the surface that depths of neighbouring pixels may differ by, beside their slope."""


@dataclass(frozen=True, eq=False)
class Flow:
    """Where the surface in each pixel of one picture lies in another."""

    flow: Tensor  # (B,H,W,2) float32 pixels to the right and down; NaN where empty or behind the other camera
    visible: Tensor  # (B,H,W) bool: inside the other picture and not hidden there
    position: Tensor  # (B,H,W,3) float64 of the surface when the other picture is taken; 0 where empty

    __repr__ = brief

    @property
    def occluded(self) -> Tensor:
        """(B,H,W) bool: a surface that the other picture does not show."""
        return ~self.visible & torch.isfinite(self.position).all(dim=-1) & (self.position != 0).any(dim=-1)


def visibility(cameras: Cameras, gbuffer: GBuffer, shape: Shape | RayCaster | None = None) -> Tensor:
    """(B,H,W) bool: do these cameras see the surfaces that the pixels of ``gbuffer`` show?

    By rays from the cameras to the exact positions, so it does not depend on what the cameras have drawn. A surface
    counts as seen from either side.

    Args:
        cameras: B, or one for all pictures.
        gbuffer: B pictures, or one for all cameras.
        shape: what may hide them: a scene, a mesh, triangles, or a ray caster of them if it serves several times.
            None: what ``gbuffer`` was drawn from.

    Raises:
        InputError: no cameras, no G-buffer or no shape, or numbers of pictures and cameras that do not fit.
    """
    check_class("cameras", cameras, Cameras)
    check_class("gbuffer", gbuffer, GBuffer)
    check_fixed_buffers("visibility", "gbuffer", gbuffer)
    count = _fit(len(cameras), len(gbuffer.depth))
    position = gbuffer.position.expand(count, *gbuffer.position.shape[1:])
    covered = gbuffer.covered.expand(count, *gbuffer.covered.shape[1:])
    caster = shape if isinstance(shape, RayCaster) else RayCaster(_geometry(gbuffer, shape))
    same = isinstance(gbuffer, SeenSurface) and gbuffer.source is caster.geometry
    own = gbuffer.triangle.expand(count, *gbuffer.triangle.shape[1:]) if same else None
    pixels, depth = _project(cameras, position)
    return _seen_by_rays(cameras, position, depth, covered & _inside(cameras, pixels, depth), own, caster)


def flow(a: GBuffer, b: GBuffer, *, method: str = "rays") -> Flow:
    """Optical flow from picture ``a`` to picture ``b``, and what of ``a`` is hidden there.

    Where both were drawn from triangles in the same order that moved in between (``scene.at(time)``), surfaces are
    followed; else they stand still.

    Args:
        a: B pictures; b: B pictures of any size, or one for all.
        method: "rays" asks the triangles of ``b``; "depth" its depth image, which is quicker and unsure within a pixel
            of outlines.

    Raises:
        InputError: no G-buffers, numbers of pictures that do not fit, or "rays" where ``b`` holds no triangles any
            more.
        OptionError: an unknown method.
    """
    check_choice("method", method, METHODS)
    check_class("a", a, GBuffer)
    check_class("b", b, GBuffer)
    for name, given in (("a", a), ("b", b)):
        check_fixed_buffers("flow", name, given)
    count = _fit(len(b.depth), len(a.depth))
    if count != len(a.depth):
        raise InputError(f"b must have 1 or {len(a.depth)} pictures, got {len(b.depth)}")
    position = torch.where(a.covered[..., None], _followed(a, b), torch.zeros((), dtype=torch.float64))
    pixels, depth = _project(b.cameras, position)
    inside = a.covered & _inside(b.cameras, pixels, depth)
    move = (pixels - a.cameras.pixel_centres()).float()
    move[~a.covered] = torch.nan
    if method == "rays":
        geometry = _geometry(b, None)
        own = a.triangle if isinstance(a, SeenSurface) and _same_order(a.source, geometry) else None
        seen = _seen_by_rays(b.cameras, position, depth, inside, own, RayCaster(geometry))
    else:
        seen = inside & _shown(b, pixels, depth)
    return Flow(move, seen, position)


def _fit(cameras: int, pictures: int) -> int:
    count = max(cameras, pictures)
    if {cameras, pictures} - {1, count}:
        raise InputError(f"as many cameras as pictures, or one, are needed: got {cameras} and {pictures}")
    return count


def _geometry(gbuffer: GBuffer, shape: Shape | None) -> Geometry:
    if shape is not None:
        return geometry_of("shape", shape)
    if isinstance(gbuffer, SeenSurface) and gbuffer.source is not None:
        return gbuffer.source
    raise InputError("shape must be given: this G-buffer does not hold the triangles it was drawn from")


def _followed(a: GBuffer, b: GBuffer) -> Tensor:
    """Where the surfaces of ``a`` are when ``b`` is taken."""
    before, after = (one.source if isinstance(one, SeenSurface) else None for one in (a, b))
    if before is None or after is None or before is after or not _same_order(before, after):
        return a.position
    corners = after.vertices.double()[after.faces[a.triangle.clamp_min(0)].long()]
    second, third = a.barycentric.double().unbind(-1)
    weights = torch.stack([1.0 - second - third, second, third], dim=-1)
    return (corners * weights[..., None]).sum(dim=-2)


def _same_order(before: Geometry | None, after: Geometry) -> bool:
    """The same triangles, wherever they are."""
    return before is after or (before is not None and torch.equal(before.faces, after.faces))


def _project(cameras: Cameras, position: Tensor) -> tuple[Tensor, Tensor]:
    """Pixel coordinates and depth in as many cameras as pictures, or in one."""
    if len(cameras) == len(position):
        return cameras.project(position)
    flat, depth = cameras.project(position.reshape(1, -1, 3))
    return flat.reshape(*position.shape[:-1], 2), depth.reshape(position.shape[:-1])


def _inside(cameras: Cameras, pixels: Tensor, depth: Tensor) -> Tensor:
    """Within the pictures and between near and far."""
    limits = [one.reshape(-1, *([1] * (depth.dim() - 1))) for one in (cameras.near, cameras.far)]
    size = torch.tensor([cameras.width, cameras.height], dtype=pixels.dtype)
    return ((pixels >= 0) & (pixels < size)).all(dim=-1) & (depth >= limits[0]) & (depth <= limits[1])


def _seen_by_rays(
    cameras: Cameras, position: Tensor, depth: Tensor, asked: Tensor, own: Tensor | None, caster: RayCaster
) -> Tensor:
    """(B,H,W) bool; ``own`` are the triangles that the positions lie on, where the caster has the same ones."""
    if cameras.orthographic:
        toward = cameras.forward[:, None, None].expand_as(position) * depth[..., None]
        origins = position - toward
    else:
        origins = cameras.eye[:, None, None].expand_as(position)
        toward = position - origins
    hits = caster.first_hit(origins[asked], toward[asked])
    free = hits.t >= 1.0 - NEARER
    if own is not None:
        free |= hits.triangle == own[asked]
    seen = asked.clone()
    seen[asked] = free
    return seen


def _shown(b: GBuffer, pixels: Tensor, depth: Tensor) -> Tensor:
    """(B,H,W) bool: one of the four nearest pixels shows this depth, as near as its surface's slope lets one tell."""
    count, height, width = depth.shape
    images = b.depth.expand(count, *b.depth.shape[1:]).double()
    slope = _slope(b).expand_as(images)
    shown = torch.zeros_like(depth, dtype=torch.bool)
    low = torch.nan_to_num(pixels - 0.5).floor().long()
    batch = torch.arange(count)[:, None, None].expand(count, height, width)
    for right in (0, 1):
        for down in (0, 1):
            column = (low[..., 0] + right).clamp(0, b.cameras.width - 1)
            row = (low[..., 1] + down).clamp(0, b.cameras.height - 1)
            there = images[batch, row, column]
            shown |= depth <= there + slope[batch, row, column] + NEARER * depth.abs()
    return shown


def _slope(b: GBuffer) -> Tensor:
    """(B,H,W) float64: how much depth changes within :data:`SLACK` pixels on the surface of each pixel."""
    normal = b.geometric_normal.double()
    toward = torch.nn.functional.normalize(b.position - b.cameras.eye[:, None, None], dim=-1, eps=1e-300)
    if b.cameras.orthographic:
        toward = b.cameras.forward[:, None, None].expand_as(toward)
    cosine = (normal * toward).sum(dim=-1).abs().clamp_min(1e-3)
    depth = torch.where(b.covered, b.depth, 0.0).double()
    return SLACK * b.cameras.footprint(depth) / cosine
