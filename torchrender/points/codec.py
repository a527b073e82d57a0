"""Point models at eight bytes a node, decoded only where they are drawn.

Source: specification 06, section 8. Errors: position half a cell (extent of the patch's box / 4096 along its two longer
axes, / 2048 along the shortest), normals 0.79 degrees at most, radii the nearest of a palette of 256.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_choice
from torchrender.kernels.points.codec import (
    ANGLES,
    OCTAHEDRON,
    Boxes,
    Tables,
    decode_nodes,
    direction_table,
    encode_nodes,
)
from torchrender.numerics.color import srgb_from_linear, srgb_table
from torchrender.points.tree import NodeBatch, NodeStore, PatchHeaders, PatchSet, PlainNodes, node_arrays

NORMALS = ("angles", "octahedron")
PALETTE = 256
_ROUNDS = 12  # of Lloyd's algorithm
_SAMPLE = 1 << 17  # radii that the palette is fitted to
_KINDS = {"angles": ANGLES, "octahedron": OCTAHEDRON}


class NodeAccess:
    """Where the bytes of compressed nodes are; here: in memory."""

    def __init__(self, codes: np.ndarray, colors: np.ndarray | None) -> None:
        self.codes = codes  # (T,8) uint8
        self.colors = colors  # (T,3) uint8 sRGB

    def touch(self, chosen: np.ndarray, level: np.ndarray) -> None:
        """Called before one level of each chosen patch is decoded."""


@dataclass(frozen=True, eq=False)
class PackedNodes:
    """All nodes of a patch set at eight bytes each, and three for a colour."""

    access: NodeAccess
    palette: Tensor  # (256,) float32, ascending
    normals: str  # how normals are stored

    @property
    def has_color(self) -> bool:
        return self.access.colors is not None

    @property
    def node_bytes(self) -> int:
        return 8

    def __len__(self) -> int:
        return len(self.access.codes)

    @cached_property
    def _directions(self) -> np.ndarray:
        table = np.zeros((65536, 3), np.float32)
        direction_table(_KINDS[self.normals], table)
        return table

    def gather(self, patches: PatchSet, chosen: Tensor, level: Tensor) -> tuple[NodeBatch, Tensor]:
        """Decode one level of each chosen patch."""
        headers = patches.headers
        self.access.touch(chosen.numpy(), level.numpy())
        rows = torch.stack([headers.start[chosen, level], headers.start[chosen, level + 1]], dim=1)
        ends = (rows[:, 1] - rows[:, 0]).cumsum(0)
        slices = torch.stack([ends - (rows[:, 1] - rows[:, 0]), ends], dim=1)
        total = int(ends[-1]) if len(ends) else 0
        colors = self.access.colors
        out = NodeBatch(
            position=torch.zeros(total, 3),
            normal=torch.zeros(total, 3),
            radius=torch.zeros(total),
            color=None if colors is None else torch.zeros(total, 3),
        )
        decode_nodes(
            self.access.codes,
            np.zeros((1, 3), np.uint8) if colors is None else colors,
            rows.numpy(),
            slices[:, 0].contiguous().numpy(),
            Boxes(half_extent(headers)[chosen].numpy(), short_axis(headers)[chosen].numpy()),
            Tables(self.palette.numpy(), self._directions, srgb_table(8).numpy()),
            node_arrays(out.position, out.normal, out.radius, out.color),
        )
        return out, slices


def half_extent(headers: PatchHeaders) -> Tensor:
    """(N,3) float64 half the box of each patch."""
    return 0.5 * (headers.box[:, 1] - headers.box[:, 0]).contiguous()


def short_axis(headers: PatchHeaders) -> Tensor:
    """(N,) int64 axis of the shortest side of each box: it is the one with ten bits."""
    return half_extent(headers).argmin(dim=1)


def compress(patches: PatchSet, *, normals: str = "angles") -> PatchSet:
    """The same patches with nodes of eight bytes.

    Args:
        normals: "angles" stores polar angles as published (0.35 degrees off on average, 0.79 at most), "octahedron" the
            unfolded octahedron (0.34 on average, 0.95 at most, without poles).

    Raises:
        OptionError: an unknown kind of normals.
    """
    check_choice("normals", normals, NORMALS)
    nodes = patches.nodes
    if isinstance(nodes, PackedNodes):
        if nodes.normals == normals:
            return patches
        patches = decompress(patches)
        nodes = patches.nodes
    assert isinstance(nodes, PlainNodes)
    palette = fit_palette(nodes.radius)
    codes = np.zeros((len(nodes), 8), np.uint8)
    encode_nodes(
        node_arrays(nodes.position, nodes.normal, nodes.radius, nodes.color),
        patches.headers.start.numpy(),
        Boxes(half_extent(patches.headers).numpy(), short_axis(patches.headers).numpy()),
        palette.numpy(),
        _KINDS[normals],
        codes,
    )
    colors = None
    if nodes.color is not None:
        colors = torch.cat([_srgb_codes(part) for part in nodes.color.split(1 << 20)]).numpy()
    packed: NodeStore = PackedNodes(NodeAccess(codes, colors), palette, normals)
    return replace(patches, nodes=packed)


def decompress(patches: PatchSet) -> PatchSet:
    """All nodes as plain numbers in memory, with the errors of compression."""
    nodes = patches.nodes
    if isinstance(nodes, PlainNodes):
        return patches
    headers = patches.headers
    depth = (headers.start[:, 1:] > headers.start[:, :-1]).sum(1)
    patch = torch.arange(len(headers)).repeat_interleave(depth)
    level = torch.cat([torch.arange(int(d)) for d in depth])
    batch, _ = nodes.gather(patches, patch, level)
    return replace(patches, nodes=PlainNodes(batch.position, batch.normal, batch.radius, batch.color))


def fit_palette(radius: Tensor) -> Tensor:
    """(256,) float32 ascending: Lloyd's algorithm on log r from quantiles. Fewer different radii are kept exactly."""
    exact = torch.unique(radius)
    if len(exact) <= PALETTE:
        return torch.cat([exact, exact[-1:].expand(PALETTE - len(exact))]).float().contiguous()
    logs = torch.cat([radius[:: max(1, len(radius) // _SAMPLE)], exact[[0, -1]]]).double()
    logs = logs.clamp_min(torch.finfo(torch.float32).tiny).log()
    # Some evenly spread ones beside: the few nodes at the top of the trees must not be far off.
    even = torch.linspace(float(logs.min()), float(logs.max()), 1 + len(logs) // 3, dtype=torch.float64)
    logs = torch.cat([logs, even]).sort().values
    centres = torch.quantile(logs, torch.linspace(0, 1, PALETTE, dtype=torch.float64))
    for _ in range(_ROUNDS):
        owner = torch.bucketize(logs, 0.5 * (centres[1:] + centres[:-1]))
        count = torch.bincount(owner, minlength=PALETTE)
        total = torch.zeros(PALETTE, dtype=torch.float64).index_add_(0, owner, logs)
        centres = torch.where(count > 0, total / count.clamp_min(1), centres).sort().values
    # The ends of the range stay: too small a greatest radius would leave holes.
    centres[0], centres[-1] = logs[0], logs[-1]
    return centres.exp().float().contiguous()


def _srgb_codes(color: Tensor) -> Tensor:
    return (srgb_from_linear(color.clamp(0.0, 1.0)) * 255.0 + 0.5).to(torch.uint8)
