"""Lights that reach little of a picture: a few rays each cost less than a map, however many lights there are."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface, position_error
from torchrender.effects.shadows.light_reach import LightReach, shines
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.receivers import shadow_receivers
from torchrender.effects.shadows.traced import ray_end
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, RectLight, SpotLight

FEWEST = 16
"""Small lights from which sorting the triangles for rays pays."""

_TILES = 256  # of a small light, at most: rays from all their pixels then take less than six maps and their look-up
_AT_ONCE = 1024  # tiles


def small_lights(reach: LightReach, lights: Mapping[int, Light], options: ShadowOptions) -> set[int]:
    """Numbers of the lights without area that are better asked by rays; none where they are few.

    Filters that are there to soften edges keep their maps.
    """
    if not _hard(options):
        return set()
    tiles = torch.bincount(reach.lights.long(), minlength=reach.reaches.shape[1]).tolist()
    small = {n for n, light in lights.items() if tiles[n] <= _TILES and not isinstance(light, DirectionalLight)}
    small -= {n for n in small if isinstance(lights[n], RectLight)}
    return small if len(small) >= FEWEST else set()


def lights_without_maps(lights: Sequence[Light], options: ShadowOptions) -> set[int]:
    """Numbers of the lights that hits of rays ask by rays; none where they are few.

    Mirrors see little of what many lights reach: a map of everything for each would cost more than the picture.
    """
    if not _hard(options):
        return set()
    small = {n for n, x in enumerate(lights) if not isinstance(x, DirectionalLight | RectLight) and shines(x)}
    return small if len(small) >= FEWEST else set()


def _hard(options: ShadowOptions) -> bool:
    """Shadows have the edges that rays give them."""
    return options.edges == "exact" and options.soft is None and options.filter in ("none", "bilinear")


def small_light_visibility(
    caster: RayCaster, lights: Mapping[int, Light], samples: GBuffer | RaySurface, reach: LightReach
) -> dict[int, Tensor]:
    """Visibility (B,H,W) of each of these lights, as :func:`~torchrender.effects.shadows.traced.traced_visibility`.

    Pixels in tiles that do not list a light are 1.
    """
    numbers = sorted(lights)
    out = torch.ones(len(numbers), samples.material.numel())
    place = torch.stack([lights[n].position.double() for n in numbers])  # type: ignore[union-attr]
    axis, cosine = torch.zeros_like(place), torch.full((len(numbers),), -math.inf, dtype=torch.float64)
    for at, n in enumerate(numbers):
        light = lights[n]
        if isinstance(light, SpotLight):
            axis[at], cosine[at] = light.axis, math.cos(math.radians(light.outer_deg))
    index = torch.full((reach.reaches.shape[1],), -1, dtype=torch.int64)
    index[torch.tensor(numbers)] = torch.arange(len(numbers))
    lamp = index[reach.lights.long()]
    listed = (lamp >= 0).nonzero().reshape(-1)
    tile = torch.repeat_interleave(torch.arange(len(reach.starts) - 1), reach.starts.diff())[listed]
    pixels, covered = _pixels_of(samples.material.shape, reach.side), samples.covered.reshape(-1)
    points, normals = (image.reshape(-1, 3) for image in shadow_receivers(samples))
    for part in torch.arange(len(listed)).split(_AT_ONCE):
        row = pixels[tile[part]]
        which = lamp[listed[part]][:, None].expand_as(row)
        kept = (row >= 0) & covered[row.clamp_min(0)]
        row, which = row[kept], which[kept]
        normal = normals[row].double()
        start = points[row].double() + normal * position_error(samples, row)[:, None]
        toward = place[which] - start
        facing = ((place[which] - points[row]) * normal).sum(-1) > 0
        inside = -(toward * axis[which]).sum(-1) >= cosine[which] * toward.norm(dim=-1)
        asked = (facing & inside & (toward != 0).any(-1)).nonzero().reshape(-1)
        limit = ray_end(place, toward[asked])
        hidden = caster.occluded(start[asked], toward[asked], t_max=limit)
        dark = ~facing
        dark[asked] = hidden
        out[which[dark], row[dark]] = 0.0
    return dict(zip(numbers, out.reshape(len(numbers), *samples.material.shape).unbind(0), strict=True))


def _pixels_of(shape: Sequence[int], side: int) -> Tensor:
    """(B*T,K) int64 numbers of the pixels of every tile of images (B,H,W); -1 beyond the picture's border."""
    count, height, width = shape
    high, wide = min(side, max(height, 1)), min(side, max(width, 1))  # hits are an image of one row
    rows, columns = -(-height // high), -(-width // wide)
    padded = torch.full((count, rows * high, columns * wide), -1, dtype=torch.int64)
    padded[:, :height, :width] = torch.arange(count * height * width).reshape(count, height, width)
    tiles = padded.reshape(count, rows, high, columns, wide).transpose(2, 3)
    return tiles.reshape(count * rows * columns, high * wide)
