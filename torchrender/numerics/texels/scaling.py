"""Pictures at another size, with the same numbers for any number of threads."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def scaled_bilinearly(planes: Tensor, size: Sequence[int], *, align_corners: bool = False) -> Tensor:
    """(B,C,H,W) -> (B,C,h,w); differentiable.

    Each channel is a picture of its own: with one thread PyTorch takes another kernel for one picture of three
    channels, which differs in the last bits.
    """
    count, channels, height, width = planes.shape
    alone = planes.reshape(count * channels, 1, height, width)
    scaled = torch.nn.functional.interpolate(alone, tuple(size), mode="bilinear", align_corners=align_corners)
    return scaled.reshape(count, channels, *size)
