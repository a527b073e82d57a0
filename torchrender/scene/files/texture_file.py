"""Pictures that mesh files name: the shape that materials want, and what to say where one is missing."""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
from torch import Tensor

from torchrender.errors import TorchRenderWarning


class MissingTextureWarning(TorchRenderWarning):
    """A mesh file names a picture or material file that cannot be read; the plain colour is used instead."""


def warn_missing_texture(path: Path, where: str, reason: str) -> None:
    """Say that a material goes without its picture."""
    warnings.warn(f"{path}: {where}: {reason}; the plain colour is used", MissingTextureWarning, stacklevel=2)


def as_texture(image: Tensor) -> Tensor:
    """(H,W,3|4) from a picture (H,W,C) of 1 to 4 channels: grey is repeated."""
    if image.shape[2] <= 2:
        return torch.cat([image[..., :1].expand(-1, -1, 3), image[..., 1:]], dim=-1)
    return image
