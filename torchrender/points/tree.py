"""Large point models cut into patches, each with a binary tree of levels stored breadth first in one array.

Source: specification 06, section 3.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_class, check_range, checked_fields, options_of
from torchrender.errors import OptionError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.points.records import Nodes
from torchrender.kernels.points.tree import Headers, Limits, fill_nodes, levels_of, split_segments
from torchrender.points.cloud import PointCloud, framing_cloud
from torchrender.scene.camera import Cameras


@dataclass(frozen=True, kw_only=True)
@checked_fields
class PatchOptions:
    """When a piece of a point model is a patch.

    A piece of at most ``min_points`` points is one, and so is one of at most ``max_points`` points that is flat enough.
    """

    max_points: int = 4096  # n_max, 256 to 65536
    min_points: int = 64  # n_min, 8 to 1024
    max_variation: float = 0.02  # sigma_max: smallest eigenvalue of the covariance over their sum, 0 (plane) to 1/3
    max_cone_deg: float = 35.0  # alpha_max: half angle of the cone of its normals

    def __post_init__(self) -> None:
        check_range("max_points", self.max_points, 256, 65536)
        check_range("min_points", self.min_points, 8, 1024)
        check_range("max_variation", self.max_variation, 0.0, 1 / 3)
        check_range("max_cone_deg", self.max_cone_deg, 0.0, 180.0)
        if self.min_points > self.max_points:
            raise OptionError(f"min_points must be <= max_points {self.max_points}, got {self.min_points}")


@dataclass(frozen=True, eq=False)
class NodeBatch:
    """Nodes side by side, ready to be drawn."""

    position: Tensor  # (T,3) float32 relative to the centre of the node's patch
    normal: Tensor  # (T,3) float32 unit; zero: unknown
    radius: Tensor  # (T,) float32
    color: Tensor | None  # (T,3) float32 linear

    def __len__(self) -> int:
        return int(self.radius.shape[0])


class NodeStore(Protocol):
    """Where the nodes of a patch set are: in memory, compressed, or in a file."""

    @property
    def has_color(self) -> bool:
        """The nodes have colours."""

    @property
    def node_bytes(self) -> int:
        """Bytes that one node takes, colour left out."""

    def gather(self, patches: PatchSet, chosen: Tensor, level: Tensor) -> tuple[NodeBatch, Tensor]:
        """The nodes of one level of each chosen patch, and (S,2) int64 which rows of the batch are whose."""

    def __len__(self) -> int: ...


@dataclass(frozen=True, eq=False)
class PatchHeaders:
    """What is known of N patches without looking at their nodes. Levels beyond a patch's own repeat its deepest."""

    box: Tensor  # (N,2,3) float64 least and greatest corner of its points
    cone: Tensor  # (N,4) float64 axis and half angle of its normals, radians; pi where normals are unknown
    sigma: Tensor  # (N,) float64 smallest eigenvalue of the covariance over their sum
    start: Tensor  # (N,L+1) int64 first node of each level; the last column: one past the patch's nodes
    radius: Tensor  # (N,L,3) float64 least, mean and greatest radius of each level
    count: Tensor  # (N,) int64 points

    def __len__(self) -> int:
        return int(self.count.shape[0])

    @property
    def centre(self) -> Tensor:
        """(N,3) float64 centre of the box: node positions are relative to it."""
        return 0.5 * (self.box[:, 0] + self.box[:, 1])

    @property
    def sphere_radius(self) -> Tensor:
        """(N,) float64 radius of the sphere about ``centre`` that holds the box."""
        return 0.5 * (self.box[:, 1] - self.box[:, 0]).norm(dim=1)

    @property
    def levels(self) -> int:
        """Levels of the deepest patch."""
        return int(self.radius.shape[1])


@dataclass(frozen=True, eq=False)
class PatchSet:
    """A point model ready to be drawn."""

    headers: PatchHeaders
    nodes: NodeStore
    two_sided: bool
    name: str = "points"

    __repr__ = brief

    @property
    def point_count(self) -> int:
        """Points of the model, without the nodes above them."""
        return int(self.headers.count.sum())

    @property
    def bounds(self) -> Tensor:
        """(2,3) float64 bounding box."""
        return torch.stack([self.headers.box[:, 0].amin(0), self.headers.box[:, 1].amax(0)])

    @property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal, scene units."""
        low, high = self.bounds
        return float((high - low).norm())

    def camera(self, name: str | None = None, *, width: int, height: int) -> Cameras:
        """A camera that frames the points with their discs."""
        reach = self.headers.radius[:, -1, 2:]
        box = self.headers.box
        bounds = torch.stack([(box[:, 0] - reach).amin(0), (box[:, 1] + reach).amax(0)])
        return framing_cloud(bounds, name, width, height)


@dataclass(frozen=True, eq=False)
class PlainNodes(NodeBatch):
    """All nodes of a patch set in memory, uncompressed."""

    @property
    def has_color(self) -> bool:
        return self.color is not None

    @property
    def node_bytes(self) -> int:
        return 28

    def gather(self, patches: PatchSet, chosen: Tensor, level: Tensor) -> tuple[NodeBatch, Tensor]:
        """Nothing is copied: the rows are those of the whole array."""
        start = patches.headers.start
        return self, torch.stack([start[chosen, level], start[chosen, level + 1]], dim=1)


def build_patches(cloud: PointCloud, options: PatchOptions | None = None) -> PatchSet:
    """Split a cloud into patches by covariance, and each patch into levels of detail.

    Every split is at the median across the direction of greatest extent. An inner node is the mean of its points by
    squared radius; its radius encloses its children. The deepest level of a patch holds each of its points once, and
    every level represents them all. Missing normals and radii are estimated.
    """
    check_class("cloud", cloud, PointCloud)
    options = options_of(options, PatchOptions)
    cloud = cloud.completed()
    assert cloud.normal is not None and cloud.radius is not None
    points = node_arrays(cloud.position, cloud.normal, cloud.radius, cloud.color)
    order, key = np.arange(len(cloud), dtype=np.int64), np.zeros(len(cloud))
    runs = _cut(points, order, key, options)
    count = runs[:, 1] - runs[:, 0]
    start = level_starts(count)
    total, patches = int(start[-1, -1]), len(runs)
    nodes = PlainNodes(
        position=torch.zeros(total, 3),
        normal=torch.zeros(total, 3),
        radius=torch.zeros(total),
        color=None if cloud.color is None else torch.zeros(total, 3),
    )
    headers = PatchHeaders(
        box=torch.zeros(patches, 2, 3, dtype=torch.float64),
        cone=torch.zeros(patches, 4, dtype=torch.float64),
        sigma=torch.zeros(patches, dtype=torch.float64),
        start=torch.from_numpy(start),
        radius=torch.zeros(patches, start.shape[1] - 1, 3, dtype=torch.float64),
        count=torch.from_numpy(count),
    )
    written = node_arrays(nodes.position, nodes.normal, nodes.radius, nodes.color)
    arrays = Headers(
        starts=start,
        table=headers.radius.numpy(),
        boxes=headers.box.numpy(),
        cones=headers.cone.numpy(),
        sigma=headers.sigma.numpy(),
    )
    fill_nodes(points, order, key, runs, thread_count(), written, np.zeros(total), arrays)
    return PatchSet(headers, nodes, cloud.two_sided, cloud.name)


def node_arrays(position: Tensor, normal: Tensor, radius: Tensor, color: Tensor | None) -> Nodes:
    """Points or nodes as kernels take them: views."""
    tint = np.zeros((1, 3), np.float32) if color is None else color.numpy()
    return Nodes(position.numpy(), normal.numpy(), radius.numpy(), tint, color is not None)


def _cut(points: Nodes, order: np.ndarray, key: np.ndarray, options: PatchOptions) -> np.ndarray:
    """Runs (N,2) of ``order`` that are patches; each round splits the pieces that are none yet."""
    limits = Limits(
        options.min_points, options.max_points, float(options.max_variation), math.radians(options.max_cone_deg)
    )
    segments = np.array([[0, len(order)]], dtype=np.int64)
    done = []
    while len(segments):
        middle = np.zeros(len(segments), np.int64)
        split_segments(points, order, key, segments, limits, thread_count(), middle)
        done.append(segments[middle < 0])
        whole, at = segments[middle >= 0], middle[middle >= 0]
        segments = np.stack([whole[:, 0], at, at, whole[:, 1]], axis=1).reshape(-1, 2)
    runs = np.concatenate(done)
    return np.ascontiguousarray(runs[np.argsort(runs[:, 0])])


def level_starts(count: np.ndarray) -> np.ndarray:
    """(N,L+1) int64 first node of each level of patches of ``count`` (N,) points.

    A patch of n points has levels of 1, 2, 4 ... nodes and one of n.
    """
    depth = np.array([levels_of(n) for n in count.tolist()])
    level = np.arange(int(depth.max()))
    width = np.where(level == depth[:, None] - 1, count[:, None], 1 << level)
    width = np.where(level < depth[:, None], width, 0)
    ends = width.cumsum(axis=1)
    before = np.concatenate([[0], ends[:-1, -1].cumsum()])
    return np.ascontiguousarray(np.concatenate([np.zeros((len(count), 1), np.int64), ends], axis=1) + before[:, None])
