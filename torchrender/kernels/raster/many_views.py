"""Pictures without lists of triangles: cluster by cluster, what is hidden is left out before it is looked at.

Of many small pictures, each thread takes whole cameras, from culling to the finished image: one has too little work to
be shared, and threads would wait for each other at every step. Of a large one each thread takes regions of tiles that
fit into its cache.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import Eye
from torchrender.kernels.raster.binning import Listing
from torchrender.kernels.raster.chosen import write_line
from torchrender.kernels.raster.direct import (
    Canvas,
    box_within,
    clear_canvas,
    cluster_reaches,
    draw_cluster,
    is_box_hidden,
    refresh_lows,
    tile_buffers,
)
from torchrender.kernels.raster.lanes.rows import COLUMN_BITS, ROW_BITS, TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.project import BLOCK, project_block, visible_clusters
from torchrender.kernels.raster.records import Buffers, Earlier, Frame, Holes, Limits, Refusals, Triangles, Visible
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


class Regions(NamedTuple):
    """One camera's picture as it is cut for threads."""

    matrix: np.ndarray  # (3,3)
    reference: np.ndarray  # (3,)
    order: np.ndarray  # (N,) int64 numbers, row by row, in the order in which they are drawn
    width: int  # pixels, of whole tiles
    height: int


class Found(NamedTuple):
    """Clusters in view, nearly front to back."""

    chosen: np.ndarray  # (N,) int64
    boxes: np.ndarray  # (N,4) int64 pixels that they may touch, see :func:`~.direct.cluster_reach`
    highs: np.ndarray  # (N,) float64 keys that none of their fragments exceeds
    projected: np.ndarray  # (blocks,) bool of vertices that are projected already


@kernel()
def region_loads(found, runs, size, loads):
    """Add the triangles of what is in view to the regions that it may touch.

    ``found``: :class:`Found`; ``size``: columns and rows of pixels of a region; ``loads`` (rows, columns) int64.
    """
    chosen, boxes, _, _ = found
    wide, tall = size
    for n in range(chosen.shape[0]):
        if boxes[n, 0] > boxes[n, 2] or boxes[n, 1] > boxes[n, 3]:
            continue
        for j in range(boxes[n, 1] // tall, boxes[n, 3] // tall + 1):
            for i in range(boxes[n, 0] // wide, boxes[n, 2] // wide + 1):
                loads[j, i] += runs[chosen[n], 1] - runs[chosen[n], 0]


@kernel()
def draw_clusters(shape, found, pose, frame, how, tests, room, canvas):
    """Project and draw what may be seen of the clusters; ``pose``: matrix and reference point of the camera.

    Returns what was drawn.
    """
    matrix, reference = borrowed(pose)
    points, packed, buffers = room
    chosen, boxes, highs, projected = borrowed(found)
    scene = Triangles(
        points, shape.faces, shape.objects, shape.order, shape.listed, np.empty((0, 3), np.int64),
        np.empty(0, np.uint64), np.empty(0), np.empty(0, np.int32), np.empty((0, 4), np.int32),
        np.empty((0, 3), np.int64), np.empty(0, np.int32),
    )  # fmt: skip
    sides = (how.cull, shape.single_sided)
    chunk = room_for(shape.clusters, chosen)
    own = (chunk, np.empty(chunk.a.shape[0], np.int32))
    for n in range(chosen.shape[0]):
        box = box_within(canvas, (boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3]))
        if box[0] > box[2] or box[1] > box[3] or is_box_hidden(canvas, box, highs[n]):
            continue
        c = chosen[n]
        for place in range(shape.block_starts[c], shape.block_starts[c + 1]):
            block = shape.blocks[place]
            if not projected[block]:
                projected[block] = True
                limits = (frame.near, frame.orthographic)
                project_block(shape.vertices, block, matrix, reference, limits, points, packed)
        run = (shape.clusters[c, 0], shape.clusters[c, 1])
        if draw_cluster(scene, packed, run, frame, sides, tests, (canvas, buffers), own) > 0:
            refresh_lows(canvas, box)
    return scene


@kernel()
def draw_part(shape, found, pose, frame, how, room, canvas, outputs):
    """The part of a picture that the canvas holds, by one thread.

    ``how``: :class:`~.binning.Listing` and :class:`~.records.Holes`; ``room``: vertices as floats and integers,
    :class:`Buffers`.
    """
    listing, holes = how
    limits = Limits(np.zeros((0, 0)), np.zeros((0, 0), np.int64))
    earlier = Earlier(
        np.zeros((0, 0, 0), np.int64), np.zeros((0, 3, 4)), np.zeros(0), np.zeros((0, 0, 0), np.float32),
        np.zeros((0, 9)), np.zeros((3, 3)), np.zeros((3, 3)), 0, np.inf, 0.0,
    )  # fmt: skip
    clear_canvas(canvas, frame)
    scene = draw_clusters(shape, found, pose, frame, listing, Refusals(limits, earlier, holes), room, canvas)
    rows = (canvas.bottom - canvas.top + TILE_HEIGHT) >> ROW_BITS
    for tile in range(canvas.columns * rows):
        left = canvas.left + ((tile % canvas.columns) << COLUMN_BITS)
        top = canvas.top + ((tile // canvas.columns) << ROW_BITS)
        place = (left, top, min(TILE_WIDTH, canvas.right + 1 - left), min(TILE_HEIGHT, canvas.bottom + 1 - top))
        resolve(scene, frame, place, tile_buffers(canvas, tile, room[2]), outputs)


@kernel()
def draw_one(shape, pose, frame, how, room, canvas, outputs):
    """One picture by one thread; ``pose``: matrix, reference point and frustum of the camera."""
    room[2].known[:] = -1
    chosen, distance = visible_clusters(shape.cluster_bounds, pose[2])
    chosen = chosen[np.argsort(distance)]
    count = chosen.shape[0]
    found = Found(
        chosen,
        np.empty((count, 4), np.int64),
        np.empty(count),
        np.zeros((shape.vertices.shape[0] + BLOCK - 1) // BLOCK, np.bool_),
    )
    own = (pose[0], pose[1])
    cluster_reaches(shape.cluster_bounds, chosen, own, frame, found.boxes, found.highs)
    draw_part(shape, found, own, frame, how, room, canvas, outputs)


@kernel(parallel=True)
def draw_regions(shape, found, regions, frame, how, holes, room, outputs):
    """Fill ``outputs``, a :class:`~.records.Visible`, of one camera: regions of tiles, handed out to threads.

    ``found``: :class:`Found`, all of whose vertices are projected; ``regions``: :class:`Regions`; ``room``: as of
    :func:`draw_views`, but vertices are shared.
    """
    points, packed, keys, ids, lows, spans_of, known, planes_of = room
    matrix, reference, order, wide, tall = regions
    across = (frame.width + wide - 1) // wide
    counter = np.zeros(1, np.int64)
    for thread in prange(keys.shape[0]):
        buffers = Buffers(
            0, keys[thread], ids[thread], lows[thread], spans_of[thread], known[thread], planes_of[thread]
        )
        own = (points, packed, buffers)
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= order.shape[0]:
                break
            left, top = (order[turn] % across) * wide, (order[turn] // across) * tall
            right, bottom = min(left + wide, frame.width) - 1, min(top + tall, frame.height) - 1
            canvas = Canvas(keys[thread], ids[thread], lows[thread], wide >> COLUMN_BITS, left, top, right, bottom)
            draw_part(shape, found, (matrix, reference), frame, (how, holes), own, canvas, outputs)


@kernel(inline=True)
def has_rows(surface):
    """True if any attribute is wanted."""
    count = surface.position.shape[0] + surface.normal.shape[0] + surface.geometric.shape[0] + surface.uv.shape[0]
    return count + surface.footprint.shape[0] + surface.color.shape[0] + surface.material.shape[0] > 0


@kernel()
def write_picture(mesh, eyes, k, image, outputs):
    """Attributes of picture ``k``, whose :class:`~.attributes.Hits` are ``image``."""
    mesh, eyes, image, outputs = borrowed(mesh), borrowed(eyes), borrowed(image), borrowed(outputs)
    height, width = image[1].shape
    rays, origin, forward = borrowed((eyes.rays[k], eyes.origins[k], eyes.forwards[k]))
    eye = Eye(rays, origin, forward, eyes.footprints[k], eyes.orthographic)
    for y in range(height):
        write_line(mesh, eye, (image, y, (k * height + y) * width), outputs)


@kernel(parallel=True)
def draw_views(shape, views, how, room, outputs, mesh, eyes, surface):
    """Fill ``outputs``, a :class:`~.records.Visible` with a row per camera, of no pixels where only depth is wanted.

    An image of ``outputs`` that nobody keeps has a row per thread instead. ``shape``: :class:`Shape`; ``views``:
    :class:`Views`; ``how``: what to cull, and :class:`~.records.Holes`; ``room``: :class:`Room`; ``mesh``, ``eyes``,
    ``surface``: attributes to write, see :class:`~.chosen.Wanted`.
    """
    points, packed, keys, ids, lows, spans_of, known, planes_of = room
    matrices, references, frustums, limits, width, height, orthographic = views
    depth, triangle, objects, barycentric = outputs
    cull, mask, table, texels, uv = how
    count = matrices.shape[0]
    columns = (width + TILE_WIDTH - 1) >> COLUMN_BITS
    counter = np.zeros(1, np.int64)
    for thread in prange(points.shape[0]):
        buffers = Buffers(
            0, keys[thread], ids[thread], lows[thread], spans_of[thread], known[thread], planes_of[thread]
        )
        own = (points[thread], packed[thread], buffers)
        canvas = Canvas(keys[thread], ids[thread], lows[thread], columns, 0, 0, width - 1, height - 1)
        while True:
            k = fetch_add(counter, 0, 1)
            if k >= count:
                break
            frame = Frame(width, height, limits[k, 0], limits[k, 1], orthographic)
            pose = (matrices[k], references[k], frustums[k])
            spare = np.int64(thread)  # unsigned
            one = Visible(
                depth[k if depth.shape[0] == count else spare],
                triangle[k if triangle.shape[0] == count else spare],
                objects[k if objects.shape[0] == count else spare],
                barycentric[k if barycentric.shape[0] == count else spare],
            )
            listing = Listing(cull, True, mask)
            draw_one(shape, pose, frame, (listing, Holes(mask, table, texels, uv)), own, canvas, one)
            if has_rows(surface):
                write_picture(mesh, eyes, k, (one.depth, one.triangle, one.barycentric), surface)
