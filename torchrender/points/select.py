"""Which patches of a point model a camera sees, and at which level of detail. Source: specification 06, section 4."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError
from torchrender.points.tree import PatchHeaders
from torchrender.scene.camera import Cameras

LEVELS = ("auto", "deepest")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SelectionOptions:
    """Culling and level choice."""

    cull: bool = True  # leave out patches outside the view, and those that show their back
    level: str = "auto"  # "deepest": every point itself
    coarse_radius: float = 2.0  # tau: greatest projected radius, pixels, 0.5 to 8
    fine_radius: float = 0.7  # the same for silhouettes and curved patches, 0.3 to 2
    curved_variation: float = 0.01  # sigma_hi: a patch less flat than this counts as curved
    curved_cone_deg: float = 25.0  # alpha_hi: so does one whose cone of normals is wider

    def __post_init__(self) -> None:
        check_choice("level", self.level, LEVELS)
        check_range("coarse_radius", self.coarse_radius, 0.5, 8.0)
        check_range("fine_radius", self.fine_radius, 0.3, 2.0)
        check_range("curved_variation", self.curved_variation, 0.0, 1 / 3)
        check_range("curved_cone_deg", self.curved_cone_deg, 0.0, 180.0)
        if self.fine_radius > self.coarse_radius:
            raise OptionError(f"fine_radius must be <= coarse_radius {self.coarse_radius}, got {self.fine_radius}")


@dataclass(frozen=True, eq=False)
class Selection:
    """The patches that one camera draws."""

    chosen: Tensor  # (S,) int64 patches, ascending
    level: Tensor  # (S,) int64
    silhouette: Tensor  # (S,) bool: part of the patch may face the camera and part of it not
    outside: int  # patches outside the view
    back: int  # patches within it that show their back


def select_patches(
    headers: PatchHeaders, camera: Cameras, options: SelectionOptions, *, two_sided: bool, margin: float
) -> Selection:
    """Cull patches and choose levels for one perspective camera.

    A patch shows its back if alpha + gamma < 90 degrees and a.v >= sin(alpha + gamma), gamma being half the angle
    under which its sphere is seen: never true if one of its points could face the eye. The level is the coarsest
    whose greatest radius projects to at most tau pixels at the nearest point of the box.

    Args:
        margin: pixels that a filter reaches beyond the point itself.
    """
    eye = camera.eye[0]
    back, silhouette = _sides(headers, eye, two_sided)
    focal = float(camera.intrinsics[0, (0, 1), (0, 1)].max())
    nearest = (headers.box[:, 0] - eye).clamp_min(0) + (eye - headers.box[:, 1]).clamp_min(0)
    distance = nearest.norm(dim=1).clamp_min(float(camera.near[0]))
    curved = (headers.sigma > options.curved_variation) | (headers.cone[:, 3] > math.radians(options.curved_cone_deg))
    tau = torch.where(silhouette | curved, options.fine_radius, options.coarse_radius)
    depth = (headers.start[:, 1:] > headers.start[:, :-1]).sum(1) - 1
    level = depth
    if options.level == "auto":
        fits = focal * headers.radius[:, :, 2] <= (tau * distance)[:, None]
        level = torch.where(fits.any(1), fits.int().argmax(1), depth).minimum(depth)
    seen = torch.ones(len(headers), dtype=torch.bool)
    outside = torch.zeros_like(seen)
    if options.cull:
        reach = headers.radius[torch.arange(len(headers)), level, 2]
        outside = _outside(headers.box, reach, camera, margin)
        seen = ~outside & ~back
    chosen = seen.nonzero().reshape(-1)
    return Selection(
        chosen=chosen,
        level=level[chosen],
        silhouette=silhouette[chosen],
        outside=int(outside.sum()),
        back=int((back & ~outside).sum()) if options.cull else 0,
    )


def _sides(headers: PatchHeaders, eye: Tensor, two_sided: bool) -> tuple[Tensor, Tensor]:
    """(N,) whether a patch surely shows its back, and whether it may show both sides."""
    toward = headers.centre - eye
    distance = toward.norm(dim=1)
    radius = headers.sphere_radius
    beyond = distance > radius
    toward = toward / distance.clamp_min(1e-300)[:, None]
    gamma = torch.asin((radius / distance.clamp_min(1e-300)).clamp(max=1.0))
    opening = headers.cone[:, 3] + gamma
    decided = beyond & (opening < math.pi / 2)
    along = (headers.cone[:, :3] * toward).sum(1)
    limit = torch.sin(opening)
    back = decided & (along >= limit)
    facing = decided & (-along >= limit)
    if two_sided:
        # Either side is drawn: only patches seen edge-on are on the outline.
        facing = facing | back
        back = torch.zeros_like(back)
    return back, ~facing & ~back


def _outside(box: Tensor, reach: Tensor, camera: Cameras, margin: float) -> Tensor:
    """(N,) whether a box, grown by ``reach`` (N,), lies outside one of the planes of the view."""
    border = math.ceil(margin) + 1
    wide = camera.sub_camera(-border, -border, camera.width + 2 * border, camera.height + 2 * border)
    planes = wide.frustum_planes()[0]
    centre, half = 0.5 * (box[:, 0] + box[:, 1]), 0.5 * (box[:, 1] - box[:, 0])
    distance = centre @ planes[:, :3].T + half @ planes[:, :3].abs().T + planes[:, 3] + reach[:, None]
    return (distance < 0).any(1)
