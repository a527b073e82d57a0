"""Tangents of a scene's triangles, where these have normal maps."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.numerics import tangents
from torchrender.scene.material import Material
from torchrender.scene.mesh import Geometry


def normal_map_set(material: Material) -> int:
    """The texture coordinates that a normal map follows, -1 without one."""
    return -1 if material.normal_texture is None else material.sampler("normal_texture").uv_set


def with_tangents(geometry: Geometry, uv_set: Tensor) -> Geometry:
    """The same with tangents of the triangles where ``uv_set`` (F,) says whose texture coordinates they follow.

    0 and 1 are the sets, -1 stands for triangles that need no tangents.
    """
    chosen = (uv_set >= 0).nonzero().reshape(-1)
    if not len(chosen):
        return geometry
    faces = geometry.faces[chosen].long()
    flat = geometry.face_normals[chosen][:, None].expand(-1, 3, 3)
    normal = flat if geometry.normals is None else geometry.normals[faces]
    normal = torch.where(normal.square().sum(-1, keepdim=True) > 0, normal, flat).double()
    none = torch.zeros(len(geometry.vertices), 2)
    first, second = (none if uv is None else uv for uv in (geometry.uv, geometry.uv1))
    uv = torch.where((uv_set[chosen] == 0)[:, None, None], first[faces], second[faces])
    given = torch.zeros(len(chosen), 3, 4) if geometry.tangents is None else geometry.tangents[faces]
    unit = torch.nn.functional.normalize(normal, dim=-1, eps=1e-30)
    corners = tangents.tangents_of(tangents.Corners(geometry.vertices[faces], unit, uv.double(), given.double()))
    row = torch.full((geometry.triangle_count,), -1, dtype=torch.int32)
    row[chosen] = torch.arange(len(chosen), dtype=torch.int32)
    made = replace(geometry, tangent_table=tangents.TangentTable(row, corners))
    known = {name: value for name, value in vars(geometry).items() if name not in made.__dataclass_fields__}
    made.__dict__.update(known)  # the same triangles: what was found out about them holds
    return made
