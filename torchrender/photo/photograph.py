"""Photos in working size: exposed, bounded, laid over a view."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_choice, check_finite
from torchrender.errors import InputError
from torchrender.numerics.color import luminance
from torchrender.photo.lab import lab_from_linear

MAX_PIXELS = 2**20
"""Larger photos are averaged down to this: a style needs no more, and colour statistics hardly change."""


class PhotoWarning(UserWarning):
    """Something in a photo is not used as it is."""


_HIGHLIGHT = 0.98
_HIGHLIGHT_VALUE = 0.9


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo in working size."""

    pixels: Tensor  # (H,W,3) float32 linear light in [0,1]
    width: int  # of the original, which regions refer to
    height: int

    def laid_over(self, width: int, height: int, place: str = "stretch") -> Tensor:
        """(height,width,3): the photo stretched to a view, or its middle in the view's shape ("crop").

        Raises:
            OptionError: another ``place``.
        """
        check_choice("place", place, ("stretch", "crop"))
        pixels = self.pixels
        if place == "crop":
            rows, columns = pixels.shape[:2]
            wide = max(1, min(columns, round(rows * width / height)))
            high = max(1, min(rows, round(columns * height / width)))
            top, left = (rows - high) // 2, (columns - wide) // 2
            pixels = pixels[top : top + high, left : left + wide]
        return resized(pixels, width, height)

    def region(self, box: Sequence[float]) -> Tensor:
        """(h,w,3) pixels within left, top, right, bottom, counted in pixels of the original photo.

        Raises:
            InputError: not four finite numbers, empty, or outside the photo.
        """
        try:
            values = [float(v) for v in box]
        except (TypeError, ValueError):
            values = []
        if len(values) != 4 or not all(np.isfinite(values)):
            raise InputError(f"a region must be left, top, right, bottom, got {box!r}")
        left, top, right, bottom = values
        if not (0 <= left < right <= self.width and 0 <= top < bottom <= self.height):
            raise InputError(
                f"a region must lie within the photo, 0 <= left < right <= {self.width} and"
                f" 0 <= top < bottom <= {self.height}, got {left:g}, {top:g}, {right:g}, {bottom:g}"
            )
        rows, columns = self.pixels.shape[:2]
        x, y = columns / self.width, rows / self.height
        first, above = min(int(left * x), columns - 1), min(int(top * y), rows - 1)
        last, below = max(first + 1, round(right * x)), max(above + 1, round(bottom * y))
        return self.pixels[above:below, first:last]

    @cached_property
    def lab(self) -> Tensor:
        """(N,3) float64 Lab of all pixels."""
        return lab_from_linear(self.pixels.reshape(-1, 3).double())


def prepare_photo(image: Tensor, name: str = "photo") -> Photo:
    """A photo from linear light (H,W,1..4), as :func:`~torchrender.images.files.read_image` gives it.

    Grey becomes RGB. Light above one (HDR) is exposed, brighter or darker, so that its brightest fiftieth lies above
    0.9, and clamped.
    Transparent parts are laid on white, with a warning.

    Raises:
        InputError: another shape, not a floating-point tensor, no pixels, or values that are negative or not finite.
    """
    if not isinstance(image, Tensor) or not image.is_floating_point():
        raise InputError(f"{name} must be a floating-point tensor (H, W, C), got {_kind(image)}")
    if image.requires_grad and torch.is_grad_enabled():
        raise InputError(f"{name} asks for gradients, which a style does not give: detach it")
    if image.dim() == 2:
        image = image[..., None]
    if image.dim() != 3 or image.shape[2] not in (1, 2, 3, 4) or image.numel() == 0:
        raise InputError(f"{name} must have shape (H, W), or (H, W, C) with C from 1 to 4, got {tuple(image.shape)}")
    height, width = int(image.shape[0]), int(image.shape[1])
    pixels = image.detach().float()
    check_finite(name, pixels)
    if height * width > MAX_PIXELS:
        scale = (MAX_PIXELS / (height * width)) ** 0.5
        pixels = resized(pixels, max(1, int(width * scale)), max(1, int(height * scale)))
    if pixels.shape[2] in (2, 4):
        pixels = _on_white(pixels, name)
    # Filters and colour conversions leave values a little below zero in HDR files.
    pixels = pixels.clamp_min(0.0)
    return Photo(_exposed(pixels.expand(-1, -1, 3)).contiguous(), width, height)


def resized(pixels: Tensor, width: int, height: int) -> Tensor:
    """(height,width,C) of (H,W,C): averaged where it shrinks, bilinear where it grows."""
    rows, columns, channels = pixels.shape
    if (columns, rows) == (width, height):
        return pixels
    # kornia's resize keeps no area average; a photo of 20 megapixels must not alias.
    shrinks = width < columns and height < rows
    kind = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    out = cv2.resize(pixels.contiguous().numpy(), (width, height), interpolation=kind)
    return torch.from_numpy(np.ascontiguousarray(out)).reshape(height, width, channels)


def _on_white(pixels: Tensor, name: str) -> Tensor:
    color, alpha = pixels[..., :-1], pixels[..., -1:].clamp(0.0, 1.0)
    if float(alpha.max()) == 0.0:
        warnings.warn(f"{name} is wholly transparent: its alpha is not used", PhotoWarning, stacklevel=4)
        return color
    if bool((alpha < 1.0).any()):
        warnings.warn(f"{name} is partly transparent: it is laid on white", PhotoWarning, stacklevel=4)
        color = color * alpha + (1.0 - alpha)
    return color


def _exposed(pixels: Tensor) -> Tensor:
    if float(pixels.max()) <= 1.0:
        return pixels
    bright = float(np.quantile(luminance(pixels).numpy(), _HIGHLIGHT))
    scale = _HIGHLIGHT_VALUE / bright if bright > 0 else 1.0
    return (pixels * scale).clamp(0.0, 1.0)


def _kind(value: object) -> str:
    return str(value.dtype) if isinstance(value, Tensor) else type(value).__name__
