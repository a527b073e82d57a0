"""What passes sense of a picture: cheap measures, from a part of its pixels, that errors of their settings follow.

All are mean absolute differences of display values (sRGB), as an eye would see what a setting changes.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.numerics.tonemap import auto_exposure, tone_map
from torchrender.pipeline.doubts import exposure_of
from torchrender.pipeline.frame import Frame

STRIPS, ROWS = 8, 16
"""Strips of a picture whose detail is measured, and rows of each."""

SIDE = 128
"""Pixels along each side, at most, of those that other measures take."""

EDGE = 0.02
"""A light of which less than this arrives, or is missing, counts as hidden or seen."""


def display(frame: Frame, radiance: Tensor, like: Tensor | None = None) -> Tensor:
    """Radiance as display values in [0,1]; ``like``: exposed as that, where exposure is automatic."""
    exposure = exposure_of(frame.scene, frame.options, quiet=True)
    if exposure is None:
        exposure = auto_exposure(radiance if like is None else like)
    return srgb_from_linear(tone_map(radiance, frame.options.tone_map, exposure=max(-64.0, min(64.0, exposure))))


def detail(frame: Frame, radiance: Tensor) -> tuple[float, float]:
    """How much neighbours differ in a picture (B,H,W,3), and what half as many pixels along each side would lose.

    Of ``STRIPS`` strips; where more or fewer pixels are rendered than the picture has, by as much more or less: edges
    take a share of the pixels that grows with their size.
    """
    height, width = radiance.shape[1:3]
    if height < 2 or width < 2:
        return 0.0, 0.0
    rows = min(ROWS, height // 2 * 2)
    count = max(1, min(STRIPS, height // rows))
    starts = [int((height - rows) * (i + 0.5) / count) for i in range(count)]
    strips = torch.cat([radiance[:, at : at + rows, : width // 2 * 2] for at in starts]).detach()
    shown = display(frame, strips, radiance.detach()).permute(0, 3, 1, 2)
    half = torch.nn.functional.avg_pool2d(shown, 2)
    again = scaled_bilinearly(half, shown.shape[2:])
    slope = (shown[..., 1:] - shown[..., :-1]).abs().mean() + (shown[..., 1:, :] - shown[..., :-1, :]).abs().mean()
    scale = frame.options.supersample
    return float(slope) * scale, float((shown - again).abs().mean()) * scale


def closely(name: str) -> str:
    """What a pass senses closely: the difference itself that a setting makes, in a few pixels."""
    return f"{name}, closely"


def roughly(name: str) -> str:
    """What is sensed in the place of a pass that is left out, until a picture runs it."""
    return f"{name}, roughly"


def beside(name: str) -> str:
    """What is sensed roughly in the very picture in which the pass itself sensed: what comes later is told by that."""
    return f"{name}, roughly, beside it"


def few(image: Tensor, side: int = SIDE) -> Tensor:
    """Pixels (B,h,w,...) at equal distances, up to ``side`` along each side, of an image (B,H,W,...)."""
    rows, columns = (max(1, -(-n // side)) for n in image.shape[1:3])
    return image[:, rows // 2 :: rows, columns // 2 :: columns]


def difference(frame: Frame, radiance: Tensor, other: Tensor, like: Tensor | None = None) -> float:
    """Mean absolute difference of two pictures' display values, both exposed as the first, or as ``like``."""
    whole = radiance.detach() if like is None else like.detach()
    return float((display(frame, radiance.detach(), whole) - display(frame, other.detach(), whole)).abs().mean())


def borders(frame: Frame, covered: Tensor, lights: Iterable[Tensor]) -> float:
    """Length of the borders of shadows, summed over the lights: pixels per pixel of the picture.

    How much more or less of a light the next pixel sees: a soft border counts as a hard one.
    """
    chosen, length = few(covered), 0.0
    pairs = [chosen[:, 1:] & chosen[:, :-1], chosen[:, :, 1:] & chosen[:, :, :-1]]
    steps = [max(1, -(-n // SIDE)) / frame.options.supersample for n in covered.shape[1:3]]
    for visibility in lights:
        part = few(visibility)
        changes = (part[:, 1:] - part[:, :-1]).abs(), (part[:, :, 1:] - part[:, :, :-1]).abs()
        length += sum(
            float((change * both).sum()) / (step * max(chosen.numel(), 1))
            for change, both, step in zip(changes, pairs, steps, strict=True)
        )
    return length


def partly_lit(covered: Tensor, lights: Iterable[Tensor], side: int = SIDE) -> float:
    """Share of the pixels (B,H,W) that see a part of a light, summed over the lights: borders of shadows."""
    chosen, share = few(covered, side), 0.0
    for visibility in lights:
        part = few(visibility, side)
        share += float(((part > EDGE) & (part < 1.0 - EDGE) & chosen).float().mean())
    return share
