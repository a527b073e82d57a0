"""Where shadows are looked up: on the smooth surface that the triangles of a mesh with vertex normals stand for.

Coarse triangles cut a smooth body where its light should fade: their own plane faces away from a light that the shading
normal still faces, and hides it. So points are moved out onto the planes that touch the smooth surface at the corners,
and these are asked for the light. Flat triangles, and those of hollows, stay where they are.

Source: Hanika, Hacking the shadow terminator, Ray Tracing Gems II, chapter 4, 2021.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import view
from torchrender.buffers import GBuffer, RaySurface
from torchrender.kernels.shading.simd import MOST_BENT
from torchrender.kernels.shadows.receivers import move_out
from torchrender.scene.mesh import Geometry
from torchrender.shading.attributes import attribute_arrays

_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()


def shadow_receivers(samples: GBuffer | RaySurface) -> tuple[Tensor, Tensor]:
    """Positions (...,3) float64 and unit normals (...,3) by which samples ask for light.

    Those of the samples themselves where the shading normal is that of the triangle, or the samples were made by hand.
    """
    position, flat = samples.position, samples.geometric_normal
    geometry: Any = getattr(samples, "source", None)
    known = isinstance(geometry, Geometry) and samples.triangle is not None and samples.barycentric is not None
    if not known or geometry.normals is None:
        return position, flat
    if samples not in _KEPT:
        _KEPT[samples] = _smooth(samples, geometry)
    made: tuple[Tensor, Tensor] = _KEPT[samples]
    return made


def horizon_normals(samples: GBuffer | RaySurface) -> Tensor:
    """Unit normals (...,3) of the planes before which light must stand to be shaded, as shading has them."""
    cosine = (samples.normal * samples.geometric_normal).sum(-1, keepdim=True)
    return torch.where(cosine > float(MOST_BENT), samples.normal, samples.geometric_normal)


def _smooth(samples: GBuffer | RaySurface, geometry: Geometry) -> tuple[Tensor, Tensor]:
    position, flat = samples.position, samples.geometric_normal
    assert samples.triangle is not None and samples.barycentric is not None
    mesh = attribute_arrays(geometry)
    given = (view(position, np.float64).reshape(-1, 3), view(flat, np.float32).reshape(-1, 3))
    made = tuple(np.empty_like(value) for value in given)
    triangle = view(samples.triangle, np.int64).reshape(-1)
    weights = view(samples.barycentric, np.float32).reshape(-1, 2)
    move_out((mesh.vertices, mesh.faces, mesh.normals), triangle, weights, given, made)
    moved, facing = (torch.from_numpy(value) for value in made)
    return moved.reshape(position.shape).to(position.dtype), facing.reshape(flat.shape)
