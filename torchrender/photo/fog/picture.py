"""A photo on its way through fog, and what comes out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_finite
from torchrender.errors import InputError
from torchrender.photo.fog.options import FogWarning

MAX_PIXELS = 6_000_000
"""Larger photos are halved, until they are not, for all but the last step."""


@dataclass(frozen=True, eq=False)
class FogPicture:
    """What fog makes of a photo: ``composite = photo * transmittance + scattered``."""

    composite: Tensor  # (H,W,3) linear light
    transmittance: Tensor  # (H,W,3) in [0,1]
    scattered: Tensor  # (H,W,3) radiance, at least 0
    depth: Tensor  # (H,W) camera z, metres
    facts: dict[str, object] = field(default_factory=dict)  # estimated lights, sun, errors
    timings_ms: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Prepared:
    """A photo in linear light, and the size that fog is computed at."""

    light: Tensor  # (H,W,3) float32
    alpha: Tensor | None  # (H,W,1)
    halvings: int

    @property
    def work(self) -> Tensor:
        """(h,w,3) the photo at the size that fog is computed at."""
        if not self.halvings:
            return self.light
        h, w = self.work_size
        return torch.from_numpy(cv2.resize(self.light.numpy(), (w, h), interpolation=cv2.INTER_AREA))

    @property
    def work_size(self) -> tuple[int, int]:
        """Height and width that fog is computed at."""
        h, w = self.light.shape[:2]
        return max(1, h >> self.halvings), max(1, w >> self.halvings)

    def full(self, image: Tensor) -> Tensor:
        """An image (h,w) or (h,w,C) of the working size at the photo's."""
        if not self.halvings:
            return image
        h, w = self.light.shape[:2]
        grown = cv2.resize(np.ascontiguousarray(image.numpy()), (w, h), interpolation=cv2.INTER_LINEAR)
        return torch.from_numpy(grown).reshape(h, w, *image.shape[2:])


def prepare(photo: Tensor) -> Prepared:
    """A photo (H,W), or (H,W,C) of 1 to 4 channels, linear light.

    Grey becomes RGB; alpha is kept beside it. Large photos are halved for the computation, with a warning.

    Raises:
        InputError: another shape, no floating-point tensor, or values that are not finite.
    """
    if not isinstance(photo, Tensor) or not photo.is_floating_point():
        kind = photo.dtype if isinstance(photo, Tensor) else type(photo).__name__
        raise InputError(f"photo must be a floating-point tensor (H, W, C), got {kind}")
    if photo.dim() == 2:
        photo = photo[..., None]
    if photo.dim() != 3 or photo.shape[2] not in (1, 2, 3, 4) or not photo.numel():
        raise InputError(f"photo must have shape (H, W) or (H, W, C) with C from 1 to 4, got {tuple(photo.shape)}")
    check_finite("photo", photo)
    alpha = photo[..., -1:].float() if photo.shape[2] in (2, 4) else None
    color = photo[..., :-1] if alpha is not None else photo
    light = color.detach().float().clamp_min(0.0).expand(-1, -1, 3).contiguous()
    halvings = 0
    while (photo.shape[0] >> halvings) * (photo.shape[1] >> halvings) > MAX_PIXELS:
        halvings += 1
    if halvings:
        side = 2**halvings
        warnings.warn(
            f"a photo of {photo.shape[1]} x {photo.shape[0]} pixels: fog is computed at 1/{side} of that",
            FogWarning, stacklevel=3,
        )  # fmt: skip
    return Prepared(light, alpha, halvings)


def polygon_mask(polygon: tuple[tuple[float, float], ...], height: int, width: int) -> Tensor:
    """(H,W) bool: pixels of a polygon, those that it merely touches included; none where it lies outside."""
    mask = np.zeros((height, width), np.uint8)
    points = np.clip(np.array(polygon), -1e5, 1e5)
    codes = np.round((points - 0.5) * 16).astype(np.int32).reshape(-1, 1, 2)
    cv2.fillPoly(mask, [codes], 1, shift=4)
    return torch.from_numpy(mask > 0)


def disc_mask(centre: tuple[float, float], radius: float, height: int, width: int) -> Tensor:
    """(H,W) bool: pixels around a place."""
    v, u = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    return (u - centre[0]) ** 2 + (v - centre[1]) ** 2 <= radius * radius


def nearest_on_part(part: Tensor, known: Tensor, reach: float) -> Tensor:
    """(HW,) int64 for each pixel that is not known the number of the nearest known one of its own part.

    Args:
        part: (H,W) int64 what a pixel shows, -1 for nothing. known: (H,W) bool.
        reach: share of the width; -1 is said of pixels that have none so near, and of the known ones themselves.
    """
    h, w = part.shape
    found = torch.full((h, w), -1)
    for number in part[~known].unique().tolist():
        own = (part == number) & known
        if number < 0 or not bool(own.any()):
            continue
        distance, label = cv2.distanceTransformWithLabels(
            (~own).byte().numpy(), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        owner = np.full(int(label.max()) + 1, -1)
        flat = own.reshape(-1).nonzero()[:, 0].numpy()
        owner[label.reshape(-1)[flat]] = flat
        wanted = ((part == number) & ~known).numpy() & (distance <= reach * w)
        found[torch.from_numpy(wanted)] = torch.from_numpy(owner[label[wanted]])
    return found.reshape(-1)
