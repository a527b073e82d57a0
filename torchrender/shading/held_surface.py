"""What pixels see as a function of where things are: depth, weights and attributes with gradients, visibility held.

The rasteriser decides which triangle a pixel sees; this decides nothing, it follows each pixel's ray to the plane of
that triangle once more, in torch. So derivatives reach vertices, poses and intrinsics inside triangles, and outlines
carry none: a triangle that moves into view, or out of it, changes nothing until the picture is drawn again.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.brief import brief, brief_html
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import ArrayLike, as_array, check_finite, check_tensor
from torchrender.errors import InputError

_EDGE_ON = 1e-9
"""Sine of the angle between a ray and a plane below which they are taken as parallel."""


@dataclass(frozen=True, eq=False)
class HeldSurface:
    """What the pixels of B cameras see, differentiable in what it was made from; float64."""

    seen: VisibilityBuffer
    depth: Tensor  # (B,H,W) camera z; +inf where empty
    position: Tensor  # (B,H,W,3) world space; 0 where empty
    barycentric: Tensor  # (B,H,W,3) weights of the triangle's vertices; 0 where empty
    corners: Tensor  # (N,3) int64 vertices of the triangles that covered pixels see, picture after picture, row by row

    __repr__ = brief
    _repr_html_ = brief_html

    def blend(self, values: Tensor) -> Tensor:
        """Attributes (V,K) of vertices at the pixels (B,H,W,K), 0 where empty; differentiable in them, too.

        Raises:
            InputError: no tensor (V,K) of floats, or too few rows.
        """
        check_tensor("values", values, ("V", "K"))
        if not values.is_floating_point():
            raise InputError(f"values must hold floats, got {values.dtype}")
        if self.corners.numel() and int(self.corners.max()) >= len(values):
            raise InputError(f"values must have a row for each of {int(self.corners.max()) + 1} vertices")
        covered = self.seen.covered
        mixed = (values.double()[self.corners] * self.barycentric[covered][..., None]).sum(dim=1)
        return _image(mixed, covered, 0.0)


def held_surface(
    seen: VisibilityBuffer,
    vertices: ArrayLike,
    faces: Tensor,
    *,
    camera_from_world: ArrayLike | None = None,
    intrinsics: ArrayLike | None = None,
) -> HeldSurface:
    """Depth, positions and barycentric weights of the triangles that pixels see, with gradients.

    Args:
        seen: what :func:`torchrender.rasterize` found; its triangles stay the ones that pixels see.
        vertices: (V,3) of what was drawn, in the order of ``faces``; of a scene of several meshes one after the other,
            as ``scene.geometry`` has them. They may have moved a little.
        faces: (F,3) integer, rows as ``seen.triangle`` counts them.
        camera_from_world: (B,4,4); None: those of ``seen.cameras``. Not held to be rigid: turn it by a rotation.
        intrinsics: (B,3,3); None: those of ``seen.cameras``.

    A triangle that its pixel's ray runs along has the depth that was drawn, without gradient.

    Raises:
        InputError: another shape, values that are not finite, or faces that ``seen`` does not fit; names the argument.
    """
    points = check_finite("vertices", check_tensor("vertices", as_array("vertices", vertices), ("V", 3)).double())
    triangles = check_tensor("faces", as_array("faces", faces, torch.int64), ("F", 3)).long()
    cameras, covered = seen.cameras, seen.covered
    pose = cameras.camera_from_world if camera_from_world is None else as_array("camera_from_world", camera_from_world)
    lens = cameras.intrinsics if intrinsics is None else as_array("intrinsics", intrinsics)
    pose = check_finite("camera_from_world", check_tensor("camera_from_world", pose, (len(cameras), 4, 4))).double()
    lens = check_finite("intrinsics", check_tensor("intrinsics", lens, (len(cameras), 3, 3))).double()
    rows = seen.triangle[covered]
    if rows.numel() and int(rows.max()) >= len(triangles):
        raise InputError(f"faces must be those that were drawn: pixels see {int(rows.max()) + 1} of them or more")
    corners = triangles[rows]
    if corners.numel() and not 0 <= int(corners.min()) <= int(corners.max()) < len(points):
        raise InputError(f"faces must index {len(points)} vertices, got {int(corners.min())} to {int(corners.max())}")
    picture, row, column = covered.nonzero().unbind(-1)
    place = points[corners]
    local = place @ pose[picture, :3, :3].transpose(1, 2) + pose[picture, None, :3, 3]
    k = lens[picture]
    y = (row + 0.5 - k[:, 1, 2]) / k[:, 1, 1]
    x = (column + 0.5 - k[:, 0, 2] - k[:, 0, 1] * y) / k[:, 0, 0]
    one, none = torch.ones_like(x), torch.zeros_like(x)
    if cameras.orthographic:
        origin, ray = torch.stack([x, y, none], dim=-1), torch.stack([none, none, one], dim=-1)
    else:
        origin, ray = torch.zeros(len(x), 3, dtype=x.dtype), torch.stack([x, y, one], dim=-1)
    depth, weights = _meet(local, origin, ray, seen.depth[covered].double())
    return HeldSurface(
        seen,
        _image(depth, covered, torch.inf),
        _image((place * weights[..., None]).sum(dim=1), covered, 0.0),
        _image(weights, covered, 0.0),
        corners,
    )


def _meet(corners: Tensor, origin: Tensor, ray: Tensor, drawn: Tensor) -> tuple[Tensor, Tensor]:
    """Ray parameters (N,) at the planes of triangles (N,3,3), and the weights (N,3) of their corners there."""
    a, b, c = corners.unbind(1)
    u, w = b - a, c - a
    normal = torch.linalg.cross(u, w)
    square = (normal * normal).sum(dim=-1)
    slope = (normal * ray).sum(dim=-1)
    clear = slope.abs() > _EDGE_ON * (square * (ray * ray).sum(dim=-1)).sqrt()
    t = (normal * (a - origin)).sum(dim=-1) / torch.where(clear, slope, 1.0)
    t = torch.where(clear, t, drawn)
    place = origin + t[:, None] * ray - a
    square = torch.where(square > 0, square, 1.0)
    second = (torch.linalg.cross(place, w) * normal).sum(dim=-1) / square
    third = (torch.linalg.cross(u, place) * normal).sum(dim=-1) / square
    return t, torch.stack([1.0 - second - third, second, third], dim=-1)


def _image(values: Tensor, covered: Tensor, empty: float) -> Tensor:
    """Values (N,...) of covered pixels as an image (B,H,W,...)."""
    out = torch.full((*covered.shape, *values.shape[1:]), empty, dtype=values.dtype)
    return out.masked_scatter(covered.reshape(*covered.shape, *[1] * (values.dim() - 1)), values)
