"""The cameras of clusters, and their rays as kernels read them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.reflections.clusters.grouping import PixelClusters
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.kernels.reflections import cluster_fit

Array = np.ndarray[Any, Any]


@dataclass(frozen=True, eq=False)
class ClusterCameras:
    """C cameras, one per cluster. Planar clusters hold only ``eye``, ``frame`` and ``planar``."""

    clusters: PixelClusters
    frame: Tensor  # (C,4,3) float64: centre of the fitting plane, its right and down axes, its normal
    look: Tensor  # (C,3,3) right and down axis of the image, and view axis
    planar: Tensor  # (C,) bool: rays come from the mirrored eye, exactly
    usable: Tensor  # (C,) bool: False where the eye lies in the reflector's plane
    eye: Tensor  # (C,3) float64 centre of projection
    shift: Tensor  # (C,) factor that draws the mirrored eye to the plane; 1 for planar ones
    reach: Tensor  # (C,) distance of the far plane from the fitting plane
    near: Tensor  # (C,) camera depth
    relief: Tensor  # (C,) largest height of its pixels above or below the fitting plane
    box: Tensor  # (C,4) low x, low y, high x, high y of the image, in tangents
    size: Tensor  # (C,2) int64 width and height in pixels
    outside: Tensor  # (C,) rays beyond the half angle
    pixel_box: Tensor  # (C,4) int64 first column, first row, last column, last row of its pixels in the pictures

    def __len__(self) -> int:
        return len(self.planar)


@dataclass(frozen=True, eq=False)
class Bundle:
    """The rays of all clusters as the kernels read them."""

    clusters: PixelClusters
    rays: tuple[Array, ...]  # position, normal, direction
    origin: Tensor  # (3,) reference of the positions
    chunks: Array
    owner: Array
    order: Array

    @classmethod
    def of(cls, pixels: ReflectivePixels, clusters: PixelClusters) -> Bundle:
        origin = pixels.position.mean(dim=0)
        rays = (pixels.position - origin, pixels.normal, pixels.direction)
        return cls(
            clusters, tuple(view(r, np.float64) for r in rays), origin, *clusters.chunks(), clusters.order.numpy()
        )

    def regroup(self, clusters: PixelClusters) -> Bundle:
        chunks, owner = clusters.chunks()
        return replace(self, clusters=clusters, chunks=chunks, owner=owner, order=clusters.order.numpy())

    def gather(self, kernel: Any, arguments: tuple[Any, ...], columns: str, skip: Tensor | None = None) -> Tensor:
        """Run a chunk kernel and join its columns per cluster: "+" added up, "<" smallest, ">" largest.

        Clusters to ``skip`` (C,) get zeros, and cost nothing.
        """
        chosen = np.arange(len(self.chunks)) if skip is None else np.flatnonzero(~skip.numpy()[self.owner])
        joined = np.zeros((len(self.clusters), len(columns)))
        if not len(chosen):
            return torch.from_numpy(joined)
        owner = self.owner[chosen]
        out = np.zeros((len(chosen), len(columns)))
        kernel(cluster_fit.Bundle(self.chunks[chosen], owner, self.order, *self.rays), *arguments, out)
        first = np.flatnonzero(np.concatenate([[True], owner[1:] != owner[:-1]]))
        for sign, join in (("+", np.add), ("<", np.minimum), (">", np.maximum)):
            own = [k for k, c in enumerate(columns) if c == sign]
            if own:
                joined[np.ix_(owner[first], np.array(own))] = join.reduceat(out[:, own], first, axis=0)
        return torch.from_numpy(joined)
