"""Layers of surfaces that show what lies behind, from front to back, blended over a picture.

Layers come from the rasteriser by depth peeling (Everitt, *Interactive order-independent transparency*, 2001), which
needs no order of triangles, or from rays that go on where they were let through.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from torchrender.buffers import SEEN, GBuffer, RayHits
from torchrender.checks import check_range
from torchrender.effects.transparency.passing import passing_light
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

START = 2.0**-8
"""Length at which rays that leave a surface start, in widths of the rays: what is seen from afar is known the less."""

TOGETHER = 1 << 15
"""Hits of several layers from which on these are shaded."""

DARK = 1e-3
"""What lets less light pass than this hides everything behind it."""


class LayerShader(Protocol):
    """Light of the surfaces that rays of the eye meet."""

    def __call__(self, origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
        """Radiance (N,3) towards the origins of rays (N,3) of unit direction, ``width`` (N,) wide at their hits."""


@dataclass(frozen=True, eq=False)
class Transparency:
    """What lies before the solid surfaces of B pictures: ``radiance behind * passing + radiance``."""

    radiance: Tensor  # (B,H,W,3) of all layers, as far as those before, and media, let it pass
    passing: Tensor  # (B,H,W,3) share of the light behind all layers
    layers: Tensor  # (B,H,W) int64 surfaces before each other


class Veil(Protocol):
    """What media put before places that pixels see."""

    def __call__(self, pixel: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        """Transmittance and scattered radiance, each (N,3), of ways (N,) long to the eyes of flat pixels (N,)."""


@dataclass(frozen=True, eq=False)
class Layer:
    """The surfaces of one layer that N of some rays meet."""

    pixel: Tensor  # (N,) int64 which rays: flat place in (B,H,W)
    hits: RayHits  # t is the ray length

    def among(self, chosen: Tensor) -> Layer:
        """Where ``chosen`` (N,) bool is set."""
        hits = self.hits
        return Layer(self.pixel[chosen], RayHits(hits.t[chosen], hits.triangle[chosen], hits.barycentric[chosen]))


class Rays(NamedTuple):
    """N rays through see-through surfaces; ``width + spread t`` wide at length t."""

    origin: Tensor  # (N,3)
    direction: Tensor  # (N,3) unit
    width: Tensor  # (N,)
    spread: Tensor  # (N,)
    picture: int  # rays of one picture, N or a part of it: those of different ones are shaded apart


def transparency(
    scene: Scene,
    gbuffer: GBuffer,
    shader: LayerShader,
    *,
    layers: int = 64,
    traced: bool = False,
    veil: Veil | None = None,
) -> Transparency:
    """Everything that shows what lies behind, before the solid surfaces of a G-buffer.

    Args:
        shader: light of the layers' surfaces.
        layers: surfaces before each other that are looked at, at most; what lies behind the last one still shows.
        traced: by rays, instead of by peeling.
        veil: media. Then the light behind, which ``passing`` is a share of, is seen through them already: of it that
            share of what they scatter is left, and each layer adds what it shows of its own, seen through them, and
            what it hides none of, as it is scattered before it.

    Raises:
        OptionError: ``layers`` below 1.
    """
    check_range("layers", layers, 1, 4096)
    cameras, shape = gbuffer.cameras, tuple(gbuffer.depth.shape)
    origins, directions = (rays.reshape(-1, 3) for rays in cameras.rays())
    lengths = directions.norm(dim=-1)
    size = shape[1] * shape[2]
    footprint = cameras.footprint(torch.ones(len(cameras), 1, dtype=torch.float64)).reshape(-1).repeat_interleave(size)
    none = torch.zeros_like(lengths)
    width, spread = (footprint, none) if cameras.orthographic else (none, footprint / lengths)
    rays = Rays(origins, directions / lengths[:, None], width, spread, size)
    limit = gbuffer.depth.reshape(-1).double() * lengths
    panes = scene.geometry.panes
    if traced:
        found = _traced(RayCaster(panes), rays.origin, rays.direction, limit)
    else:
        found = (_on_planes(panes, rays, layer) for layer in _peeled(panes, cameras, limit, lengths))
    radiance, passing, number = _blended(scene, rays, found, shader, layers, veil)
    return Transparency(radiance.reshape(*shape, 3), passing.reshape(*shape, 3), number.reshape(shape))


def layers_along(
    scene: Scene,
    panes: RayCaster,
    rays: Rays,
    limit: Tensor,
    shader: LayerShader,
    *,
    layers: int = 64,
) -> tuple[Tensor, Tensor]:
    """What see-through surfaces add to the light along N rays, and the share of it that they let pass, each (N,3).

    Args:
        panes: rays against :attr:`Geometry.panes`.
        limit: (N,) lengths at which what is solid lies; +inf for nothing.
        layers: surfaces before each other that are looked at, at most.
    """
    found = _traced(panes, rays.origin, rays.direction, limit, START * rays.width)
    return _blended(scene, rays, found, shader, layers, None)[:2]


def _blended(
    scene: Scene, rays: Rays, found: Iterator[Layer], shader: LayerShader, layers: int, veil: Veil | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Radiance and passing light (N,3) of layers over each other, and their number (N,)."""
    count = len(rays.origin)
    radiance, passing = torch.zeros(count, 3), torch.ones(count, 3)
    number = torch.zeros(count, dtype=torch.int64)
    veiled: list[tuple[Tensor, Tensor, Tensor, Tensor]] = []
    for batch in _batches(found, layers):
        kept = [layer.among(passing[layer.pixel].amax(dim=1) > DARK) for layer in batch]
        pixel = torch.cat([layer.pixel for layer in kept])
        if not len(pixel):
            break
        hits = RayHits(
            *(torch.cat([getattr(layer.hits, f) for layer in kept]) for f in ("t", "triangle", "barycentric"))
        )
        o, d = rays.origin[pixel], rays.direction[pixel]
        width = rays.width[pixel] + rays.spread[pixel] * hits.t
        covers, behind = passing_light(scene, o, d, hits, width)
        before = torch.zeros(len(pixel), 3)
        for rows in torch.arange(len(pixel)).split([len(layer.pixel) for layer in kept]):  # a pixel once in each
            own = pixel[rows]
            before[rows] = passing[own]
            shows = rows[before[rows].amax(dim=1) > DARK]
            passing[pixel[shows]] = before[shows] * behind[shows]
            number[pixel[shows]] += 1
        shows = (before.amax(dim=1) > DARK).nonzero()[:, 0]
        met = RayHits(hits.t[shows], hits.triangle[shows], hits.barycentric[shows])
        pixel, before, behind = pixel[shows], before[shows], behind[shows]
        light = _shaded(shader, (o[shows], d[shows], width[shows]), met, pixel // rays.picture)
        sent = before * covers[shows, None] * light
        if veil is None:
            radiance.index_add_(0, pixel, sent)
        else:
            veiled.append((pixel, met.t, sent, before * (1.0 - behind)))
    if veil is not None and veiled:  # all layers at once: what media need of each light is made but once
        pixel, lengths, sent, hidden = (torch.cat(parts) for parts in zip(*veiled, strict=True))
        through, scattered = veil(pixel, lengths)
        radiance.index_add_(0, pixel, sent * through + hidden * scattered)
    return radiance, passing, number


def _batches(found: Iterator[Layer], layers: int) -> Iterator[list[Layer]]:
    """The first layers, several at a time where they have few hits: each call of a shader costs its own."""
    batch: list[Layer] = []
    for _, layer in zip(range(layers), found, strict=False):
        batch.append(layer)
        if sum(len(one.pixel) for one in batch) >= TOGETHER:
            yield batch
            batch = []
    if batch:
        yield batch


def _shaded(shader: LayerShader, rays: tuple[Tensor, Tensor, Tensor], hits: RayHits, picture: Tensor) -> Tensor:
    """Radiance (N,3) of hits, each picture's alone: hits near each other may share what light they find."""
    o, d, width = rays
    light = torch.zeros(len(picture), 3)
    for rows in picture.argsort(stable=True).split(picture.bincount().tolist()):
        if len(rows):
            own = RayHits(hits.t[rows], hits.triangle[rows], hits.barycentric[rows])
            light[rows] = shader(o[rows], d[rows], width[rows], own)
    return light


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


def _on_planes(panes: Geometry, rays: Rays, layer: Layer) -> Layer:
    """The same with lengths up to the planes of their triangles, which float32 depth told as well as it could.

    Rays that start there would else have to keep clear of what the eye's distance hides.
    """
    pixel, hits = layer.pixel, layer.hits
    corners = panes.vertices[panes.faces[hits.triangle]].double()
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rise = (rays.direction[pixel] * normal).sum(-1)
    exact = ((corners[:, 0] - rays.origin[pixel]) * normal).sum(-1) / rise
    near = (exact - hits.t).abs() <= 2.0 * SEEN * hits.t
    return Layer(pixel, RayHits(torch.where(near, exact, hits.t), hits.triangle, hits.barycentric))


def _traced(
    caster: RayCaster, origins: Tensor, directions: Tensor, limit: Tensor, start: Tensor | float = 0.0
) -> Iterator[Layer]:
    pixel = torch.arange(len(origins))
    hits = caster.first_hit(origins, directions, t_min=start, t_max=limit)
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
