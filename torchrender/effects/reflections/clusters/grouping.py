"""Groups of reflective pixels whose reflected rays are alike: by reflector and direction of the normal.

Specification 03, section 5. Pixels are sorted once by cluster; everything later runs over that order.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.reflections.reflectors import ReflectivePixels

CHUNK = 4096
"""Pixels of one cluster that a thread works on at a time."""

LEAST_PLANE = 16
"""Pixels that a plane must have to be a cluster of its own."""

FLAT_COSINE = math.cos(math.radians(0.1))
PLANE_STEP = 1e-3  # scene diagonals between planes that are told apart
TABLE = 1 << 16

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class PixelClusters:
    """C clusters of N pixels; none is empty."""

    cluster: Tensor  # (N,) int64 in [0, C)
    order: Tensor  # (N,) int64 pixels, cluster by cluster, ascending within each
    starts: Tensor  # (C+1,) int64: cluster c holds order[starts[c] : starts[c + 1]]

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def sizes(self) -> Tensor:
        """(C,) pixels of each cluster."""
        return self.starts[1:] - self.starts[:-1]

    def members(self, number: int) -> Tensor:
        """Pixels of one cluster."""
        return self.order[int(self.starts[number]) : int(self.starts[number + 1])]

    def chunks(self) -> tuple[Array, Array]:
        """(K,2) first and end in ``order``, and the cluster of each chunk."""
        starts = self.starts.numpy()
        counts = -(-(starts[1:] - starts[:-1]) // CHUNK)
        first = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(counts)), counts)
        begin = starts[owner] + CHUNK * (np.arange(len(owner)) - first[owner])
        return np.stack([begin, np.minimum(begin + CHUNK, starts[owner + 1])], axis=1), owner


def compact(key: Tensor) -> PixelClusters:
    """Clusters from non-negative keys (N,), numbered in ascending order of the keys that occur."""
    if not len(key):
        empty = torch.zeros(0, dtype=torch.int64)
        return PixelClusters(empty, empty, torch.zeros(1, dtype=torch.int64))
    counts = torch.bincount(key)
    number = torch.cumsum(counts > 0, 0) - 1
    cluster = number[key]
    sizes = counts[counts > 0]
    starts = torch.cat([torch.zeros(1, dtype=torch.int64), torch.cumsum(sizes, 0)])
    # numpy sorts small integers by radix, in linear time.
    narrow = cluster.numpy().astype(np.uint16 if len(sizes) <= 1 << 16 else np.int64)
    return PixelClusters(cluster, torch.from_numpy(np.argsort(narrow, kind="stable")), starts)


def share_of_bins(share: Tensor, visible: Tensor, rule: str, m: float) -> Tensor:
    """How much of the full number of bins each visible reflector gets, (R,) in (0, 1].

    ``share`` (R,): its part of all reflective pixels; ``visible`` (R,): reflectors in its picture.

    Rules: "sqrt_share" ``m sqrt(a)``; "literal" ``m a / n``, as printed;
    "mean" ``m a n``, relative to the mean share.
    """
    rules: dict[str, Callable[[], Tensor]] = {
        "sqrt_share": lambda: m * share.sqrt(),
        "literal": lambda: m * share / visible,
        "mean": lambda: m * share * visible,
    }
    return rules[rule]().clamp_max(1.0)


def cluster_pixels(
    pixels: ReflectivePixels,
    diagonal: float,
    *,
    bins: tuple[int, int] = (13, 8),
    rule: str = "sqrt_share",
    m: float = 1.0,
    plane_share: float = math.inf,
    camera_share: float = 0.0,
) -> PixelClusters:
    """Group pixels by picture, reflector, and bins of the azimuth and polar angle of the world-space normal.

    Bin borders are shifted by an eighth of a bin, and the poles have one azimuth bin, so that rounding noise does not
    scatter walls and floors. Beyond the thesis, large flat parts of reflectors are found first, and leave the bins to
    what is curved: a plane needs no more than one camera, and any camera for more than the plane is worse.

    Args:
        diagonal: of the scene.
        bins: azimuth and polar bins of a reflector that fills the view by itself.
        rule, m: see :func:`share_of_bins`; shares are counted among curved pixels.
        plane_share: planes with at least this share of a picture's pixels become clusters of their own.
        camera_share: curved clusters with a smaller share join the one of their reflector that faces the most alike;
            a depth image for a few pixels costs as much as for many.
    """
    size = pixels.shape[1] * pixels.shape[2]
    plane = _planes(pixels, diagonal, max(plane_share * size, LEAST_PLANE))
    curved = plane < 0
    key = plane.clone()
    if bool(curved.any()):
        part = pixels.select(curved)
        binned = compact(_bin_keys(part, size, bins, rule, m))
        key[curved] = plane.max() + 1 + _joined(part, binned, camera_share * size)[binned.cluster]
    return compact(key)


def _joined(pixels: ReflectivePixels, clusters: PixelClusters, least: float) -> Tensor:
    """(C,) cluster that each one joins, itself if it has ``least`` pixels or more."""
    own = torch.arange(len(clusters))
    small = clusters.sizes < least
    if not bool(small.any()):
        return own
    some = clusters.order[clusters.starts[:-1]]
    facing = torch.zeros(len(clusters), 3, dtype=torch.float64).index_add(0, clusters.cluster, pixels.normal)
    facing = torch.nn.functional.normalize(facing, dim=-1, eps=1e-30)
    size = pixels.shape[1] * pixels.shape[2]
    group = pixels.object_id[some] + (pixels.object_id.max() + 1) * (pixels.pixel[some] // size)
    together = group[:, None] == group
    # The largest of each reflector may take others whatever its size.
    rank = torch.where(together, clusters.sizes, -1)
    leader = rank.argmax(dim=1) == own
    alike = torch.where(together & (~small | leader), facing @ facing.T, -2.0)
    return torch.where(small & ~leader, alike.argmax(dim=1), own)


def _bin_keys(pixels: ReflectivePixels, size: int, bins: tuple[int, int], rule: str, m: float) -> Tensor:
    objects = int(pixels.object_id.max()) + 1
    owner = (pixels.pixel // size) * objects + pixels.object_id
    counts = torch.bincount(owner)
    present = counts > 0
    reflector = (torch.cumsum(present, 0) - 1)[owner]
    sizes = counts[present]
    picture = present.nonzero().reshape(-1) // objects
    per_picture = torch.zeros(pixels.shape[0], dtype=torch.int64).index_add(0, picture, sizes)
    visible = torch.bincount(picture, minlength=pixels.shape[0])[picture]
    part = share_of_bins(sizes / per_picture[picture], visible, rule, m)
    azimuth_bins = (bins[0] * part).ceil().clamp(1, bins[0]).long()
    polar_bins = (bins[1] * part).ceil().clamp(1, bins[1]).long()
    i, j = _angle_bins(pixels.normal, azimuth_bins[reflector], polar_bins[reflector])
    return (reflector * bins[0] + i) * bins[1] + j


def _planes(pixels: ReflectivePixels, diagonal: float, least: float) -> Tensor:
    """(N,) number of the plane that a pixel's flat neighbourhood lies in, -1 where there is no plane of that size."""
    none = torch.full((len(pixels),), -1, dtype=torch.int64)
    flat = (pixels.normal * pixels.geometric_normal).sum(-1) > FLAT_COSINE
    rows = flat.nonzero().reshape(-1)
    if len(rows) < least:
        return none
    normal = pixels.geometric_normal[rows]
    height = (normal * (pixels.position[rows] - pixels.position[0])).sum(-1)
    # Cells far wider than rounding and far narrower than two planes apart; a plane on a border makes two clusters.
    cells = torch.cat([normal * 128.0, (height / (PLANE_STEP * diagonal))[:, None]], dim=1).round().long()
    picture = pixels.pixel[rows] // (pixels.shape[1] * pixels.shape[2])
    key = (picture * 4096 + pixels.object_id[rows]) * 257
    for column in range(4):
        key = (key * 1000003 + cells[:, column] + 1000) % 0x7FFFFFFF
    # Counting in a small table instead of sorting: two planes that share an entry are told apart by later checks.
    slot = key % TABLE
    size = torch.bincount(slot, minlength=TABLE)
    large = size >= least
    number = torch.where(large, torch.cumsum(large, 0) - 1, -1)
    none[rows] = number[slot]
    return none


def _angle_bins(normal: Tensor, azimuth_bins: Tensor, polar_bins: Tensor) -> tuple[Tensor, Tensor]:
    x, y, z = normal.float().unbind(-1)
    azimuth = torch.atan2(x, z) / (2 * math.pi)
    polar = torch.acos(y.clamp(-1.0, 1.0)) / math.pi
    i = ((azimuth % 1.0) * azimuth_bins + 0.125).floor().long() % azimuth_bins
    j = (polar * polar_bins + 0.125).floor().long()
    j = torch.minimum(j, polar_bins - 1)
    cap = (polar < 15 / 180) | (polar > 165 / 180)
    return torch.where(cap, 0, i), j


def split(clusters: PixelClusters, side: Tensor) -> PixelClusters:
    """The clusters with each one's pixels parted by ``side`` (N,), small non-negative integers."""
    parts = int(side.max()) + 1 if len(side) else 1
    return compact(clusters.cluster * parts + side)
