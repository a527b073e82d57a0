"""CIE L*a*b* (D65, 2 degrees) of linear light, and back, on tensors whose last dimension is the colour."""

from __future__ import annotations

import torch
from kornia.color import rgb_to_xyz, xyz_to_rgb
from torch import Tensor

from torchrender.errors import InputError

WHITE = (0.95047, 1.0, 1.08883)
_KNEE = 6.0 / 29.0


def lab_from_linear(linear: Tensor) -> Tensor:
    """Lab (..., 3), L in [0,100], of linear RGB (..., 3); values are clamped to [0,1] as a picture file would do.

    Equal to kornia's ``rgb_to_lab`` of the sRGB-encoded picture, without encoding and decoding it, which takes thirty
    times longer than the rest.

    Raises:
        InputError: the last dimension is not 3.
    """
    if linear.dim() == 0 or linear.shape[-1] != 3:
        raise InputError(f"linear must have shape (..., 3), got {tuple(linear.shape)}")
    xyz = rgb_to_xyz(_planes(linear.clamp(0.0, 1.0))).reshape(3, -1)
    ratio = xyz / torch.tensor(WHITE, dtype=linear.dtype)[:, None]
    # The clamp keeps the unused branch's gradient finite.
    root = ratio.clamp_min(_KNEE**3).pow(1.0 / 3.0)
    f = torch.where(ratio > _KNEE**3, root, ratio / (3.0 * _KNEE**2) + 4.0 / 29.0)
    lab = torch.stack([116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])], dim=-1)
    return lab.reshape(linear.shape)


def linear_from_lab(lab: Tensor) -> Tensor:
    """Linear RGB (..., 3) of Lab (..., 3); colours outside the gamut come out below 0 or above 1.

    Raises:
        InputError: the last dimension is not 3.
    """
    if lab.dim() == 0 or lab.shape[-1] != 3:
        raise InputError(f"lab must have shape (..., 3), got {tuple(lab.shape)}")
    flat = lab.reshape(-1, 3)
    y = (flat[:, 0] + 16.0) / 116.0
    f = torch.stack([y + flat[:, 1] / 500.0, y, y - flat[:, 2] / 200.0])
    ratio = torch.where(f > _KNEE, f**3, 3.0 * _KNEE**2 * (f - 4.0 / 29.0))
    xyz = (ratio * torch.tensor(WHITE, dtype=lab.dtype)[:, None]).reshape(1, 3, -1, 1)
    return xyz_to_rgb(xyz)[0, :, :, 0].T.reshape(lab.shape)


def _planes(colors: Tensor) -> Tensor:
    """(1,3,N,1) as kornia wants it."""
    return colors.reshape(-1, 3).T.reshape(1, 3, -1, 1)
