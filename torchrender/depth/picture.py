"""Pictures of depth images that show what kind of sample each pixel holds."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.checks import check_tensor
from torchrender.depth.kinds import SampleKinds
from torchrender.numerics.color import linear_from_srgb

COLORS = {
    "plain": (0.80, 0.80, 0.80),
    "redundant": (0.90, 0.30, 0.24),
    "hidden": (0.25, 0.52, 0.88),
    "useful": (0.20, 0.70, 0.33),
    "truncated": (0.95, 0.75, 0.10),
}
"""sRGB colour of each kind of sample; "hidden" are those that no view between the viewpoints needs."""

BACKGROUND = (1.0, 1.0, 1.0)


def kinds_picture(images: DepthImages, kinds: SampleKinds) -> Tensor:
    """Linear pictures (B,H,W,3): samples coloured by kind, shaded by how much they face their camera.

    Redundant samples are red (an earlier image of the set has them), hidden ones blue (no conventional image from the
    viewpoints has them) or green where they are useful (some view between the viewpoints needs them), the others grey.
    Pixels given up as truncated are yellow, empty ones white.
    """
    shape = tuple(images.triangle.shape)
    for name in ("redundant", "hidden", "useful"):
        check_tensor(name, getattr(kinds, name), shape)
    palette = linear_from_srgb(torch.tensor([*COLORS.values(), BACKGROUND]))
    names = list(COLORS)
    index = torch.full(shape, len(names))
    index[images.covered] = names.index("plain")
    for name, mask in (
        ("redundant", kinds.redundant),
        ("hidden", kinds.hidden),
        ("useful", kinds.useful),
        ("truncated", images.truncated),
    ):
        index[mask] = names.index(name)
    picture = palette[index]
    lit = images.covered
    picture[lit] *= _facing(images)[lit][:, None]
    return picture


def _facing(images: DepthImages) -> Tensor:
    """(B,H,W) between 0.3 at grazing angles and 1 where the surface faces the camera."""
    toward = images.cameras.eye[:, None, None, :] - images.position
    toward = torch.nn.functional.normalize(toward, dim=-1, eps=1e-30).float()
    return 0.3 + 0.7 * (toward * images.normal).sum(-1).clamp(0.0, 1.0)
