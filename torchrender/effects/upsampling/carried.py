"""The light of earlier pictures for another view of the same scene: what stands still need not be shaded again.

Reverse reprojection (Nehab et al., *Accelerating real-time shading with reverse reprojection caching*, 2007): every
pixel of the new view, whose depth is drawn much sooner than it is shaded, looks up its surface in the pictures that are
there. What mirrors show is looked up apart, at the places where it seems to be: it moves as they do and not as the
mirror's surface. All light is taken from pictures that were shaded, never from what was carried before, so that nothing
gets blurred from view to view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_no_gradient, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.warp.carrying import carry_mirrors, carry_surfaces
from torchrender.scene.camera import Cameras

SAME_SURFACE = 0.02
"""Difference of 1/z, as a share, from which a pixel beside a place counts little for it."""
LEAST = 0.25
"""Bilinear weights of the pixels of its surface around a place, together, from which these speak for it."""
REACH = 2.0
"""Pixels that a virtual point may be off: where near things stand before far ones no step leads to the very place."""
PAINTED = 0.2
"""Part of a pixel's light from which what it mirrors is said to be stale, if no virtual point is found."""


@dataclass(frozen=True, eq=False)
class MirroredLight:
    """The part of a picture's light that was mirrored, and where it seems to come from."""

    depth: Tensor  # (H,W) float32 camera z of the virtual points; +inf what is infinitely far, or not known
    light: Tensor  # (H,W,3) zero where nothing is mirrored
    known: Tensor  # (H,W) bool: the pixel mirrors


@dataclass(frozen=True, eq=False)
class LitPicture:
    """A picture of one camera whose light may be carried."""

    seen: VisibilityBuffer  # (1,H,W)
    light: Tensor  # (H,W,3) linear, with what is mirrored
    mirrors: MirroredLight | None = None  # None: nothing mirrors

    @cached_property
    def matte(self) -> Tensor:
        """(H,W,3) light without what is mirrored."""
        return self.light if self.mirrors is None else (self.light - self.mirrors.light).clamp_min(0.0)


@dataclass(frozen=True, eq=False)
class CarriedLight:
    """What a view takes from other pictures."""

    light: Tensor  # (H,W,3) linear, with what is mirrored; zero where nothing is known
    known: Tensor  # (H,W) bool
    stale: Tensor  # (H,W) bool: known, but what a mirror shows there now has only come into view
    mirrors: MirroredLight

    @property
    def share(self) -> float:
        """Of the pixels, that are known."""
        return int(self.known.count_nonzero()) / max(1, self.known.numel())


def carried_light(seen: VisibilityBuffer, pictures: Sequence[LitPicture], materials: Tensor) -> CarriedLight:
    """The light of what one camera sees, as far as other pictures show it; the picture seen from nearest goes first.

    Args:
        seen: (1,H,W) what is wanted.
        pictures: of the same scene under the same light, perspective, of any size.
        materials: (F,) int64 by triangle, :attr:`Geometry.material`.

    Raises:
        InputError: shapes that do not fit, or orthographic cameras. GradientError: light that asks for gradients.
    """
    if len(seen.triangle) != 1:
        raise InputError(f"seen must be of one camera, got {len(seen.triangle)}")
    if seen.cameras.orthographic or any(p.seen.cameras.orthographic for p in pictures):
        raise InputError("cameras must be perspective")
    shape = tuple(seen.depth.shape[1:])
    own, faces = _arrays(seen), view(materials, np.int64)
    light, known = np.zeros((*shape, 3), np.float32), np.zeros(shape, np.bool_)
    mirrors = np.full(shape, np.inf, np.float32), np.zeros((*shape, 3), np.float32), np.zeros(shape, np.uint8)
    for picture in sorted(pictures, key=lambda p: _apart(p.seen.cameras, seen.cameras)):
        check_tensor("light", picture.light, (*picture.seen.depth.shape[1:], 3))
        check_no_gradient("carried_light", light=picture.light)
        source, matrix = _arrays(picture.seen), _pixels_between(seen.cameras, picture.seen.cameras)
        before = known.copy()
        matte, limits = view(picture.matte, np.float32), (SAME_SURFACE, LEAST)
        carry_surfaces(own, source, matte, faces, matrix, limits, known, light)
        if picture.mirrors is not None:
            shown = tuple(view(getattr(picture.mirrors, name), kind) for name, kind in _MIRROR_TYPES)
            back = _pixels_between(picture.seen.cameras, seen.cameras)
            carry_mirrors(own, source[2], shown, matrix, back, REACH, known & ~before, mirrors)
        if known.all():
            break
    depth, mirrored, state = (torch.from_numpy(a) for a in mirrors)
    whole = torch.from_numpy(light) + mirrored
    return CarriedLight(
        light=whole,
        known=torch.from_numpy(known),
        stale=(state == _PAINTED) & (mirrored.amax(dim=2) > PAINTED * whole.amax(dim=2)),
        mirrors=MirroredLight(depth, mirrored, state > 0),
    )


_PAINTED = 2  # state of a mirror for whose light no virtual point was found
_MIRROR_TYPES = (("depth", np.float32), ("light", np.float32), ("known", np.bool_))


def _arrays(seen: VisibilityBuffer) -> tuple[np.ndarray, ...]:
    return view(seen.depth[0], np.float32), view(seen.triangle[0], np.int64), view(seen.object_id[0], np.int64)


def _apart(first: Cameras, second: Cameras) -> float:
    """How far two views are from each other: what they have in common is asked of the nearest."""
    return float((first.eye - second.eye).norm())


def _pixels_between(source: Cameras, target: Cameras) -> np.ndarray:
    """(3,4): homogeneous pixel of the target camera = z M[:, :3] (u, v, 1) + M[:, 3], for pixels of the source."""
    project = target.intrinsics @ target.rotation
    inverse = source.world_from_camera
    turn = project @ inverse[:, :3, :3] @ torch.linalg.inv(source.intrinsics)
    shift = project @ inverse[:, :3, 3:] + target.intrinsics @ target.camera_from_world[:, :3, 3:]
    return np.ascontiguousarray(torch.cat([turn, shift], dim=2)[0].numpy())
