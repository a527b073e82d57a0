"""The answers of clusters' depth images become colours, many rays at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.clock import StepClock
from torchrender.effects.reflections.clusters.images import ClusterAnswer
from torchrender.effects.reflections.clusters.options import ClusterOptions
from torchrender.effects.reflections.glossy import mean_distance
from torchrender.effects.reflections.reflectors import (
    Onward,
    RayShader,
    ReflectedRays,
    ReflectivePixels,
    lobe_rays,
    reflected_rays,
)
from torchrender.kernels.rays.depth_march import UNKNOWN
from torchrender.kernels.reflections.layer_march import UNSURE
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene

NEAREST_FAR_PLANE = 0.05  # scene diagonals
FADE = 0.4  # share of the far plane's distance over which glossy reflections fade
FULL_FADE_GLOSS = 0.1  # less gloss fades less, to be continuous with mirrors, which do not
RAYS = 1 << 19
"""Rays that are shaded together: bounds the memory of their hits."""


@dataclass(frozen=True, eq=False)
class Question:
    """The rays of one cluster, ``per_pixel`` for each of its pixels, and what they met."""

    rows: Tensor  # (M,) pixels
    per_pixel: int
    rays: ReflectedRays
    answer: ClusterAnswer
    weight: Tensor  # (M per_pixel,) of what the rays bring
    itself: Tensor  # (M per_pixel,) bool: takes the reflector's own colour
    unsure: Tensor  # (M per_pixel,) bool: what was met may not be the first
    painted: Tensor | None = None  # (M per_pixel,3) colours out of the depth image itself, NaN where there is none

    @classmethod
    def plain(cls, rows: Tensor, rays: ReflectedRays, answer: ClusterAnswer, weight: Tensor) -> Question:
        """Of rays that all take the colour of what they meet."""
        count = len(rays.origin) // max(len(rows), 1)
        nobody = torch.zeros(len(rays.origin), dtype=torch.bool)
        return cls(rows, count, rays, answer, weight, nobody, answer.state == UNSURE)


def bundles(
    pixels: ReflectivePixels, members: Tensor, options: ClusterOptions
) -> Iterator[tuple[Tensor, ReflectedRays, Tensor]]:
    """Rays of some pixels, mirrors and glossy ones apart: pixels (M,), rays (M k), weights of what they bring."""
    glossy = pixels.gloss[members] > 0
    rows = members[~glossy]
    if len(rows):
        yield rows, reflected_rays(pixels.select(rows)), torch.ones(len(rows))
    rows = members[glossy]
    if len(rows):
        yield rows, *lobe_rays(pixels.select(rows), options.glossy_rays, options.lobe)


def ray_ends(pixels: ReflectivePixels, rays: ReflectedRays, diagonal: float, options: ClusterOptions) -> Tensor:
    """Lengths (M k) at which the rays of M pixels reach the far plane, or have crossed the scene."""
    count = len(rays.origin) // max(len(pixels), 1)
    reach = far_plane(pixels.gloss, diagonal, options).repeat_interleave(count)
    climb = (rays.direction * pixels.geometric_normal.repeat_interleave(count, 0)).sum(-1)
    return torch.where(climb > 0, reach / climb.clamp_min(1e-9), diagonal).clamp_max(diagonal)


def far_plane(gloss: Tensor, diagonal: float, options: ClusterOptions) -> Tensor:
    """Height (N,) over the reflector up to which it is reflected: the rougher, the nearer."""
    return diagonal * (1.0 - gloss * options.fade).clamp_min(NEAREST_FAR_PLANE)


class Shading:
    """Collects the answers of clusters and gives many rays their colour at once."""

    def __init__(
        self,
        scene: Scene,
        pixels: ReflectivePixels,
        shader: RayShader,
        options: ClusterOptions,
        caster: Callable[[], RayCaster] | None,
        own: Tensor,
        onward: Onward | None,
    ) -> None:
        self.clock = StepClock()
        self._scene, self._pixels, self._shader, self._options = scene, pixels, shader, options
        self._caster, self._own, self._onward = caster, own, onward
        self._waiting: list[Question] = []
        self._count = 0
        self.color = torch.zeros(len(pixels), 3)
        self.distance = torch.full((len(pixels),), torch.inf)
        self.unknown, self.traced = torch.zeros(len(pixels)), torch.zeros(len(pixels))

    def add(self, question: Question) -> None:
        """Take the answer of one cluster."""
        self._waiting.append(question)
        self._count += len(question.itself)
        if self._count >= RAYS:
            self.flush()

    def flush(self) -> None:
        """Shade everything taken so far."""
        if self._count:
            with self.clock.measure("shading"):
                self._shade()

    def _shade(self) -> None:
        waiting, self._waiting, self._count = self._waiting, [], 0
        names = ("origin", "direction", "width", "spread")
        sent = {name: torch.cat([getattr(q.rays, name) for q in waiting]) for name in names}
        rays = ReflectedRays(**sent, many=all(q.rays.many for q in waiting))
        hits = RayHits(
            *(torch.cat([getattr(q.answer.hits, n) for q in waiting]) for n in ("t", "triangle", "barycentric"))
        )
        unknown = torch.cat([q.answer.state for q in waiting]) == UNKNOWN
        if self._traces:
            unknown |= torch.cat([q.unsure for q in waiting])
        pixel = torch.cat([q.rows.repeat_interleave(q.per_pixel) for q in waiting])
        color, hits = self._radiance(rays, hits, unknown)
        if any(q.painted is not None for q in waiting):
            painted = torch.cat([_painted(q) for q in waiting])
            color = torch.where(torch.isfinite(painted) & ~(unknown & self._traces)[:, None], painted, color)
        itself = torch.cat([q.itself for q in waiting])
        color = torch.where(itself[:, None], self._own[pixel], color)
        color = color * torch.cat([q.weight for q in waiting]).float()[:, None]
        if self._options.fade:
            color = self._faded(color, rays, hits, pixel)
        begin = 0
        for q in waiting:
            part = slice(begin, begin + len(q.itself))
            begin += len(q.itself)
            self.color[q.rows] = color[part].reshape(-1, q.per_pixel, 3).mean(dim=1)
            self.distance[q.rows] = mean_distance(hits.t[part].reshape(-1, q.per_pixel))
            self.unknown[q.rows] = unknown[part].reshape(-1, q.per_pixel).float().mean(dim=1)
        if self._traces:
            self.traced[pixel[unknown]] = 1.0

    @property
    def _traces(self) -> bool:
        return self._caster is not None and self._options.missing == "trace"

    def _radiance(self, rays: ReflectedRays, hits: RayHits, unknown: Tensor) -> tuple[Tensor, RayHits]:
        """Colour (N,3) of rays, and hits with those that were looked for by the ray caster."""
        rows = unknown.nonzero().reshape(-1)
        if not len(rows):
            return self._shader(rays, hits, self._onward), hits
        if self._traces and self._caster is not None:
            found = rays.select(rows).first_hits(self._caster())
            hits = RayHits(
                hits.t.index_copy(0, rows, found.t),
                hits.triangle.index_copy(0, rows, found.triangle),
                hits.barycentric.index_copy(0, rows, found.barycentric),
            )
            return self._shader(rays, hits, self._onward), hits
        color = self._shader(rays, hits, self._onward)
        eyes = self._pixels.cameras.eye
        return color.index_copy(0, rows, self._shader.surroundings(rays.origin[rows], rays.direction[rows], eyes)), hits

    def _faded(self, color: Tensor, rays: ReflectedRays, hits: RayHits, pixel: Tensor) -> Tensor:
        """Glossy colours (N,3), fading to the pixel's own towards the far plane (specification 03, section 8)."""
        gloss = self._pixels.gloss[pixel]
        if not bool((gloss > 0).any()):
            return color
        far = far_plane(gloss, self._scene.diagonal, self._options)
        height = hits.t * (rays.direction * self._pixels.geometric_normal[pixel]).sum(-1)
        weight = ((far - height) / (FADE * far)).clamp(0.0, 1.0)
        weight = 1.0 - (gloss / FULL_FADE_GLOSS).clamp_max(1.0) * (1.0 - torch.where(hits.hit, weight, 0.0))
        return torch.lerp(self._own[pixel], color, weight.float()[:, None])


def _painted(question: Question) -> Tensor:
    """(M per_pixel,3) its painted colours, NaN where it has none."""
    if question.painted is not None:
        return question.painted
    return torch.full((len(question.itself), 3), torch.nan)
