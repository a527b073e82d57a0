"""What touches a reflector, where rays that leave it would begin beyond that.

Rays start a little off the reflector, as its place is known to so much. Where a floor meets a mirror they would start
below the floor, and see the inside of what it belongs to, or what lies behind.
"""

from __future__ import annotations

from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.rays import RayCaster

ROUNDING = 5e-7
"""Of the greatest coordinate: a face whose plane holds the origin but for this is the reflector itself."""


def with_contacts(caster: RayCaster, origins: Tensor, directions: Tensor, starts: Tensor, hits: RayHits) -> RayHits:
    """First hits of N rays from ``starts`` (N,) on, and in place of those that tell of a face that was passed before,
    a back face or none at all, the front of the face between origin and start, if there is one.

    Args:
        origins, directions: (N,3) float64, on reflectors; unit.
    """
    normals = caster.geometry.face_normals
    if not len(normals):
        return hits
    facing = (directions * normals[hits.triangle.clamp_min(0)].double()).sum(-1)
    doubt = ((hits.triangle < 0) | (facing > 0)).nonzero().reshape(-1)
    if not len(doubt):
        return hits
    origin, toward = origins[doubt], directions[doubt]
    near = caster.first_hit(origin, toward, t_max=starts[doubt], cull_backfaces=True)
    off = -near.t * (toward * normals[near.triangle.clamp_min(0)].double()).sum(-1)
    passed = (near.triangle >= 0) & (off > ROUNDING * origin.abs().amax(-1))
    rows = doubt[passed]
    if not len(rows):
        return hits
    return RayHits(
        hits.t.index_copy(0, rows, near.t[passed]),
        hits.triangle.index_copy(0, rows, near.triangle[passed]),
        hits.barycentric.index_copy(0, rows, near.barycentric[passed]),
    )
