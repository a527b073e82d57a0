"""The cosine-weighted integral of a picture of the sky, by normal.

The picture is cut into blocks, each of which is known by the mean of its directions, weighted by radiance: a block that
lies above the horizon of a normal gives exactly its inner product with that vector, wherever its light comes from.
Only blocks that the horizon cuts are approximate, and what they send arrives at grazing angles. The sum over blocks is
kept at the nodes of an octahedral map; the few brightest blocks are not, since a lamp's light ends in a crease at its
horizon that no interpolation follows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.kernels.sky.irradiance import facing_sum
from torchrender.scene.sky.octahedral import interpolate_nodes, node_directions

BLOCK_ROWS = (32, 64, 128, 256)
"""Blocks from zenith to nadir, twice as many around: coarse ones, and what bright ones are cut into, step by step."""

CUT_SHARE = 0.002
"""A block that sends more than this share of all light is cut into four."""

NODES, FEW_NODES = 129, 65
"""Nodes per side of the map; of pictures with fewer rows than blocks."""

LAMPS, LAMP_SHARE = 64, 0.005
"""At most so many blocks are lamps: those that send more than this share of all light."""

CHUNK = 64
"""Normals at a time: what they need stays in the processor's cache."""


def latlong_directions(height: int, width: int) -> Tensor:
    """(H,W,3) unit world directions of the pixel centres of a latitude-longitude picture."""
    polar = (torch.arange(height) + 0.5) * math.pi / height
    azimuth = ((torch.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
    sine = torch.sin(polar)[:, None]
    x, z = sine * torch.sin(azimuth), -sine * torch.cos(azimuth)
    return torch.stack([x, torch.cos(polar)[:, None].expand(height, width), z], dim=-1)


def solid_angles(height: int, width: int) -> Tensor:
    """(H,1) float64 steradians of the pixels of a latitude-longitude picture."""
    edges = torch.arange(height + 1, dtype=torch.float64) * math.pi / height
    return ((edges[:-1].cos() - edges[1:].cos()) * (2 * math.pi / width))[:, None]


def block_vectors(radiance: Tensor) -> Tensor:
    """Radiance times direction (3,3,K), integrated over the blocks of a picture (H,W,3): by colour, then by axis."""
    height, width, _ = radiance.shape
    light = (radiance.double() * solid_angles(height, width)[..., None]).reshape(-1, 3)
    block, count = _blocks(light.detach().sum(dim=-1), height, width)
    directions = latlong_directions(height, width).double().reshape(-1, 3)
    vectors = [
        torch.zeros(count, 3, dtype=torch.float64).index_add(0, block, light * directions[:, axis, None])
        for axis in range(3)
    ]
    moments = torch.stack(vectors, dim=-1).permute(1, 2, 0)  # (colour, axis, block)
    return moments[..., moments.detach().abs().amax(dim=(0, 1)) > 0].float()


def _blocks(power: Tensor, height: int, width: int) -> tuple[Tensor, int]:
    """Block (H*W,) of each pixel, and how many there may be, for the power (H*W,) that each sends."""
    limit = CUT_SHARE * power.sum()
    first = 0
    block = torch.zeros(height * width, dtype=torch.int64)
    cut = torch.arange(height * width)
    for rows in BLOCK_ROWS:
        row = torch.div(cut, width, rounding_mode="floor") * rows // height
        own = row * (2 * rows) + (cut % width) * (2 * rows) // width
        block[cut] = first + own
        sent = torch.zeros(2 * rows * rows, dtype=torch.float64).index_add(0, own, power[cut])
        first += 2 * rows * rows
        cut = cut[sent[own] > limit]
    return block, first


@dataclass(frozen=True, eq=False)
class IrradianceMap:
    """Irradiance by normal under a picture of the sky."""

    nodes: Tensor  # (N,N,3) octahedral map of all light but that of the lamps
    lamps: Tensor  # (K,3,3) irradiance of each lamp and colour on a surface that faces it, times its direction

    @classmethod
    def of(cls, radiance: Tensor) -> IrradianceMap:
        """Under a latitude-longitude picture (H,W,3) of at least as many rows as coarse blocks; differentiable."""
        vectors = block_vectors(radiance)
        power = vectors.detach().norm(dim=1).sum(dim=0)
        bright = power.topk(min(LAMPS, len(power))).indices
        bright = bright[power[bright] > LAMP_SHARE * power.sum()]
        others = torch.ones(len(power), dtype=torch.bool).index_fill(0, bright, False)
        size = NODES if len(radiance) > BLOCK_ROWS[1] else FEW_NODES
        normals = node_directions(size).reshape(-1, 3)
        nodes = _sum_of_facing(vectors[..., others], normals).reshape(size, size, 3)
        return cls(nodes, vectors[..., bright].permute(2, 0, 1).contiguous())

    def __call__(self, normals: Tensor) -> Tensor:
        """Irradiance (...,3) on surfaces of unit normals (...,3); differentiable."""
        amount = interpolate_nodes(self.nodes, normals)
        if len(self.lamps):
            facing = (normals @ self.lamps.reshape(-1, 3).T).clamp_min(0.0)
            amount = amount + facing.reshape(*normals.shape[:-1], -1, 3).sum(dim=-2)
        return amount


def _sum_of_facing(vectors: Tensor, normals: Tensor) -> Tensor:
    """``sum_k max(0, v_ck . n)`` (N,3) for vectors (3,3,K) and normals (N,3)."""
    if not (vectors.requires_grad and torch.is_grad_enabled()):
        total = torch.zeros(len(normals), 3)
        facing_sum(vectors.contiguous().numpy(), normals.T.contiguous().numpy(), total.numpy())
        return total
    flat = vectors.permute(1, 0, 2).reshape(3, -1)
    parts = [(n @ flat).clamp_min(0.0).reshape(len(n), 3, -1).sum(dim=-1) for n in normals.split(CHUNK)]
    return torch.cat(parts)
