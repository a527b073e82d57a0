"""What see-through surfaces leave of each light: partial shadows of glass."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits, RaySurface, position_error
from torchrender.effects.transparency.passing import passing_light
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, vectors_to
from torchrender.scene.model import Scene

MOST = 256
"""Surfaces that a ray to a light passes."""


def pane_shadow(scene: Scene, panes: RayCaster, light: Light, samples: GBuffer | RaySurface) -> Tensor:
    """Share (B,H,W) in [0,1] of a light that see-through surfaces let pass to each sample; 1 where nothing is seen.

    Args:
        panes: rays against :attr:`Geometry.panes`.
        light: of a rectangle, its centre.

    The share is the mean over the colours: a coloured pane casts a grey shadow.
    """
    covered = samples.covered
    points, normals = samples.position[covered].double(), samples.geometric_normal[covered].double()
    toward = vectors_to(light, points)
    side = torch.where((toward * normals).sum(-1, keepdim=True) >= 0, 1.0, -1.0)
    gap = position_error(samples, covered.reshape(-1).nonzero().reshape(-1))
    start = points + normals * side * gap[:, None]
    toward = vectors_to(light, start)
    limit = math.inf if isinstance(light, DirectionalLight) else 1.0
    share = torch.ones(len(points))
    rows = torch.arange(len(points))
    hits = panes.first_hit(start, toward, t_max=limit) if len(points) else RayHits.misses(0)
    for _ in range(MOST):
        kept = hits.hit.nonzero().reshape(-1)
        if not len(kept):
            break
        rows = rows[kept]
        hits = RayHits(hits.t[kept], hits.triangle[kept], hits.barycentric[kept])
        share[rows] *= passing_light(scene, start[rows], toward[rows], hits)[1].mean(dim=1)
        hits = panes.next_hit(start[rows], toward[rows], hits.t, hits.triangle, t_max=limit)
    image = torch.ones(covered.shape)
    image[covered] = share.clamp(0.0, 1.0)
    return image
