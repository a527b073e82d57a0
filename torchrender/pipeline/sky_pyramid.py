"""An environment at several resolutions: wide rays bring the mean of what they spread over."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.scene.environment import Environment

SMALLEST = 4
"""Rows of the coarsest picture."""


@dataclass(frozen=True, eq=False)
class SkyPyramid:
    """The same environment in pictures of half the rows each."""

    levels: tuple[Environment, ...]

    @classmethod
    def of(cls, environment: Environment) -> SkyPyramid:
        """Each picture holds the means of the one before, weighted by how much of the sphere a row takes."""
        levels = [environment]
        picture = environment.radiance
        while picture.shape[0] % 2 == 0 and picture.shape[1] % 2 == 0 and picture.shape[0] > SMALLEST:
            height, width, _ = picture.shape
            polar = (torch.arange(height, dtype=picture.dtype) + 0.5) * math.pi / height
            weight = torch.sin(polar).reshape(height // 2, 2, 1, 1, 1)
            parts = picture.reshape(height // 2, 2, width // 2, 2, 3)
            picture = (parts * weight).sum(dim=(1, 3)) / (2.0 * weight.sum(dim=(1, 3)))
            levels.append(replace(environment, radiance=picture))
        return cls(tuple(levels))

    def lookup(self, direction: Tensor, spread: Tensor) -> Tensor:
        """Radiance (N,3) along unit directions (N,3) of rays that are ``spread`` (N,) radians wide."""
        direction = direction.float()
        texel = math.pi / self.levels[0].radiance.shape[0]
        level = torch.log2((spread.float() / texel).clamp_min(1.0)).clamp_max(len(self.levels) - 1.0)
        low = level.long()
        found = torch.zeros(len(direction), 3)
        for number in low.unique().tolist():
            rows = (low == number).nonzero().reshape(-1)
            value = self.levels[number].lookup(direction[rows])
            part = level[rows] - number
            if number + 1 < len(self.levels) and bool((part > 0).any()):
                value = torch.lerp(value, self.levels[number + 1].lookup(direction[rows]), part[:, None])
            found[rows] = value
        return found
