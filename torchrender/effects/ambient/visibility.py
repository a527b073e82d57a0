"""What ambient visibility is made of."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

WHOLE = 2 / 3
"""Length of the mean of directions that are spread as the cosine, over the whole hemisphere."""


@dataclass(frozen=True, eq=False)
class AmbientVisibility:
    """How much of the light from everywhere reaches what B cameras see, and from where; 1 where nothing is seen."""

    sky: Tensor  # (B,H,W) in [0,1] cosine-weighted share of the hemisphere that nothing hides, however far
    near: Tensor  # (B,H,W) in [0,1] the same, where only what is within reach hides
    bent_normal: Tensor  # (B,H,W,3) unit mean direction of the open sky; the shading normal where none is


def as_images(covered: Tensor, sky: Tensor, near: Tensor, bent: Tensor, normal: Tensor) -> AmbientVisibility:
    """Values of covered pixels (N,) and (N,3) as images; bent directions of any length."""
    length = bent.norm(dim=-1, keepdim=True)
    unit = torch.where(length > 1e-6, bent / length.clamp_min(1e-6), normal[covered])
    images = torch.ones(covered.shape), torch.ones(covered.shape), normal.clone()
    for image, value in zip(images, (sky, near, unit), strict=True):
        image[covered] = value
    return AmbientVisibility(*images)
