"""What rays hit, with all that shading needs: the ray caster's counterpart of a G-buffer."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import RayHits, RaySurface
from torchrender.checks import check_tensor
from torchrender.kernels.raster.attributes import Hits, Rays, Surface, interpolate_hits
from torchrender.raster import attribute_arrays, empty_attributes
from torchrender.scene.model import Scene


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
    made = empty_attributes((count,))
    widths = torch.as_tensor(width, dtype=torch.float64).expand(count)
    rays = Rays(view(origins, np.float64), view(directions, np.float64), view(widths, np.float64))
    found = Hits(view(hits.t, np.float64), view(hits.triangle, np.int64), view(hits.barycentric, np.float32))
    interpolate_hits(attribute_arrays(scene.geometry), rays, found, Surface(*made.values()))
    to_eye = -torch.nn.functional.normalize(directions.double(), dim=-1, eps=1e-30).float()
    return RaySurface(to_eye=to_eye, **{name: torch.from_numpy(value) for name, value in made.items()})
