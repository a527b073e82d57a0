"""What enhancement needs to know of what a picture shows: of a G-buffer, of points, of voxels, of a depth picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import GBuffer
from torchrender.checks import check_tensor
from torchrender.effects.enhancement.curvature import (
    MeshCurvature,
    picture_curvature,
    relative_to,
    usual_limit,
)
from torchrender.effects.enhancement.derivatives import projection_gradient
from torchrender.kernels.enhancement.curvature import pixel_curvature
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry

SAMPLES = 1 << 16
"""Pixels of a picture that median depths are taken from."""


@dataclass(frozen=True, eq=False)
class SurfaceImage:
    """Surfaces seen by B cameras, whatever they come from; empty pixels have depth +inf and normal 0."""

    cameras: Cameras
    depth: Tensor  # (B,H,W) camera z
    position: Tensor  # (B,H,W,3) float64 world space
    normal: Tensor  # (B,H,W,3) unit shading normal towards the eye
    geometric_normal: Tensor  # (B,H,W,3) unit normal of the face, towards the eye
    object_id: Tensor  # (B,H,W) int64, -1 where empty

    @classmethod
    def of(cls, gbuffer: GBuffer) -> SurfaceImage:
        """What a rasterised picture shows."""
        return cls(
            cameras=gbuffer.cameras,
            depth=gbuffer.depth,
            position=gbuffer.position,
            normal=gbuffer.normal,
            geometric_normal=gbuffer.geometric_normal,
            object_id=gbuffer.object_id,
        )

    @classmethod
    def from_depth(cls, cameras: Cameras, depth: Tensor, normal: Tensor | None = None) -> SurfaceImage:
        """What a picture of points, a scan or an isosurface shows.

        Args:
            depth: (B,H,W) camera z; what is not finite or not positive is empty.
            normal: (B,H,W,3) world space; None: from depth, by kornia.

        Raises:
            InputError: shapes that do not fit.
        """
        check_tensor("depth", depth, (len(cameras), cameras.height, cameras.width))
        seen = torch.isfinite(depth) & (depth > 0)
        flat = torch.where(seen, depth, 1.0)
        position = cameras.unproject(cameras.pixel_centres(), flat)
        position = torch.where(seen[..., None], position, 0.0)
        own = depth_normals(cameras, depth, seen) if normal is None else normal
        check_tensor("normal", own, (*depth.shape, 3))
        own = torch.nn.functional.normalize(own.float(), dim=-1, eps=1e-30)
        seen = seen & (own.abs().amax(dim=-1) > 0)
        toward = cameras.eye[:, None, None] - position
        if cameras.orthographic:
            toward = -cameras.forward[:, None, None].expand_as(position)
        turned = torch.where((own.double() * toward).sum(-1, keepdim=True) < 0, -own, own)
        turned = torch.where(seen[..., None], turned, 0.0)
        return cls(
            cameras=cameras,
            depth=torch.where(seen, depth.float(), torch.inf),
            position=position,
            normal=turned,
            geometric_normal=turned,
            object_id=torch.where(seen, 0, -1),
        )

    @cached_property
    def covered(self) -> Tensor:
        """(B,H,W) bool."""
        return torch.isfinite(self.depth) & (self.object_id >= 0)

    @cached_property
    def rays(self) -> Tensor:
        """(B,H,W,3) float64 directions of the pixels, depth 1."""
        return self.cameras.rays()[1].expand_as(self.position)

    @property
    def axes(self) -> Tensor:
        """(B,2,3) float64 directions of the picture to the right and down, world space."""
        return self.cameras.camera_from_world[:, :2, :3]

    @cached_property
    def reference_depth(self) -> Tensor:
        """(B,H,W) float32 median depth of the object seen; of objects of few pixels their own depth; 1 where empty.

        Medians are taken over at most ``SAMPLES`` pixels. Orthographic pictures have depth 1: their size does not
        depend on it.
        """
        if self.cameras.orthographic:
            return torch.ones_like(self.depth)
        out = torch.where(self.covered, self.depth, 1.0)
        step = max(1, round((self.depth[0].numel() / SAMPLES) ** 0.5)) if len(out) else 1
        for depth, objects, filled in zip(self.depth, self.object_id, out):
            covered = objects >= 0
            if not bool(covered.any()):
                continue
            names, place = compact(objects)
            chosen = (place[::step, ::step].reshape(-1), depth[::step, ::step].reshape(-1))
            median = medians(chosen[0], chosen[1], len(names))[place.clamp_min(0)]
            filled.copy_(torch.where((place >= 0) & (median > 0), median, filled))
        return out

    def projection(self, grazing: float, *, per_pixel: bool = False) -> Tensor:
        """(B,H,W,3,2) float64 how the seen points move, per focal length or per pixel; frontal where empty."""
        normal = torch.where(self.covered[..., None], self.geometric_normal.double(), -self.rays)
        rows, depth = len(self.cameras), torch.where(self.covered, self.depth, 1.0).double()
        if self.cameras.orthographic:
            depth = torch.ones_like(depth)
        moves = [projection_gradient(self.rays[b], normal[b], depth[b], self.axes[b], grazing) for b in range(rows)]
        made = torch.stack(moves) if moves else torch.zeros(*self.depth.shape, 3, 2, dtype=torch.float64)
        if per_pixel:
            focal = self.cameras.intrinsics[:, (0, 1), (0, 1)]
            made = made / focal[:, None, None, None]
        return made

    def curvature(self, limit: float | None = None, *, centred: bool = False) -> Tensor:
        """(B,H,W) float32 ``k / beta`` of what the picture shows, from how its normals turn.

        ``centred``: the median of each picture is taken away first.
        """
        if not len(self.cameras):
            return torch.zeros_like(self.depth)
        found = picture_curvature(self.normal, self.projection(0.2, per_pixel=True), self.depth)
        for one, covered, depth in zip(found, self.covered, self.depth):
            if not bool(covered.any()):
                continue
            if centred:
                one.copy_(torch.where(one != 0, one - one[covered].median(), 0.0))
            extent = float(depth[covered].median())
            one.copy_(relative_to(one, usual_limit(one[covered], extent) if limit is None else limit))
        return found.float()


def curvature_of(gbuffer: GBuffer, geometry: Geometry, curvature: MeshCurvature) -> Tensor:
    """(B,H,W) float32 ``k / beta`` of a mesh as its pixels see it: interpolated, negative where its back is seen."""
    out = torch.zeros(gbuffer.triangle.numel())
    if geometry.normals is not None and out.numel():
        mesh = (
            view(geometry.faces, np.int32),
            view(curvature.relative, np.float32),
            view(geometry.normals, np.float32),
        )
        pixel_curvature(
            view(gbuffer.triangle.reshape(-1), np.int64),
            view(gbuffer.barycentric.reshape(-1, 2), np.float32),
            mesh,
            view(gbuffer.normal.reshape(-1, 3), np.float32),
            out.numpy(),
        )
    return out.reshape(gbuffer.triangle.shape)


def depth_normals(cameras: Cameras, depth: Tensor, seen: Tensor) -> Tensor:
    """(B,H,W,3) float32 world-space normals of a depth picture; 0 where it, or a neighbour, is empty."""
    from kornia.filters import spatial_gradient  # a second to import: not for those who do not ask for it

    points = cameras.unproject(cameras.pixel_centres(), torch.where(seen, depth, 1.0)).permute(0, 3, 1, 2)
    slope = spatial_gradient(points, mode="diff", order=1)
    normal = torch.linalg.cross(slope[:, :, 1], slope[:, :, 0], dim=1)
    size = normal.abs().amax(dim=1, keepdim=True).clamp_min(1e-300)
    normal = torch.nn.functional.normalize(normal / size, dim=1, eps=1e-30).permute(0, 2, 3, 1).float()
    around = torch.nn.functional.max_pool2d((~seen)[:, None].float(), 3, stride=1, padding=1)[:, 0] > 0
    return torch.where(around[..., None], 0.0, normal)


def compact(objects: Tensor) -> tuple[Tensor, Tensor]:
    """Object ids as they occur (K,), and each pixel's place among them, -1 where empty."""
    top = int(objects.max())
    if top > 1 << 20:
        names, place = torch.unique(objects, return_inverse=True)
        empty = int((names < 0).sum())
        return names[empty:], place - empty
    present = torch.zeros(top + 2, dtype=torch.bool)
    present[objects.reshape(-1).clamp_min(-1) + 1] = True
    present[0] = False
    place = present.cumsum(0) - 1
    place[0] = -1
    return present.nonzero().reshape(-1) - 1, place[objects.clamp_min(-1) + 1]


def medians(group: Tensor, value: Tensor, count: int) -> Tensor:
    """(count,) lower medians of the values of each group; 0 of groups without any. Groups below 0 are left out."""
    kept = group >= 0
    group, value = group[kept], value[kept]
    order = value.argsort()
    order = order[group[order].argsort(stable=True)]
    sizes = torch.bincount(group, minlength=count)
    first = sizes.cumsum(0) - sizes
    middle = (first + (sizes - 1).clamp_min(0) // 2).clamp_max(max(len(order) - 1, 0))
    found = value[order][middle] if len(order) else torch.zeros(count)
    return torch.where(sizes > 0, found, 0.0)
