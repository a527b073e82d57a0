"""Many small pictures: each thread takes whole cameras, from culling to the finished image.

One small picture has too little work to be shared: threads would wait for each other at every step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.coverage import COLUMN_BITS, ROW_BITS, TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.direct import (
    Canvas,
    clear_canvas,
    cluster_reach,
    draw_cluster,
    is_cluster_hidden,
    tile_buffers,
)
from torchrender.kernels.raster.project import BLOCK, project_block, visible_clusters
from torchrender.kernels.raster.records import Buffers, Earlier, Frame, Limits, Refusals, Triangles, Visible
from torchrender.kernels.raster.resolve import resolve
from torchrender.kernels.raster.samples import room_for


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
    keys: np.ndarray  # (threads,tiles << PIXEL_BITS)
    ids: np.ndarray
    lows: np.ndarray
    spans: np.ndarray
    known: np.ndarray
    planes: np.ndarray


@kernel()
def draw_clusters(shape, pose, frame, how, tests, room, canvas):
    """Cull, project and draw; ``pose``: matrix, reference point and frustum of the camera. Returns what was drawn."""
    matrix, reference, planes = borrowed(pose)
    points, packed, buffers = room
    scene = Triangles(
        points, shape.faces, shape.objects, shape.order, shape.listed, np.empty((0, 3), np.int64),
        np.empty(0, np.uint64), np.empty(0), np.empty(0, np.int32), np.empty((0, 4), np.int32),
        np.empty((0, 3), np.int64), np.empty(0, np.int32),
    )  # fmt: skip
    sides = (how.cull, shape.single_sided)
    projected = np.zeros((shape.vertices.shape[0] + BLOCK - 1) // BLOCK, np.bool_)
    chosen, distance = visible_clusters(shape.cluster_bounds, planes)
    chunk = room_for(shape.clusters, chosen)
    own = (chunk, np.empty(chunk.a.shape[0], np.int32))
    for c in chosen[np.argsort(distance)]:
        reach = cluster_reach(shape.cluster_bounds, c, matrix, reference, frame)
        if is_cluster_hidden(canvas, reach):
            continue
        for n in range(shape.block_starts[c], shape.block_starts[c + 1]):
            block = shape.blocks[n]
            if not projected[block]:
                projected[block] = True
                limits = (frame.near, frame.orthographic)
                project_block(shape.vertices, block, matrix, reference, limits, points, packed)
        run = (shape.clusters[c, 0], shape.clusters[c, 1])
        draw_cluster(scene, packed, run, frame, sides, tests, (canvas, buffers), own)
    return scene


@kernel()
def draw_one(shape, pose, frame, how, holes, room, canvas, outputs):
    """One picture by one thread; ``room``: vertices as floats and integers, :class:`Buffers`."""
    buffers = room[2]
    buffers.known[:] = -1
    limits = Limits(np.zeros((0, 0)), np.zeros((0, 0), np.int64))
    earlier = Earlier(
        np.zeros((0, 0, 0), np.int64), np.zeros((0, 3, 4)), np.zeros(0), np.zeros((0, 0, 0), np.float32),
        np.zeros((0, 9)), np.zeros((3, 3)), np.zeros((3, 3)), 0, np.inf, 0.0,
    )  # fmt: skip
    clear_canvas(canvas, frame)
    scene = draw_clusters(shape, pose, frame, how, Refusals(limits, earlier, holes), room, canvas)
    for tile in range(canvas.keys.shape[0] // (TILE_WIDTH * TILE_HEIGHT)):
        left, top = (tile % canvas.columns) << COLUMN_BITS, (tile // canvas.columns) << ROW_BITS
        place = (left, top, min(TILE_WIDTH, frame.width - left), min(TILE_HEIGHT, frame.height - top))
        resolve(scene, frame, place, tile_buffers(canvas, tile, buffers), outputs)


@kernel(parallel=True)
def draw_views(shape, views, how, holes, room, outputs):
    """Fill ``outputs``, a :class:`~.records.Visible` with a row per camera, of no pixels where only depth is wanted.

    ``shape``: :class:`Shape`; ``views``: :class:`Views`; ``how``: :class:`~.binning.Listing`; ``holes``:
    :class:`~.records.Holes`; ``room``: :class:`Room`.
    """
    points, packed, keys, ids, lows, spans_of, known, planes_of = room
    matrices, references, frustums, limits, width, height, orthographic = views
    depth, triangle, objects, barycentric = outputs
    count = matrices.shape[0]
    columns = (width + TILE_WIDTH - 1) >> COLUMN_BITS
    counter = np.zeros(1, np.int64)
    for thread in prange(points.shape[0]):
        buffers = Buffers(
            0, keys[thread], ids[thread], lows[thread], spans_of[thread], known[thread], planes_of[thread]
        )
        own = (points[thread], packed[thread], buffers)
        canvas = Canvas(keys[thread], ids[thread], columns)
        while True:
            k = fetch_add(counter, 0, 1)
            if k >= count:
                break
            frame = Frame(width, height, limits[k, 0], limits[k, 1], orthographic)
            pose = (matrices[k], references[k], frustums[k])
            one = Visible(depth[k], triangle[k], objects[k], barycentric[k])
            draw_one(shape, pose, frame, how, holes, own, canvas, one)
