"""Layers of surfaces that show what lies behind, from front to back, blended over a picture.

Layers come from the rasteriser by depth peeling (Everitt, *Interactive order-independent transparency*, 2001), which
needs no order of triangles, or from rays that go on where they were let through.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits
from torchrender.checks import check_range
from torchrender.effects.transparency.passing import passing_light
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

DARK = 1e-3
"""What lets less light pass than this hides everything behind it."""


class LayerShader(Protocol):
    """Light of the surfaces that rays of the eye meet."""

    def __call__(self, origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
        """Radiance (N,3) towards the origins of rays (N,3) of unit direction, ``width`` (N,) wide at their hits."""


@dataclass(frozen=True, eq=False)
class Transparency:
    """What lies before the solid surfaces of B pictures: ``radiance behind * passing + radiance``."""

    radiance: Tensor  # (B,H,W,3) of all layers, as far as those before let it pass
    passing: Tensor  # (B,H,W,3) share of the light behind all layers
    layers: Tensor  # (B,H,W) int64 surfaces before each other


@dataclass(frozen=True, eq=False)
class Layer:
    """The surfaces of one layer that N pixels see."""

    pixel: Tensor  # (N,) int64 flat place in (B,H,W)
    hits: RayHits  # t is the ray length


def transparency(
    scene: Scene, gbuffer: GBuffer, shader: LayerShader, *, layers: int = 64, traced: bool = False
) -> Transparency:
    """Everything that shows what lies behind, before the solid surfaces of a G-buffer.

    Args:
        shader: light of the layers' surfaces.
        layers: surfaces before each other that are looked at, at most; what lies behind the last one still shows.
        traced: by rays, instead of by peeling.

    Raises:
        OptionError: ``layers`` below 1.
    """
    check_range("layers", layers, 1, 4096)
    cameras, shape = gbuffer.cameras, tuple(gbuffer.depth.shape)
    origins, directions = (rays.reshape(-1, 3) for rays in cameras.rays())
    lengths = directions.norm(dim=-1)
    directions = directions / lengths[:, None]
    radiance, passing = torch.zeros(len(lengths), 3), torch.ones(len(lengths), 3)
    number = torch.zeros(len(lengths), dtype=torch.int64)
    footprint = cameras.footprint(torch.ones(len(cameras), 1, dtype=torch.float64)).reshape(-1)
    limit = gbuffer.depth.reshape(-1).double() * lengths
    panes = scene.geometry.panes
    found = _traced(panes, origins, directions, limit) if traced else _peeled(panes, cameras, limit, lengths)
    for _, layer in zip(range(layers), found, strict=False):
        shows = passing[layer.pixel].amax(dim=1) > DARK
        pixel, hits = layer.pixel[shows], layer.hits
        hits = RayHits(hits.t[shows], hits.triangle[shows], hits.barycentric[shows])
        if not len(pixel):
            break
        o, d = origins[pixel], directions[pixel]
        camera = pixel // (shape[1] * shape[2])
        depth = torch.ones_like(hits.t) if cameras.orthographic else hits.t / lengths[pixel]
        width = footprint[camera] * depth
        covers, behind = passing_light(scene, o, d, hits, width)
        radiance[pixel] += passing[pixel] * covers[:, None] * shader(o, d, width, hits)
        passing[pixel] *= behind
        number[pixel] += 1
    return Transparency(radiance.reshape(*shape, 3), passing.reshape(*shape, 3), number.reshape(shape))


def _peeled(panes: Geometry, cameras: Cameras, limit: Tensor, lengths: Tensor) -> Iterator[Layer]:
    tests = None
    while True:
        seen = rasterize_visibility(panes, cameras, tests=tests)
        length = seen.depth.reshape(-1).double() * lengths
        pixel = ((seen.triangle.reshape(-1) >= 0) & (length < limit)).nonzero().reshape(-1)
        if not len(pixel):
            return
        hits = RayHits(length[pixel], seen.triangle.reshape(-1)[pixel], seen.barycentric.reshape(-1, 2)[pixel])
        yield Layer(pixel, hits)
        tests = FragmentTests(beyond=seen.depth, skip=seen.triangle)


def _traced(panes: Geometry, origins: Tensor, directions: Tensor, limit: Tensor) -> Iterator[Layer]:
    caster = RayCaster(panes)
    pixel = torch.arange(len(origins))
    hits = caster.first_hit(origins, directions, t_max=limit)
    while True:
        kept = hits.hit.nonzero().reshape(-1)
        if not len(kept):
            return
        pixel = pixel[kept]
        hits = RayHits(hits.t[kept], hits.triangle[kept], hits.barycentric[kept])
        yield Layer(pixel, hits)
        hits = caster.next_hit(origins[pixel], directions[pixel], hits.t, hits.triangle, t_max=limit[pixel])


def deepest_layers(scene: Scene, cameras: Cameras, *, most: int = 64, size: int = 96) -> int:
    """How many see-through surfaces lie before each other at most, solids left out, in small views of these cameras."""
    if not len(cameras):
        return 0
    small = cameras.scaled(min(1.0, size / max(cameras.width, cameras.height)))
    shape = (len(small), small.height, small.width)
    limit = torch.full((shape[0] * shape[1] * shape[2],), torch.inf, dtype=torch.float64)
    found = _peeled(scene.geometry.panes, small, limit, torch.ones_like(limit))
    return sum(1 for _ in zip(range(most), found, strict=False))
