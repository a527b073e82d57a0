"""One view through the rasteriser's kernels: cull, project, bin, draw."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from torchrender.arrays import empty_aligned
from torchrender.kernels.compile import thread_count
from torchrender.kernels.raster import binning, direct, many_views, project, tiles
from torchrender.kernels.raster import count_layers as layers
from torchrender.kernels.raster.chosen import Wanted
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.records import (
    Bins,
    Buffers,
    Earlier,
    Frame,
    Holes,
    Limits,
    Nearer,
    Refusals,
    Stored,
    Triangles,
    Visible,
)
from torchrender.kernels.raster.resolve import CACHED

Array = np.ndarray[Any, Any]
Pixels = tuple[Array, Array]  # rows and columns, int64
Drawing = tuple[str, Holes]  # what to cull, and missing texels
CULL = {"none": project.CULL_NONE, "sides": project.CULL_NONE, "back": project.CULL_BACK, "front": project.CULL_FRONT}
CHUNKS_PER_THREAD = 4
KEPT_VERTICES = 1 << 21  # 64 MiB
KEPT_TRIANGLES = 1 << 20  # 64 MiB
WHOLE_PIXELS = 1 << 16  # of pictures that one thread draws alone,
FINE_PIXELS = 1 << 18  # or of those with a triangle to two pixels, whose tiles are not drawn into often
WHOLE_ROOM = 1 << 28  # bytes that all threads may need for it
REGION = (8, 4)  # tiles of a region: they fit into a core's cache
FINE = 150  # pixels in squares over the clusters' diagonals for each triangle, at most, where regions are drawn


@dataclass(frozen=True, eq=False)
class TriangleArrays:
    """A scene's triangles as the kernels read them."""

    vertices: Array  # (V,3) float64
    faces: Array  # (F,3) int32
    listed: Array  # (F,3) int32 the same in ``order``
    objects: Array  # (F,) int64
    clusters: Array  # (C,2) int64
    cluster_bounds: Array  # (C,2,3) float64
    order: Array  # (F,) int32 triangle ids, cluster by cluster
    block_starts: Array  # (C+1,) int64
    blocks: Array  # (N,) int32 vertex blocks of the clusters
    single_sided: Array  # (F,) bool whose backs are not seen with cull "sides"; (0,): none


@dataclass(frozen=True, eq=False)
class View:
    """One camera as the kernels read it."""

    matrix: Array  # (3,3) from a world vector to homogeneous pixels about the image centre
    reference: Array  # (3,) world point that the matrix counts from
    planes: Array  # (6,4) frustum
    frame: Frame


class InView(NamedTuple):
    """Clusters in view, nearly front to back, and their projected vertices."""

    chosen: Array  # (N,) int64
    distance: Array  # (N,) to the near plane
    points: Array  # (V,4) float64
    packed: Array  # the same memory as int64


def draw_view(triangles: TriangleArrays, view: View, cull: str, tests: Refusals, outputs: Visible) -> None:
    """Fill ``outputs``."""
    how = binning.Listing(CULL[cull], not len(tests.limits.keys) and not len(tests.earlier.ids), tests.holes.mask)
    chosen, _, points, packed = seen = _projected(triangles, view)
    if how.plain and suits_regions(triangles, view, seen):
        found = _reached(triangles, view, chosen)
        room = many_views.Room(points, packed, *_memory.buffers(thread_count(), REGION[0] * REGION[1])[1:])
        regions, shape = _regions(triangles, found, view), _shape(triangles, cull == "sides")
        many_views.draw_regions(shape, found, regions, view.frame, how, tests.holes, room, outputs)
        return
    # Regions leave out what large clusters hide, so these come first by their nearest corners. Triangle by triangle,
    # middles tell better which ones hide the others.
    middles = triangles.cluster_bounds[chosen].mean(axis=1) @ view.planes[4, :3]
    chosen = chosen[np.argsort(middles, kind="stable")]
    scene, bins = _bin(triangles, chosen, (points, packed), view.frame, how, cull == "sides")
    tiles.render_tiles(scene, bins, view.frame, *tests, _memory.buffers(thread_count()), outputs)


def _reached(triangles: TriangleArrays, view: View, chosen: Array) -> many_views.Found:
    """What the chosen clusters, whose vertices are projected, may touch."""
    boxes, highs = np.empty((len(chosen), 4), np.int64), np.empty(len(chosen))
    direct.cluster_reaches(triangles.cluster_bounds, chosen, (view.matrix, view.reference), view.frame, boxes, highs)
    blocks = np.ones(-(-len(triangles.vertices) // project.BLOCK), np.bool_)
    return many_views.Found(chosen, boxes, highs, blocks)


def suits_regions(triangles: TriangleArrays, view: View, seen: InView) -> bool:
    """True if clusters are so small in a large picture that what regions hide of them is worth more than lists."""
    frame, (chosen, distance, _, _) = view.frame, seen
    if frame.width * frame.height <= thread_count() * REGION[0] * REGION[1] * TILE_WIDTH * TILE_HEIGHT:
        return False
    scale = float(np.linalg.norm(view.matrix[0]))
    area, count = project.area_in_view(triangles.cluster_bounds, triangles.clusters, (chosen, distance), scale, frame)
    return bool(area <= FINE * count)


def _regions(triangles: TriangleArrays, found: many_views.Found, view: View) -> many_views.Regions:
    """Those with most triangles first, so that threads end together."""
    wide, tall = REGION[0] * TILE_WIDTH, REGION[1] * TILE_HEIGHT
    across, down = -(-view.frame.width // wide), -(-view.frame.height // tall)
    loads = np.zeros((down, across), np.int64)
    many_views.region_loads(found, triangles.clusters, (wide, tall), loads)
    order = np.argsort(-loads, axis=None, kind="stable")
    return many_views.Regions(view.matrix, view.reference, order, wide, tall)


def _shape(triangles: TriangleArrays, sides: bool) -> many_views.Shape:
    """``sides``: single-sided triangles lose their backs."""
    shape = many_views.Shape(*(getattr(triangles, name) for name in many_views.Shape._fields))
    return shape if sides else shape._replace(single_sided=shape.single_sided[:0])


def draw_views(arrays: TriangleArrays, views: list[View], how: Drawing, outputs: Visible, wanted: Wanted) -> None:
    """Fill ``outputs``, images with a row for each of the views, which share size and projection; and ``wanted``.

    Each thread draws whole views, see :func:`suits_whole_views`. Images nobody keeps may have a row per thread instead.
    """
    (cull, holes), threads = how, thread_count()
    frames = [view.frame for view in views]
    poses = many_views.Views(
        np.stack([view.matrix for view in views]),
        np.stack([view.reference for view in views]),
        np.stack([view.planes for view in views]),
        np.array([[frame.near, frame.far] for frame in frames]),
        *(frames[0].width, frames[0].height, frames[0].orthographic),
    )
    vertices = len(arrays.vertices)
    points = _memory.points(threads * vertices)[: threads * vertices].reshape(threads, vertices, 4)
    tiles_of = -(-frames[0].width // TILE_WIDTH) * -(-frames[0].height // TILE_HEIGHT)
    room = many_views.Room(points, points.view(np.int64), *_memory.buffers(threads, tiles_of)[1:])
    if not outputs.triangle.size:
        none = np.zeros((len(views), 0, 0), np.int64)
        outputs = Visible(outputs.depth, none, none, np.zeros((len(views), 0, 0, 2), np.float32))
    many_views.draw_views(_shape(arrays, cull == "sides"), poses, (CULL[cull], *holes), room, outputs, *wanted)


def suits_whole_views(triangles: TriangleArrays, count: int, pixels: int) -> bool:
    """True if ``count`` pictures of so many pixels are drawn faster by a thread each."""
    threads = thread_count()
    room = threads * len(triangles.vertices) * 32
    most = max(WHOLE_PIXELS, min(FINE_PIXELS, 2 * len(triangles.faces)))
    return count >= 4 * threads and pixels <= most and room <= WHOLE_ROOM


@dataclass(frozen=True, eq=False)
class PreparedView:
    """One view whose triangles are projected and sorted into tiles, for passes that no depth buffer shortens."""

    view: View
    holes: Holes
    scene: Triangles
    bins: Bins

    def draw(self, limits: Limits, earlier: Earlier, outputs: Visible, pixels: Pixels | None = None) -> None:
        """Fill ``outputs`` with what passes the tests; with ``pixels`` only the tiles that hold these."""
        buffers = _memory.buffers(thread_count())
        bins = self._bins(pixels)
        tiles.render_tiles(self.scene, bins, self.view.frame, limits, earlier, self.holes, buffers, outputs)

    def count(self, stored: Stored, eps: Array, outputs: Nearer, pixels: Pixels | None = None) -> None:
        """Fill ``outputs``, all zero; ``eps``: relative and absolute distance of touching surfaces."""
        ends = _memory.buffers(thread_count()).spans
        layers.count_tiles(self.scene, self._bins(pixels), self.view.frame, self.holes, stored, eps, ends, outputs)

    def _bins(self, pixels: Pixels | None) -> Bins:
        order = self.bins.order
        if pixels is not None:
            columns = -(-self.view.frame.width // TILE_WIDTH)
            order = np.unique(pixels[0] // TILE_HEIGHT * columns + pixels[1] // TILE_WIDTH)
        return self.bins._replace(order=order, turn=np.zeros(1, np.int64))


@contextmanager
def prepared_view(triangles: TriangleArrays, view: View, cull: str, holes: Holes) -> Iterator[PreparedView]:
    """A :class:`PreparedView` while the context lasts; other views may be drawn meanwhile."""
    chosen, _, points, packed = _projected(triangles, view)
    how = binning.Listing(CULL[cull], False, holes.mask)
    scene, bins = _bin(triangles, chosen, (points, packed), view.frame, how, cull == "sides")
    with _memory.lent():
        yield PreparedView(view, holes, scene, bins)


def _projected(triangles: TriangleArrays, view: View) -> InView:
    """What is in view of a camera."""
    chosen, distance = project.visible_clusters(triangles.cluster_bounds, view.planes)
    order = np.argsort(distance, kind="stable")
    chosen, distance = chosen[order], distance[order]  # nearly front to back: what is hidden is dropped early
    blocks = project.needed_blocks(chosen, triangles.block_starts, triangles.blocks, len(triangles.vertices))
    points = _memory.points(len(triangles.vertices))  # only the wanted blocks are filled, and only they are read
    packed = points.view(np.int64)
    how = (view.matrix, view.reference, view.frame.near, view.frame.orthographic)
    project.project_vertices(triangles.vertices, blocks, *how, points, packed)
    return InView(chosen, distance, points, packed)


class _Memory(threading.local):
    """Projected vertices and lists of triangles, kept from view to view by each thread.

    Fresh pages cost more than what is written there.
    """

    def __init__(self) -> None:
        self._points = np.empty((0, 4))
        self._lists = _lists(0)
        self._buffers = _buffers(0, 0)

    @contextmanager
    def lent(self) -> Iterator[None]:
        """What was handed out last stays as it is while the context lasts."""
        points, lists = self._points, self._lists
        self._points, self._lists = np.empty((0, 4)), _lists(0)
        try:
            yield
        finally:
            self._points, self._lists = points, lists

    def points(self, count: int) -> Array:
        """Room for ``count`` projected vertices, not cleared."""
        if count > KEPT_VERTICES:
            return np.empty((count, 4))
        if len(self._points) < count:
            self._points = np.empty((count, 4))
        return self._points

    def lists(self, count: int) -> binning.Lists:
        """Room for ``count`` triangles, not cleared."""
        if count > KEPT_TRIANGLES:
            return _lists(count)
        if len(self._lists.places) < count:
            self._lists = _lists(count)
        return self._lists

    def buffers(self, threads: int, count: int = 1) -> Buffers:
        """A row per thread, with room for so many tiles, until the next ones are asked for; no planes are known."""
        if self._buffers.keys.shape != (threads, count * TILE_WIDTH * TILE_HEIGHT):
            self._buffers = _buffers(threads, count)
        self._buffers.known.fill(-1)
        return self._buffers


def _buffers(threads: int, count: int) -> Buffers:
    pixels = count * TILE_WIDTH * TILE_HEIGHT
    sizes = ((pixels,), (pixels,), (count * tiles.BLOCKS,), (2, TILE_HEIGHT), (CACHED,), (CACHED, 6))
    kinds = (np.float64, np.int32, np.float64, np.int64, np.int64, np.float64)
    return Buffers(0, *(empty_aligned((threads, *size), kind) for size, kind in zip(sizes, kinds, strict=True)))


def _lists(count: int) -> binning.Lists:
    return binning.Lists(
        np.empty((count, 3), np.int64),
        np.empty(count, np.uint64),
        np.empty(count),
        np.empty(count, np.int32),
        np.empty((count, 4), np.int32),
        np.empty(count, np.int32),
    )


_memory = _Memory()


def _bin(
    triangles: TriangleArrays,
    chosen: Array,
    projected: tuple[Array, Array],
    frame: Frame,
    how: binning.Listing,
    sides: bool,
) -> tuple[Triangles, Bins]:
    """What is drawn, and for each tile what may touch it."""
    starts = _chunk_starts(triangles.clusters, chosen)
    lists = _memory.lists(int(starts[-1]))
    backless = triangles.single_sided if sides else triangles.single_sided[:0]
    clusters = binning.Clusters(triangles.clusters, triangles.order, chosen, backless)
    kept, counts = binning.classify(projected, triangles.listed, clusters, frame, how, starts, lists)
    crossing = np.concatenate([lists.to_clip[s : s + n] for s, n in zip(starts[:-1], kept[:, 1], strict=True)])
    sides_of = (how.cull, backless, triangles.order)
    clipped = np.empty(((binning.MAX_CLIPPED - 2) * len(crossing), 3), np.int64)
    owners = np.empty(len(clipped), np.int32)
    count = binning.clip_triangles(projected[0], triangles.listed, crossing, frame, sides_of, clipped, owners)
    clipped, owners = clipped[:count], owners[:count]
    extra = np.zeros(counts.shape[1], np.int64)
    nothing = np.zeros(0, np.int64)
    first_entry = len(lists.places)
    binning.bin_clipped(clipped, first_entry, frame, extra, nothing.astype(np.int32), nothing)
    per_tile = counts.sum(axis=0, dtype=np.int64) + extra
    begin = np.concatenate([[0], np.cumsum(per_tile)]).astype(np.int64)
    offsets = begin[:-1] + np.concatenate([np.zeros((1, counts.shape[1]), np.int64), np.cumsum(counts, axis=0)])
    entries = np.empty(int(begin[-1]), np.int32)
    columns = -(-frame.width // TILE_WIDTH)
    last = offsets[-1].copy()
    binning.scatter(lists.boxes, starts, kept, offsets[:-1].copy(), columns, entries)
    if count:
        binning.bin_clipped(clipped, first_entry, frame, extra, entries, last)
    order = np.argsort(-per_tile, kind="stable")  # the heaviest tiles first, so that threads end together
    shape = (triangles.faces, triangles.objects, triangles.order, triangles.listed)
    drawn = Triangles(projected[0], *shape, *lists[:-1], clipped, owners)
    return drawn, Bins(order, begin, entries, np.zeros(1, np.int64))


def _chunk_starts(clusters: Array, chosen: Array) -> Array:
    """Where each chunk's triangles begin in the lists, (chunks + 1,)."""
    chunks = CHUNKS_PER_THREAD * thread_count()
    per = -(-len(chosen) // chunks)
    sizes = np.concatenate([[0], np.cumsum(clusters[chosen, 1] - clusters[chosen, 0])])
    ends = np.minimum(np.arange(chunks + 1) * per, len(chosen))
    return sizes[ends].astype(np.int64)
