"""One view through the rasteriser's kernels: cull, project, bin, draw."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import numpy as np

from torchrender.kernels.compile import thread_count
from torchrender.kernels.raster import binning, project, tiles
from torchrender.kernels.raster import count_layers as layers
from torchrender.kernels.raster.coverage import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.resolve import CACHED

Array = np.ndarray[Any, Any]
CULL = {"none": binning.CULL_NONE, "back": binning.CULL_BACK, "front": binning.CULL_FRONT}
TILE = np.array([TILE_WIDTH, TILE_HEIGHT], np.int64)
CHUNKS_PER_THREAD = 4
KEPT_VERTICES = 1 << 21  # 64 MiB

NO_LIMITS = (np.zeros((0, 0)), np.zeros((0, 0), np.int64))
NO_EARLIER = (
    np.zeros((0, 0, 0), np.int64),
    np.zeros((0, 3, 4)),
    np.zeros(0),
    np.zeros((0, 0, 0), np.float32),
    np.zeros((0, 9)),
    np.zeros((7, 3)),
)
NO_HOLES = (np.zeros(0, np.int32), np.zeros((0, 3), np.int64), np.zeros(0, np.uint8), np.zeros((0, 2), np.float32))
NO_IDS = (np.zeros((0, 0), np.int64), np.zeros((0, 0), np.int64), np.zeros((0, 0, 2), np.float32))


@dataclass(frozen=True, eq=False)
class TriangleArrays:
    """A scene's triangles as the kernels read them."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int32
    objects: Array  # (F,) int64
    clusters: Array  # (C,2) int64
    cluster_bounds: Array  # (C,2,3) float64
    order: Array  # (F,) int32 triangle ids, cluster by cluster
    block_starts: Array  # (C+1,) int64
    blocks: Array  # (N,) int32 vertex blocks of the clusters


@dataclass(frozen=True, eq=False)
class View:
    """One camera as the kernels read it."""

    matrix: Array  # (3,3) from a world vector to homogeneous pixels about the image centre
    reference: Array  # (3,) world point that the matrix counts from
    planes: Array  # (6,4) frustum
    settings: Array  # (6,) width, height, near, far, orthographic, unused


def draw_view(
    triangles: TriangleArrays, view: View, cull: str, tests: tuple[Any, Any, Any], outputs: tuple[Array, ...]
) -> None:
    """Fill ``outputs`` = (depth, triangle, object, barycentric), the last three empty if only depth is wanted."""
    scene, bins = _prepare(triangles, view, cull)
    tiles.render_tiles(scene, bins, view.settings, *tests, _scratch(thread_count()), outputs)


def count_view(
    triangles: TriangleArrays,
    view: View,
    cull: str,
    holes: tuple[Array, ...],
    stored: tuple[Array, Array],
    eps: Array,
    outputs: tuple[Array, Array],
) -> None:
    """Fill ``outputs`` = (count, touching): surfaces before those ``stored`` = (depth, triangle)."""
    scene, bins = _prepare(triangles, view, cull)
    _, _, ends, _, _, counter = _scratch(thread_count())
    layers.count_tiles(scene, bins, view.settings, holes, stored, eps, (ends, counter), outputs)


def _prepare(triangles: TriangleArrays, view: View, cull: str) -> tuple[tuple[Array, ...], tuple[Array, Array, Array]]:
    """Projected vertices with clipped triangles, and the triangles of each tile."""
    chosen, distance = project.visible_clusters(triangles.cluster_bounds, view.planes)
    chosen = chosen[np.argsort(distance, kind="stable")]  # nearly front to back: what is hidden is dropped early
    blocks = project.needed_blocks(chosen, triangles.block_starts, triangles.blocks, len(triangles.vertices))
    points = _memory.points(len(triangles.vertices))  # only the wanted blocks are filled, and only they are read
    packed = points.view(np.int64)
    near, orthographic = view.settings[2], bool(view.settings[4])
    project.project_vertices(
        triangles.vertices, blocks, view.matrix, view.reference, near, orthographic, points, packed
    )
    scene = (points, packed, triangles.faces, triangles.objects)
    clipped, bins = _bin(triangles, chosen, scene, view, CULL[cull])
    return (*scene, *clipped), bins


class _Memory(threading.local):
    """Projected vertices, kept from view to view by each thread: fresh pages cost more than what is written there."""

    def __init__(self) -> None:
        self._points = np.empty((0, 4))

    def points(self, count: int) -> Array:
        """Room for ``count`` projected vertices, not cleared."""
        if count > KEPT_VERTICES:
            return np.empty((count, 4))
        if len(self._points) < count:
            self._points = np.empty((count, 4))
        return self._points


_memory = _Memory()


def _scratch(threads: int) -> tuple[Array, ...]:
    """Tile buffers and cached planes, a row per thread, and the counter by which threads take tiles."""
    pixels = TILE_WIDTH * TILE_HEIGHT
    return (
        np.zeros((threads, pixels)),
        np.zeros((threads, pixels), np.int32),
        np.zeros((threads, 2, TILE_HEIGHT), np.int64),
        np.zeros((threads, CACHED), np.int64),
        np.zeros((threads, CACHED, 6)),
        np.zeros(1, np.int64),
    )


def _bin(
    triangles: TriangleArrays, chosen: Array, scene: tuple[Array, ...], view: View, cull: int
) -> tuple[tuple[Array, Array], tuple[Array, Array, Array]]:
    """Clipped triangles, and for each tile the triangles that may touch it."""
    points, packed, faces, _ = scene
    settings = view.settings
    starts = _chunk_starts(triangles.clusters, chosen)
    total = int(starts[-1])
    lists = (starts, np.empty(total, np.int32), np.empty((total, 4), np.int16), np.empty(total, np.int32))
    kept, counts = binning.classify(
        points, packed, faces, (triangles.clusters, triangles.order, chosen), settings, cull, TILE, lists
    )
    crossing = np.concatenate([lists[3][s : s + n] for s, n in zip(starts[:-1], kept[:, 1], strict=True)])
    corners = np.empty(((binning.MAX_CLIPPED - 2) * len(crossing), 3), np.int64)
    owners = np.empty(len(corners), np.int32)
    count = binning.clip_triangles(points, faces, np.sort(crossing), settings, cull, corners, owners)
    corners, owners = corners[:count], owners[:count]
    extra = np.zeros(counts.shape[1], np.int64)
    nothing = np.zeros(0, np.int64)
    binning.bin_clipped(corners, len(faces), settings, TILE, extra, nothing.astype(np.int32), nothing)
    per_tile = counts.sum(axis=0, dtype=np.int64) + extra
    begin = np.concatenate([[0], np.cumsum(per_tile)]).astype(np.int64)
    offsets = begin[:-1] + np.concatenate([np.zeros((1, counts.shape[1]), np.int64), np.cumsum(counts, axis=0)])
    entries = np.empty(int(begin[-1]), np.int32)
    columns = -(-int(settings[0]) // TILE_WIDTH)
    last = offsets[-1].copy()
    binning.scatter(lists, kept, offsets[:-1].copy(), columns, entries)
    if count:
        binning.bin_clipped(corners, len(faces), settings, TILE, extra, entries, last)
    order = np.argsort(-per_tile, kind="stable")  # the heaviest tiles first, so that threads end together
    return (corners, owners), (order, begin, entries)


def _chunk_starts(clusters: Array, chosen: Array) -> Array:
    """Where each chunk's triangles begin in the lists, (chunks + 1,)."""
    chunks = CHUNKS_PER_THREAD * thread_count()
    per = -(-len(chosen) // chunks)
    sizes = np.concatenate([[0], np.cumsum(clusters[chosen, 1] - clusters[chosen, 0])])
    ends = np.minimum(np.arange(chunks + 1) * per, len(chosen))
    return sizes[ends].astype(np.int64)
