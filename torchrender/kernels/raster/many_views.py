"""Many small pictures: each thread takes whole cameras, from culling to the finished image.

One small picture has too little work to be shared: threads would wait for each other at every step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.binning import (
    MAX_CLIPPED,
    Clusters,
    Lists,
    bin_clipped,
    classify_clusters,
    clip_triangles,
    scatter_list,
)
from torchrender.kernels.raster.coverage import COLUMN_BITS, ROW_BITS, TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.project import needed_blocks, project_block, visible_clusters
from torchrender.kernels.raster.records import (
    Bins,
    Buffers,
    Earlier,
    Frame,
    Limits,
    Refusals,
    Triangles,
    Visible,
)
from torchrender.kernels.raster.tiles import render_tile


class Shape(NamedTuple):
    """A scene's triangles."""

    vertices: np.ndarray  # (V,3) float64
    faces: np.ndarray  # (F,3) int32
    listed: np.ndarray  # (F,3) int32 the same in ``order``
    objects: np.ndarray  # (F,) int64
    clusters: np.ndarray  # (C,2) int64
    cluster_bounds: np.ndarray  # (C,2,3) float64
    order: np.ndarray  # (F,) int32
    block_starts: np.ndarray  # (C+1,) int64
    blocks: np.ndarray  # (N,) int32
    single_sided: np.ndarray  # (F,) bool, or (0,)


class Views(NamedTuple):
    """B cameras that share an image size."""

    matrices: np.ndarray  # (B,3,3)
    references: np.ndarray  # (B,3)
    planes: np.ndarray  # (B,6,4)
    limits: np.ndarray  # (B,2) near and far
    width: int
    height: int
    orthographic: bool


class Room(NamedTuple):
    """What threads work in: a row each, of a view's projected vertices and of :class:`~.records.Buffers`."""

    points: np.ndarray  # (threads,V,4) float64
    packed: np.ndarray  # the same memory as int64
    keys: np.ndarray
    ids: np.ndarray
    lows: np.ndarray
    spans: np.ndarray
    known: np.ndarray
    planes: np.ndarray


@kernel()
def offsets_of(counts):
    """Where each tile's entries begin, (T+1,)."""
    begin = np.zeros(counts.shape[0] + 1, np.int64)
    for k in range(counts.shape[0]):
        begin[k + 1] = begin[k] + counts[k]
    return begin


@kernel()
def list_triangles(shape, pose, frame, how, points, packed, lists):
    """Cull, project, clip and bin: what is drawn, and what each tile draws.

    ``pose``: matrix, reference point and frustum of the camera; ``points`` and ``packed``: its room.
    """
    matrix, reference, planes = pose
    chosen, distance = visible_clusters(shape.cluster_bounds, planes)
    chosen = chosen[np.argsort(distance)]
    for block in needed_blocks(chosen, shape.block_starts, shape.blocks, shape.vertices.shape[0]):
        project_block(shape.vertices, block, matrix, reference, (frame.near, frame.orthographic), points, packed)
    columns = (frame.width + TILE_WIDTH - 1) >> COLUMN_BITS
    rows = (frame.height + TILE_HEIGHT - 1) >> ROW_BITS
    counts = np.zeros(columns * rows, np.int32)
    clusters = Clusters(shape.clusters, shape.order, chosen, shape.single_sided)
    part = (np.int64(0), chosen.shape[0], np.int64(0))
    kept, crossing = classify_clusters((points, packed), shape.listed, clusters, frame, how, part, lists, counts)
    clipped = np.empty(((MAX_CLIPPED - 2) * crossing, 3), np.int64)
    owners = np.empty((MAX_CLIPPED - 2) * crossing, np.int32)
    sides = (how.cull, shape.single_sided, shape.order)
    made = clip_triangles(points, shape.listed, lists.to_clip[:crossing], frame, sides, clipped, owners)
    clipped, owners = clipped[:made], owners[:made]
    first_entry = lists.places.shape[0]
    extra = np.zeros(counts.shape[0], np.int64)
    bin_clipped(clipped, first_entry, frame, extra, np.empty(0, np.int32), extra)
    begin = offsets_of(counts + extra)
    entries = np.empty(begin[-1], np.int32)
    offsets = begin[:-1].copy()
    scatter_list(lists.boxes, 0, kept, columns, offsets, entries)
    if made > 0:
        bin_clipped(clipped, first_entry, frame, extra, entries, offsets)
    corners, bits, highs, places, boxes, _ = lists
    drawn = Triangles(
        points, shape.faces, shape.objects, shape.order, shape.listed,
        corners, bits, highs, places, boxes, clipped, owners,
    )  # fmt: skip
    return drawn, Bins(np.zeros(0, np.int64), begin, entries, np.zeros(0, np.int64))


@kernel()
def draw_one(shape, pose, frame, how, holes, room, lists, outputs):
    """One picture by one thread; ``room``: vertices as floats and integers, :class:`Buffers`."""
    points, packed, buffers = room
    scene, bins = list_triangles(shape, pose, frame, how, points, packed, lists)
    buffers.known[:] = -1
    limits = Limits(np.zeros((0, 0)), np.zeros((0, 0), np.int64))
    earlier = Earlier(
        np.zeros((0, 0, 0), np.int64), np.zeros((0, 3, 4)), np.zeros(0), np.zeros((0, 0, 0), np.float32),
        np.zeros((0, 9)), np.zeros((3, 3)), np.zeros((3, 3)), 0, np.inf, 0.0,
    )  # fmt: skip
    tests = Refusals(limits, earlier, holes)
    for k in range(bins.starts.shape[0] - 1):
        render_tile(scene, bins, frame, tests, k, buffers, outputs)


@kernel(parallel=True)
def draw_views(shape, views, how, holes, room, lists, outputs):
    """Fill ``outputs``, a :class:`~.records.Visible` with a row per camera, of no pixels where only depth is wanted.

    ``shape``: :class:`Shape`; ``views``: :class:`Views`; ``how``: :class:`~.binning.Listing`; ``holes``:
    :class:`~.records.Holes`; ``room``: :class:`Room`; ``lists``: :class:`~.binning.Lists` with a row per thread.
    """
    points, packed, keys, ids, lows, spans_of, known, planes_of = room
    corners, bits, highs, owners, boxes, to_clip = lists
    matrices, references, frustums, limits, width, height, orthographic = views
    depth, triangle, objects, barycentric = outputs
    count = matrices.shape[0]
    counter = np.zeros(1, np.int64)
    for thread in prange(points.shape[0]):
        own = Lists(corners[thread], bits[thread], highs[thread], owners[thread], boxes[thread], to_clip[thread])
        buffers = Buffers(keys[thread], ids[thread], lows[thread], spans_of[thread], known[thread], planes_of[thread])
        while True:
            k = fetch_add(counter, 0, 1)
            if k >= count:
                break
            frame = Frame(width, height, limits[k, 0], limits[k, 1], orthographic)
            pose = (matrices[k], references[k], frustums[k])
            one = Visible(depth[k], triangle[k], objects[k], barycentric[k])
            draw_one(shape, pose, frame, how, holes, (points[thread], packed[thread], buffers), own, one)
