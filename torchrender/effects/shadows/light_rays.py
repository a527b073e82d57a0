"""Which samples of a rectangular light receivers see, by rays through Embree, refined where neighbours disagree."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.effects.shadows.light_samples import LightGrid
from torchrender.kernels.compile import thread_count
from torchrender.kernels.rays.boxes import SCALE, frame_of
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.shadows.light_refine import GROUP, LightSamples, refine_light
from torchrender.rays import RayCaster
from torchrender.scene.mesh import Geometry

FARTHEST = 250.0
"""Half extents of a scene, in distances from receivers to the light, up to which float32 trees are fine enough."""

_PROBES = 4  # samples that each receiver of a group traces first
_COARSE = 4  # rows and columns of samples that it traces next, and those between
_FEWEST = 8  # samples along an edge from which refining pays


class LightRays:
    """Triangles ready for rays to lights: closed ones for Embree alone, those with holes for the exact ray caster."""

    def __init__(self, geometry: Geometry) -> None:
        closed, holed = geometry, None
        if geometry.cutout is not None:
            cut = geometry.cutout.mask >= 0
            closed, holed = geometry.part(~cut), geometry.part(cut)
        vertices, faces = numpy_view(closed.vertices, np.float64), numpy_view(closed.faces, np.int32)
        self._plain = PlainEmbree(vertices, faces) if len(faces) else None
        self._holed = None if holed is None or not holed.triangle_count else RayCaster(holed)

    def bits(
        self, points: Tensor, normals: Tensor, gaps: Tensor, grid: LightGrid, per_side: int, step: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bits (P,words) of the visible samples, and how many samples (P,) lie above each receiver's surface.

        Args:
            points, normals: (P,3) float64 of one picture, neighbours next to each other.
            gaps: (P,) float64 scene units that points may be off.
            per_side: samples along each edge of the light.
            step: of the rows and columns that are traced before those between; 1: all are.
        """
        samples = len(grid.samples)
        bits, above = np.zeros((len(points), (samples + 63) // 64), np.int64), np.zeros(len(points), np.int32)
        light = _samples_of(grid, per_side, step)
        arrays = (numpy_view(v, np.float64) for v in (points, normals, gaps))
        if self._plain is not None:
            refine_light(self._plain.tree, *arrays, light, 32 * thread_count(), (bits, above))
        else:
            _all_above(points, normals, grid.samples, bits, above)
        if self._holed is not None:
            self._block_holed(points + normals * gaps[:, None], grid.samples, bits)
        return bits, above

    def _block_holed(self, origins: Tensor, samples: Tensor, bits: np.ndarray) -> None:
        assert self._holed is not None
        for s, sample in enumerate(samples):
            word, bit = bits[:, s >> 6], np.int64(np.uint64(1) << np.uint64(s & 63))
            rows = torch.from_numpy(np.flatnonzero(word & bit))
            if len(rows):
                hidden = self._holed.occluded(origins[rows], sample - origins[rows], t_max=1.0 - 1e-6)
                word[rows[hidden].numpy()] &= ~bit


def usable(geometry: Geometry, points: Tensor, grid: LightGrid) -> bool:
    """Embree is there, and its float32 is fine enough beside the distances from receivers to the light."""
    if embree() is None:
        return False
    if not len(points) or not geometry.triangle_count:
        return True
    frame = frame_of(numpy_view(geometry.vertices, np.float64), numpy_view(geometry.faces, np.int32))
    middle = grid.outline[0] + 0.5 * (grid.outline[1] + grid.outline[2])
    away = (points[:: max(len(points) // 1024, 1)] - middle).norm(dim=1).median()
    return bool(1.0 / frame[SCALE] <= FARTHEST * float(away))


def _samples_of(grid: LightGrid, per_side: int, step: int) -> LightSamples:
    places = numpy_view(grid.samples, np.float64)
    if step <= 1 or per_side < _FEWEST or len(places) != per_side * per_side:
        nothing = np.zeros(0, np.int64)
        return LightSamples(places, 0, np.zeros((GROUP, 0), np.int64), nothing, nothing)
    return LightSamples(places, per_side, *_order(per_side, step))


@lru_cache(maxsize=16)
def _order(n: int, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Probes of a group, coarse samples of a receiver, rows of the fine grid; of n x n samples."""
    random, cells = np.random.default_rng(0), round((GROUP * _PROBES) ** 0.5)
    # One sample in each of the light's cells, dealt out so that every receiver sees all of it, coarsely. Those of outer
    # cells lie at the rim: what hides a part of the light mostly comes from there.
    a, b = (v.ravel() for v in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    within = [random.integers(0, n, len(v)) for v in (a, b)]
    ends = [np.where(v == 0, 0, np.where(v == cells - 1, n - 1, r)) for v, r in zip((a, b), within, strict=True)]
    row, column = ((v * n + r) // cells for v, r in zip((a, b), ends, strict=True))
    half = cells // 2
    quarter = (a // half) * 2 + b // half
    dealt = np.stack([random.permutation(np.flatnonzero(quarter == q)) for q in range(_PROBES)], axis=1)
    edge = np.unique(np.linspace(0, n - 1, _COARSE).round().astype(np.int64))
    middle = (edge[:-1] + edge[1:]) // 2
    coarse = np.concatenate([(k[:, None] * n + k).ravel() for k in (edge, middle)])
    return (row * n + column)[dealt].astype(np.int64), coarse, np.array(sorted({*range(0, n, step), n - 1}), np.int64)


def _all_above(points: Tensor, normals: Tensor, samples: Tensor, bits: np.ndarray, above: np.ndarray) -> None:
    """Everything above the surface is seen."""
    height = (normals * points).sum(-1)
    for s, sample in enumerate(samples):
        up = (normals @ sample > height).numpy()
        above += up
        bits[:, s >> 6] |= np.where(up, np.int64(np.uint64(1) << np.uint64(s & 63)), np.int64(0))


def samples_above(points: Tensor, normals: Tensor, grid: LightGrid) -> Tensor:
    """(P,) int32 samples of a light above each receiver's surface."""
    corner, u, v = grid.outline
    base, along = (normals * (corner - points)).sum(-1), torch.stack([normals @ u, normals @ v])
    low, high = (base + along.clamp(*limits).sum(0) for limits in ((None, 0.0), (0.0, None)))
    above = torch.where(low > 0, len(grid.samples), 0).int()
    part = ((low <= 0) & (high > 0)).nonzero().reshape(-1)
    for rows in part.split(1 << 14):
        height = normals[rows] @ grid.samples.T - (normals[rows] * points[rows]).sum(-1, keepdim=True)
        above[rows] = (height > 0).sum(1).int()
    return above
