"""What rays hit, with all that shading needs: the ray caster's counterpart of a G-buffer."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import RayHits, RaySurface
from torchrender.checks import check_tensor
from torchrender.scene.model import Scene
from torchrender.shading.attributes import CastRays, hit_surface


def ray_surface(
    scene: Scene, origins: Tensor, directions: Tensor, hits: RayHits, width: Tensor | float = 0.0
) -> RaySurface:
    """Surface attributes at the first hits of N rays.

    Args:
        origins, directions: (N,3) as cast, any length.
        hits: what they hit in the same scene's geometry.
        width: number or (N,), width of each ray at its hit in scene units: sets the texture footprint.

    Raises:
        InputError: shapes that do not fit.
    """
    count = len(hits.triangle)
    check_tensor("origins", origins, (count, 3))
    check_tensor("directions", directions, (count, 3))
    widths = torch.as_tensor(width, dtype=torch.float64).expand(count)
    return hit_surface(scene.geometry, CastRays(origins, directions, hits, widths))
