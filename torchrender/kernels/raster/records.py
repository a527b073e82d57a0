"""What the rasteriser's kernels hand to each other."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Frame(NamedTuple):
    """An image and the depths it holds."""

    width: int
    height: int
    near: float
    far: float
    orthographic: bool


class Triangles(NamedTuple):
    """Projected triangles: N listed ones, then M that were clipped."""

    points: np.ndarray  # (V,4) float64: homogeneous pixel about the image centre, and place of the snapped one
    faces: np.ndarray  # (F,3) int32
    objects: np.ndarray  # (F,) int64
    order: np.ndarray  # (F,) int32 triangle ids, cluster by cluster
    listed: np.ndarray  # (F,3) int32 faces in this order
    corners: np.ndarray  # (N,3) int64 snapped
    bits: np.ndarray  # (N,) uint64 covered pixels of a window, or 0
    highs: np.ndarray  # (N,) float64 keys that no fragment exceeds
    places: np.ndarray  # (N,) int32 in the order
    boxes: np.ndarray  # (N,4) int32 first pixel of the box or window, last pixel of the box
    clipped: np.ndarray  # (M,3) int64 snapped
    owners: np.ndarray  # (M,) int32 places in the order


class Bins(NamedTuple):
    """Triangles of each tile: places in the lists, or N plus the number of a clipped one."""

    order: np.ndarray  # (T,) int64 tiles, in the order in which they are drawn
    starts: np.ndarray  # (T+1,) int64 first entry of each tile
    entries: np.ndarray  # (E,) int32
    turn: np.ndarray  # (1,) int64, zero: tiles handed out to threads


class Limits(NamedTuple):
    """Only fragments farther than the key and of another triangle pass; without elements all do."""

    keys: np.ndarray  # (H,W) float64
    ids: np.ndarray  # (H,W) int64


class Earlier(NamedTuple):
    """J perspective images that may have a fragment already (specification 01, sections 5 and 13); J may be 0."""

    ids: np.ndarray  # (J,h,w) int64
    pixels: np.ndarray  # (J,3,4): (x, y, 1, key) of this image about its centre to homogeneous pixels over depth
    near: np.ndarray  # (J,)
    depth: np.ndarray  # (J,h,w) float32
    lenses: np.ndarray  # (J,9) rows of :class:`EarlierLens`
    matrix: np.ndarray  # (3,3) from world to homogeneous pixels of this image
    inverse: np.ndarray  # (3,3)
    test: int  # IDENTITY, AGREES or CAPTURED
    ratio: float  # a copy whose footprint is this many times larger does not count
    footprint: float  # of this image per unit of depth


class EarlierLens(NamedTuple):
    """One earlier image's projection, and its eye in homogeneous pixels of the image that is drawn."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float
    footprint: float  # pixel size per unit of depth
    eye_x: float
    eye_y: float
    eye_w: float


SOLID = 128
"""Alpha at the cutoff, in the units of :attr:`Holes.texels`."""


class Holes(NamedTuple):
    """Missing texels of triangles; see ``scene.cutout``. Without elements there are none."""

    mask: np.ndarray  # (F,) int32 row of the table, or -1
    table: np.ndarray  # (K,4) int64 first texel, height, width, wraps: along u plus three times along v
    texels: np.ndarray  # uint8 alpha over cutoff, times SOLID
    uv: np.ndarray  # (V,3) float32 coordinates, opacity


class Refusals(NamedTuple):
    """What may refuse a fragment before it enters the depth buffer."""

    limits: Limits
    earlier: Earlier
    holes: Holes


class Buffers(NamedTuple):
    """A tile in the making; with a row per thread in front where threads take tiles."""

    first: int  # where its pixels begin in keys and ids
    keys: np.ndarray  # (pixels,) float64
    ids: np.ndarray  # (pixels,) int32
    lows: np.ndarray  # (tiles * blocks,) float64 least keys of blocks, or less
    spans: np.ndarray  # (2,rows) int64 first and last pixel of each row
    known: np.ndarray  # (CACHED,) int64 triangles whose planes are kept
    planes: np.ndarray  # (CACHED,6) their barycentric planes


class Visible(NamedTuple):
    """The image; all but the depth have no elements where only that is wanted."""

    depth: np.ndarray  # (H,W) float32
    triangle: np.ndarray  # (H,W) int64
    object_id: np.ndarray  # (H,W) int64
    barycentric: np.ndarray  # (H,W,2) float32


class Stored(NamedTuple):
    """What an image holds, before which surfaces are counted."""

    depth: np.ndarray  # (H,W) float32
    triangle: np.ndarray  # (H,W) int64


class Nearer(NamedTuple):
    """Surfaces before those stored."""

    number: np.ndarray  # (H,W) int32
    touching: np.ndarray  # (H,W) bool: the nearest of them touches the stored one
    worth: np.ndarray  # (F,) int32 what a triangle adds to the number, modulo 2^32; (0,): one each


NO_LIMITS = Limits(np.zeros((0, 0)), np.zeros((0, 0), np.int64))
NO_EARLIER = Earlier(
    np.zeros((0, 0, 0), np.int64),
    np.zeros((0, 3, 4)),
    np.zeros(0),
    np.zeros((0, 0, 0), np.float32),
    np.zeros((0, 9)),
    np.zeros((3, 3)),
    np.zeros((3, 3)),
    0,
    np.inf,
    0.0,
)
NO_HOLES = Holes(np.zeros(0, np.int32), np.zeros((0, 4), np.int64), np.zeros(0, np.uint8), np.zeros((0, 3), np.float32))
NO_IDS = (np.zeros((0, 0), np.int64), np.zeros((0, 0), np.int64), np.zeros((0, 0, 2), np.float32))
