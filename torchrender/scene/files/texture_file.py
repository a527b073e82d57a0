"""Pictures that mesh files name: where they are, and the shape that materials want."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from torchrender.errors import TorchRenderWarning


class MissingTextureWarning(TorchRenderWarning):
    """A mesh file names a picture or material file that cannot be read; the plain colour is used instead."""


def find_beside(path: Path, name: str) -> Path:
    """The file of that name beside ``path``; where there is none, one of its last part, in any case of letters.

    Files are often written on another machine: they name their pictures by whole paths, or in other letters.
    """
    named = path.parent / name.replace("\\", "/")
    try:
        if named.is_file():
            return named
        last = named.name.lower()
        for folder in dict.fromkeys((named.parent, path.parent)):
            found = sorted(f for f in folder.iterdir() if f.name.lower() == last) if folder.is_dir() else []
            if found:
                return found[0]
    except (OSError, ValueError):  # no name at all: too long, or with bytes that names do not have
        pass
    return named


def as_texture(image: Tensor) -> Tensor:
    """(H,W,3|4) from a picture (H,W,C) of 1 to 4 channels: grey is repeated."""
    if image.shape[2] <= 2:
        return torch.cat([image[..., :1].expand(-1, -1, 3), image[..., 1:]], dim=-1)
    return image
