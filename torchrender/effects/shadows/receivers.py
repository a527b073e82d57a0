"""Where shadows are looked up: on the smooth surface that the triangles of a mesh with vertex normals stand for.

Coarse triangles cut a smooth body where its light should fade: their own plane faces away from a light that the shading
normal still faces, and hides it. So points are moved out onto the planes that touch the smooth surface at the corners,
and these are asked for the light. Flat triangles, and those of hollows, stay where they are.

Source: Hanika, Hacking the shadow terminator, Ray Tracing Gems II, chapter 4, 2021.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.buffers import GBuffer, RaySurface
from torchrender.kernels.shading.simd import MOST_BENT
from torchrender.scene.mesh import Geometry

_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
FLAT = 1e-6
"""One minus the cosine between shading and geometric normal up to which a surface is flat."""


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
    position, flat, smooth = samples.position, samples.geometric_normal, samples.normal
    cosine = (smooth * flat).sum(-1)
    bent = (cosine < 1.0 - FLAT) & (cosine > float(MOST_BENT))
    rows = (bent & samples.covered).reshape(-1).nonzero().reshape(-1)
    if not len(rows):
        return position, flat
    facing = smooth.reshape(-1, 3).index_select(0, rows)
    place = position.reshape(-1, 3).index_select(0, rows)
    assert samples.triangle is not None and samples.barycentric is not None
    corners = geometry.faces[samples.triangle.reshape(-1)[rows]].long()
    weight = samples.barycentric.reshape(-1, 2).index_select(0, rows).double()
    moved = _on_touching_planes(geometry, corners, weight, place, facing.double())
    return (
        position.reshape(-1, 3).index_copy(0, rows, moved.to(position.dtype)).reshape(position.shape),
        flat.reshape(-1, 3).index_copy(0, rows, facing).reshape(flat.shape),
    )


def _on_touching_planes(geometry: Geometry, corners: Tensor, weight: Tensor, place: Tensor, facing: Tensor) -> Tensor:
    """Places (N,3) moved out onto the planes at the corners (N,3) of their triangles, by their weights (N,2)."""
    assert geometry.normals is not None
    shares = torch.cat([1.0 - weight.sum(-1, keepdim=True), weight], dim=-1)
    moved = place.double().clone()
    for k in range(3):
        normal = torch.nn.functional.normalize(geometry.normals[corners[:, k]].double(), dim=-1, eps=1e-30)
        outward = torch.where((normal * facing).sum(-1, keepdim=True) < 0, -normal, normal)
        below = ((place - geometry.vertices[corners[:, k]]) * outward).sum(-1, keepdim=True).clamp_max(0.0)
        moved = moved - shares[:, k : k + 1] * below * outward
    return moved
