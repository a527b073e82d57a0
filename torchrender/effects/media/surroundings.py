"""Light from everywhere, and light that media give off themselves.

Surroundings reach every place as if nothing stood in their way; what a medium gives off is absorption times its own
radiance. Either is the same all along a ray, so that a ray's share is what the medium holds back of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.media.between import NOWHERE, between
from torchrender.effects.media.eye_rays import EyeRays
from torchrender.effects.media.light_images import NO_IMAGES, NO_SLICES
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.phase import scattered_surroundings
from torchrender.effects.media.tables import NOTHING, MediaTable
from torchrender.kernels.media.integrate import EVERYWHERE, scatter_rays
from torchrender.kernels.media.records import AMBIENT, LIGHT_NUMBERS, Scattered, Source
from torchrender.scene.environment import Environment
from torchrender.scene.sky.harmonics import environment_bands

ROWS = 32
"""Rows of the picture that an environment's bands are found from."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Radiance from everywhere in bands 0 to 2 of spherical harmonics."""

    coefficients: Tensor  # (9,3)

    @classmethod
    def of(cls, ambient: Tensor, environment: Environment | None) -> Surroundings | None:
        """Of a scene's ambient light (3,) and environment; None where it is dark."""
        bands = torch.zeros(9, 3)
        bands[0] = ambient.float() * math.sqrt(4.0 * math.pi)
        if environment is not None:
            bands += environment_bands(environment, ROWS).float()
        return cls(bands) if bool((bands != 0).any()) else None


def glow(
    table: MediaTable, rays: EyeRays, surroundings: Surroundings | None, ways: Tensor, options: ScatterOptions
) -> Tensor | None:
    """Radiance (H W,3) that media send to the eye of their surroundings' light, and of their own; None: none.

    Args:
        ways: (H W,M) integrals of the media's densities along the rays.
    """
    total = None
    direction = torch.from_numpy(rays.beams.direction)
    for number, medium in enumerate(table.media):
        given = (medium.absorption * medium.emission).expand(1, 3)
        if surroundings is not None and options.environment and bool((medium.scattering > 0).any()):
            coefficients = surroundings.coefficients
            if medium.asymmetry == 0.0:
                mean = coefficients[0] / math.sqrt(4.0 * math.pi)
                given = given + medium.scattering * mean
            else:
                given = given + medium.scattering * scattered_surroundings(coefficients, direction, medium.asymmetry)
        if bool((given > 0).any()):
            part = given * _held_back(table, number, rays, ways, options)
            total = part if total is None else total.add_(part)
    return total


def _held_back(table: MediaTable, number: int, rays: EyeRays, ways: Tensor, options: ScatterOptions) -> Tensor:
    """(H W,3) integral of density times transmittance along each ray, of one medium among all."""
    if len(table) == 1:
        extinction = table.extinction[0]
        lost = ways * extinction
        return torch.where(lost > 1e-6, -torch.expm1(-lost) / extinction.clamp_min(1e-30), ways)
    channels = table.arrays.extinction.shape[1]
    strength = torch.zeros(len(table), channels)
    strength[number] = 1.0
    source = Source(np.zeros(LIGHT_NUMBERS, np.float32), NOTHING)
    settings = (AMBIENT, EVERYWHERE, options.panels * (2 if table.has_grid else 1), 8, np.float32(1.0))
    media = table.emitting(strength)

    def integrate(rows: np.ndarray, out: Scattered) -> None:
        scatter_rays(media, source, NO_IMAGES, NO_SLICES, rays.beams, rows, settings, out)

    found, _ = between(integrate, rays, rays.length, NOWHERE, channels, options)
    return torch.from_numpy(found).expand(len(ways), 3)
