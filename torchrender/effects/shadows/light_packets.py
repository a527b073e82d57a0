"""Which samples of a rectangular light receivers see, by packets of rays from the samples, or by whole shadow maps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.effects.shadows.light_samples import LightGrid
from torchrender.kernels.compile import thread_count
from torchrender.kernels.rays.bvh_build import Bvh
from torchrender.kernels.shadows.soft_shadow import LightViews, light_bits, look_up
from torchrender.raster import rasterize_depth
from torchrender.scene.mesh import Geometry

TILE = 4
"""Light samples along each edge of a part of the light that is searched for at once."""


class Packets(NamedTuple):
    """How the question is put; see :class:`~torchrender.effects.shadows.soft_shadow.SoftShadowOptions`."""

    visibility: str
    drawn: bool  # whole maps
    per_side: int  # samples
    bias: tuple[float, float, float]  # constant, slope, largest slope
    skip: bool
    probes: int


def packet_bits(
    geometry: Geometry, tree: Bvh, receivers: tuple[Tensor, Tensor], grid: LightGrid, how: Packets
) -> tuple[np.ndarray, int]:
    """Bits (P,words) of one light by packets or maps, and the number of pairs outside its pictures."""
    samples = len(grid.samples)
    probe = _probes(grid, how)
    tile, tiles = grid.tiles(how.per_side, TILE)
    first = (tile + len(tiles) * ~probe).argsort(stable=True)
    bounds = torch.arange(len(tiles) + 1)
    runs = torch.stack([torch.searchsorted(tile[probe].sort().values, bounds),
                        int(probe.sum()) + torch.searchsorted(tile[~probe].sort().values, bounds)])  # fmt: skip
    views = LightViews(
        samples=numpy_view(grid.samples[first], np.float64),
        rotations=numpy_view(grid.rotations[first], np.float64),
        focal=numpy_view(grid.focal[first], np.float64),
        names=numpy_view(first, np.int64),
        size=grid.size,
        near=grid.near,
        constant_bias=how.bias[0],
        slope_bias=how.bias[1],
        largest_slope=how.bias[2],
        texels=how.visibility == "shadow_map",
        outline=numpy_view(grid.outline, np.float64),
        tiles=numpy_view(tiles, np.float64),
        runs=numpy_view(runs, np.int64),
    )
    points, normals = (numpy_view(v, np.float64) for v in receivers)
    threads = thread_count()
    bits, outside = np.zeros((len(points), (samples + 63) // 64), np.int64), np.zeros(threads, np.int64)
    if how.drawn:
        for s, name in enumerate(first.tolist()):
            maps = rasterize_depth(geometry, grid.cameras(name))
            look_up(numpy_view(maps, np.float32), points, normals, views, s, bits, outside)
        return bits, int(outside.sum())
    light_bits(tree, points, normals, views, how.skip, threads, bits, outside)
    return bits, int(outside.sum())


def _probes(grid: LightGrid, how: Packets) -> Tensor:
    """(S,) bool samples traced first: an even subset that includes the light's rim; none if all are to be traced."""
    n = how.per_side
    chosen = torch.zeros(len(grid.samples), dtype=torch.bool)
    if 0 < how.probes < n and len(chosen) == n * n:
        rows = torch.linspace(0, n - 1, how.probes).round().long()
        chosen[(rows[:, None] * n + rows).reshape(-1)] = True
    return chosen
