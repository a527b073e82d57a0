"""What see-through surfaces leave of each light: partial shadows of glass."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits, RaySurface, position_error
from torchrender.effects.transparency.passing import passing_light
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, vectors_to
from torchrender.scene.model import Scene

MOST = 256
"""Surfaces that a ray to a light passes."""

RAYS = 1 << 17
"""To several lights, that go together: each look for hits costs its own."""

TOGETHER = 1 << 15
"""Hits, of one surface behind the other, from which on it is found out what these let pass."""


def pane_shadow(scene: Scene, panes: RayCaster, light: Light, samples: GBuffer | RaySurface) -> Tensor:
    """:func:`pane_shadows` (B,H,W) of one light; same arguments."""
    return pane_shadows(scene, panes, [light], samples)[:, 0]


def pane_shadows(scene: Scene, panes: RayCaster, lights: Sequence[Light], samples: GBuffer | RaySurface) -> Tensor:
    """Share (B,L,H,W) in [0,1] of each light that see-through surfaces let pass to samples; 1 where nothing is seen.

    Args:
        panes: rays against :attr:`Geometry.panes`.
        lights: L of them; of a rectangle, its centre.

    The share is the mean over the colours: a coloured pane casts a grey shadow.
    """
    covered = samples.covered
    images = torch.ones(len(lights), *covered.shape)
    points, normals = samples.position[covered].double(), samples.geometric_normal[covered].double()
    gap = position_error(samples, covered.reshape(-1).nonzero().reshape(-1))
    step = max(1, RAYS // max(1, len(points)))
    for first in range(0, len(lights), step):
        starts, towards, limits = [], [], []
        for light in lights[first : first + step]:
            side = torch.where((vectors_to(light, points) * normals).sum(-1, keepdim=True) >= 0, 1.0, -1.0)
            starts.append(points + normals * side * gap[:, None])
            towards.append(vectors_to(light, starts[-1]))
            limits.append(math.inf if isinstance(light, DirectionalLight) else 1.0)
        limit = torch.tensor(limits, dtype=torch.float64).repeat_interleave(len(points))
        share = _passed(scene, panes, torch.cat(starts), torch.cat(towards), limit)
        images[first : first + step, covered] = share.clamp(0.0, 1.0).reshape(len(limits), len(points))
    return images.transpose(0, 1).contiguous()


def _passed(scene: Scene, panes: RayCaster, start: Tensor, toward: Tensor, limit: Tensor) -> Tensor:
    """Share (N,) that all surfaces on the ways (N,3) let pass."""
    share, rows = torch.ones(len(start)), torch.arange(len(start))
    met: list[tuple[Tensor, RayHits]] = []
    hits = panes.first_hit(start, toward, t_max=limit) if len(start) else RayHits.misses(0)
    for _ in range(MOST):
        kept = hits.hit.nonzero().reshape(-1)
        if not len(kept):
            break
        rows = rows[kept]
        hits = RayHits(hits.t[kept], hits.triangle[kept], hits.barycentric[kept])
        met.append((rows, hits))
        if sum(len(own) for own, _ in met) >= TOGETHER:
            _dim(scene, share, (start, toward), met)
            met = []
        hits = panes.next_hit(start[rows], toward[rows], hits.t, hits.triangle, t_max=limit[rows])
    _dim(scene, share, (start, toward), met)
    return share


def _dim(scene: Scene, share: Tensor, ways: tuple[Tensor, Tensor], met: Sequence[tuple[Tensor, RayHits]]) -> None:
    """Multiply the shares (N,) of the ways by what the surfaces that they met let pass."""
    if not met:
        return
    rows = torch.cat([own for own, _ in met])
    hits = RayHits(*(torch.cat([getattr(one, f) for _, one in met]) for f in ("t", "triangle", "barycentric")))
    passing = passing_light(scene, ways[0][rows], ways[1][rows], hits)[1].mean(dim=1)
    for own, left in zip((own for own, _ in met), passing.split([len(own) for own, _ in met])):  # a way once in each
        share[own] *= left
