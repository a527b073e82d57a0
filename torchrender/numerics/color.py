"""sRGB transfer functions (IEC 61966-2-1) and luminance (ITU-R BT.709). Alpha is not a colour: leave it out."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.errors import InputError

LUMINANCE_WEIGHTS = (0.2126, 0.7152, 0.0722)
"""Share of red, green and blue in the luminance of linear RGB with BT.709 primaries."""

_LINEAR_KNEE = 0.0031308
_ENCODED_KNEE = 0.04045


def linear_from_srgb(encoded: Tensor) -> Tensor:
    """Linear light from sRGB values in [0,1], any shape: ``v/12.92`` below 0.04045, else ``((v+0.055)/1.055)^2.4``.

    Values above one follow the same curve; negative values are mirrored, so that the function stays invertible.
    """
    size = encoded.abs()
    # The clamp keeps the unused branch's gradient finite.
    curve = ((size.clamp_min(_ENCODED_KNEE) + 0.055) / 1.055) ** 2.4
    return torch.copysign(torch.where(size <= _ENCODED_KNEE, size / 12.92, curve), encoded)


def srgb_from_linear(linear: Tensor) -> Tensor:
    """sRGB values from linear light, any shape; the inverse of :func:`linear_from_srgb`."""
    size = linear.abs()
    curve = 1.055 * size.clamp_min(_LINEAR_KNEE) ** (1 / 2.4) - 0.055
    return torch.copysign(torch.where(size <= _LINEAR_KNEE, size * 12.92, curve), linear)


def luminance(linear: Tensor) -> Tensor:
    """BT.709 luminance (...,) of linear RGB (...,3).

    Raises:
        InputError: the last dimension is not 3.
    """
    if linear.dim() == 0 or linear.shape[-1] != 3:
        raise InputError(f"linear must have shape (..., 3), got {tuple(linear.shape)}")
    return linear @ torch.tensor(LUMINANCE_WEIGHTS, dtype=linear.dtype, device=linear.device)


def srgb_table(bits: int) -> Tensor:
    """(2^bits,) float32: linear light of every code of an 8- or 16-bit sRGB picture."""
    if bits not in (8, 16):
        raise InputError(f"bits must be 8 or 16, got {bits}")
    codes = torch.arange(2**bits, dtype=torch.float64) / (2**bits - 1)
    return linear_from_srgb(codes).float()
