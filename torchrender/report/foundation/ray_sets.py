"""Rays as pictures need them: from the camera, in all directions from what it sees, mirrored, and towards a light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, RectLight, vectors_to
from torchrender.scene.model import Scene

KINDS = ("primary", "diffuse", "reflection", "shadow")
_START = 1e-5  # of the diagonal: rays leave the surface by this
_GAP = 1e-4  # of the diagonal: shadow rays start and end so far from surfaces


@dataclass(frozen=True, kw_only=True)
class RaySet:
    """Rays of one kind, in the order of the image's rows."""

    origins: Tensor  # (N,3) float64
    directions: Tensor  # (N,3) float64
    t_min: float
    t_max: float
    any_hit: bool


def ray_sets(scene: Scene, caster: RayCaster, side: int, seed: int = 1) -> dict[str, RaySet]:
    """side² rays of each kind; those that start on surfaces are drawn from the visible points with repetition."""
    camera = scene.camera(width=side, height=side)
    eyes, views = (a.reshape(-1, 3).double().contiguous() for a in camera.rays())
    near = float(camera.near[0])
    hits = caster.first_hit(eyes, views, t_min=near)
    generator = torch.Generator().manual_seed(seed)
    seen = hits.hit.nonzero().reshape(-1)
    rows = seen[torch.randint(len(seen), (side * side,), generator=generator).sort().values]
    views_at, points = views[rows], eyes[rows] + hits.t[rows, None] * views[rows]
    corners = scene.geometry.vertices[scene.geometry.faces[hits.triangle[rows]].long()]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = torch.nn.functional.normalize(normals, dim=1, eps=0.0)
    along = (normals * views_at).sum(1, keepdim=True)
    normals, along = -torch.sign(along) * normals, -along.abs()
    ball = torch.nn.functional.normalize(torch.randn(len(rows), 3, generator=generator, dtype=torch.float64), dim=1)
    light = scene.lights[0]
    starts = points + normals * _GAP * float(scene.diagonal)
    target = light.samples(1)[0] if isinstance(light, RectLight) else torch.zeros(3)
    toward = vectors_to(light, starts, target).double().contiguous()
    endless = isinstance(light, DirectionalLight)
    end = math.inf if endless else 1.0 - _GAP * float(scene.diagonal) / float(toward.norm(dim=1).max())
    start = _START * float(scene.diagonal)
    return {
        "primary": RaySet(origins=eyes, directions=views, t_min=near, t_max=math.inf, any_hit=False),
        "diffuse": _leaving(points, ball + (1 + 1e-6) * normals, start),
        "reflection": _leaving(points, views_at - 2 * along * normals, start),
        "shadow": RaySet(origins=starts, directions=toward, t_min=0.0, t_max=end, any_hit=True),
    }


def _leaving(points: Tensor, directions: Tensor, start: float) -> RaySet:
    unit = directions.contiguous()
    return RaySet(origins=points.contiguous(), directions=unit, t_min=start, t_max=math.inf, any_hit=False)
