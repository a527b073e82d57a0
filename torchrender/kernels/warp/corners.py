"""Corners of the quads that stand for the samples of a depth image: test them, guess them, let neighbours share them.

Pixel (j,i) has corner 0 at its top left, 1 bottom left, 2 bottom right, 3 top right. Around image corner (j,i) lie up
to four pixels; pixel ``k`` of them is the one whose own corner ``k`` this is. Specification 02, sections 3.2 and 3.3.

``joined`` (B,H+1,W+1) int32 tells for each image corner which of the four share one vertex: bits 2k and 2k+1 hold the
lowest member of pixel ``k``'s group, bit 8+k is set if ``k`` is the lowest member of a group, bit 12+k if the sample of
pixel ``k`` accepts the corner of the offset image.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corner_groups import EMPTY, GUESSED, TRUE, group, shared_words

BAND = 16  # corner rows handed to a thread at once
EDGE_ON = 1e-6
ALONE = 0 | (1 << 2) | (2 << 4) | (3 << 6)
DIAGONAL, FIRST, SECOND = 1, 2, 4
"""Bits of a quad's shape: split from corner 1 to 3 instead of 0 to 2; first and second triangle present."""


class Images(NamedTuple):
    """B depth images and what their corners are tested against."""

    depth: np.ndarray  # (B,H,W) float32
    normal: np.ndarray  # (B,H,W,3) float32
    ids: np.ndarray  # (B,H,W) int64, or (B,0,0): all are of one object
    offset_depth: np.ndarray  # (B,H+1,W+1) float32 of the images shifted by half a pixel, or (B,0,0)
    offset_ids: np.ndarray  # (B,H+1,W+1) int64, or (B,0,0)
    matrices: np.ndarray  # (B,3,3) from a world normal to its product with the ray of homogeneous pixel coordinates
    limits: np.ndarray  # (B,4) rows of :class:`Limits`


class Limits(NamedTuple):
    """When a corner is true, and how far a guess may go."""

    tau_a: float  # share of the depth: a number of footprints
    tau_b: float
    rho: float
    near: float


class Image(NamedTuple):
    """The same of one image."""

    depth: np.ndarray
    normal: np.ndarray
    ids: np.ndarray
    offset_depth: np.ndarray
    offset_ids: np.ndarray
    matrix: np.ndarray
    limits: Limits


class Judged(NamedTuple):
    """The four corners of a row of pixels, with a margin column on either side."""

    state: np.ndarray  # (4,W+2) uint8 EMPTY, GUESSED or TRUE
    value: np.ndarray  # (4,W+2) float32 depth
    tolerance: np.ndarray  # (4,W+2) float32


class Spare(NamedTuple):
    """One thread's room."""

    plane: np.ndarray  # (4,W)
    stored: np.ndarray  # (W,) float32
    usual: np.ndarray  # (W+1,) bool corners of a row that need no closer look
    shared: np.ndarray  # (64,) int32 words of corners by the pairs that share a vertex


@kernel(inline=True)
def plane_row(j, image, plane):
    """Tangent plane of every sample of row ``j``: ``plane`` (4,W) = n.s, n.d at corner 0, its step right and down."""
    depth, normal, matrix = image.depth, image.normal, image.matrix
    sample, slope, right, down = plane[0], plane[1], plane[2], plane[3]
    a00, a01, a02 = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    a10, a11, a12 = matrix[1, 0], matrix[1, 1], matrix[1, 2]
    a20, a21, a22 = matrix[2, 0], matrix[2, 1], matrix[2, 2]
    v = np.float64(j)
    for i in range(np.uintp(depth.shape[1])):
        nx, ny, nz = np.float64(normal[j, i, 0]), np.float64(normal[j, i, 1]), np.float64(normal[j, i, 2])
        x = a00 * nx + a01 * ny + a02 * nz
        y = a10 * nx + a11 * ny + a12 * nz
        n = a20 * nx + a21 * ny + a22 * nz + x * np.float64(i) + y * v
        sample[i] = np.float64(depth[j, i]) * (n + 0.5 * (x + y))
        slope[i], right[i], down[i] = n, x, y


@kernel(inline=True)
def stored_row(k, j, image, stored):
    """What the offset image shows at corner ``k`` of the pixels of row ``j``; +inf where it shows another object."""
    seen, seen_ids, ids = image.offset_depth, image.offset_ids, image.ids
    row = np.uintp(j + (1 if k in (1, 2) else 0))
    step = np.uintp(1 if k >= 2 else 0)
    for i in range(np.uintp(stored.shape[0])):
        stored[i] = seen[row, i + step]
    if ids.shape[0] > 0:
        for i in range(np.uintp(stored.shape[0])):
            if seen_ids[row, i + step] != ids[j, i]:
                stored[i] = np.inf


@kernel(inline=True)
def judge_row(k, depth, plane, stored, limits, judged):
    """State, final depth and tolerance of corner ``k`` for a row of samples; no branches, so that it vectorises."""
    tau_a, tau_b, rho, near = limits
    state, value, tolerance = judged.state[k], judged.value[k], judged.tolerance[k]
    sample, slope, right, down = plane[0], plane[1], plane[2], plane[3]
    lower = 1.0 if k in (1, 2) else 0.0
    across = 1.0 if k >= 2 else 0.0
    shrink = 1.0 / rho
    for i in range(np.uintp(depth.shape[0])):
        z = np.float64(depth[i])
        n = slope[i] + lower * down[i] + across * right[i]
        predicted = sample[i] / n
        usable = (abs(n) >= EDGE_ON) & (predicted > 0.0) & (predicted < np.inf)
        target = predicted if usable else z
        margin = tau_a * z + tau_b * abs(target - z)
        seen = np.float64(stored[i])
        true = abs(seen - target) <= margin
        guess = z * shrink if target < z * shrink else target
        guess = z * rho if guess > z * rho else guess
        guess = near if guess < near else guess
        filled = z < np.inf
        state[i + np.uintp(1)] = np.uint8((TRUE if true else GUESSED) if filled else EMPTY)
        value[i + np.uintp(1)] = np.float32((seen if true else guess) if filled else np.inf)
        tolerance[i + np.uintp(1)] = np.float32(margin if filled else 0.0)


@kernel()
def judge_pixels(j, image, judged, spare):
    """The four corners of every pixel of row ``j``."""
    plane, stored = spare.plane, spare.stored
    plane_row(j, image, plane)
    for k in range(4):
        if image.offset_depth.shape[0] > 0:
            stored_row(k, j, image, stored)
        judge_row(k, image.depth[j], plane, stored, image.limits, judged)


@kernel(inline=True)
def join_usual(above, below, merge, joined, usual):
    """``joined`` of the corners around which nothing is, all corners are true, or (``merge``) all guesses agree.

    ``usual`` tells which these are; no branches, so that it vectorises.
    """
    full, agreed, alone = np.int32(0xF << 12 | 1 << 8), np.int32(1 << 8), np.int32(ALONE)
    for i in range(np.uintp(joined.shape[0])):
        n = i + np.uintp(1)
        s0, s1, s2, s3 = below.state[0, n], above.state[1, n], above.state[2, i], below.state[3, i]
        z0, z1, z2, z3 = below.value[0, n], above.value[1, n], above.value[2, i], below.value[3, i]
        t0, t1, t2, t3 = below.tolerance[0, n], above.tolerance[1, n], above.tolerance[2, i], below.tolerance[3, i]
        margin = min(min(t0, t1), min(t2, t3))
        guessed = (s0 == GUESSED) & (s1 == GUESSED) & (s2 == GUESSED) & (s3 == GUESSED)
        agree = merge & guessed & (max(max(z0, z1), max(z2, z3)) - min(min(z0, z1), min(z2, z3)) <= margin)
        true = (s0 == TRUE) & (s1 == TRUE) & (s2 == TRUE) & (s3 == TRUE)
        mean = (z0 + z1 + z2 + z3) * np.float32(0.25)
        below.value[0, n] = mean if agree else z0
        above.value[1, n] = mean if agree else z1
        above.value[2, i] = mean if agree else z2
        below.value[3, i] = mean if agree else z3
        word = full if true else alone
        joined[i] = agreed if agree else word
        usual[i] = agree | true | ((s0 | s1 | s2 | s3) == EMPTY)


@kernel(inline=True)
def owners(ids, j, i, s):
    """Objects of the four pixels at corner (j,i); 0 where there is no pixel."""
    return (
        ids[j, i] if s[0] != EMPTY else 0,
        ids[j - 1, i] if s[1] != EMPTY else 0,
        ids[j - 1, i - 1] if s[2] != EMPTY else 0,
        ids[j, i - 1] if s[3] != EMPTY else 0,
    )


@kernel()
def join_row(above, below, ids, j, merge, spare, joined):
    """``joined`` of corner row ``j`` from the judged pixel rows above and below; merged depths go back into them."""
    usual, match = spare.usual, ids.shape[0] > 0
    join_usual(above, below, merge and not match, joined, usual)
    for i in range(np.uintp(joined.shape[0])):
        if usual[i]:
            continue
        n = i + np.uintp(1)
        s = (below.state[0, n], above.state[1, n], above.state[2, i], below.state[3, i])
        z = (below.value[0, n], above.value[1, n], above.value[2, i], below.value[3, i])
        t = (below.tolerance[0, n], above.tolerance[1, n], above.tolerance[2, i], below.tolerance[3, i])
        owner = owners(ids, j, np.int64(i), s) if match else (0, 0, 0, 0)
        joined[i], z = group(s, z, t, owner, merge, spare.shared)
        below.value[0, n], above.value[1, n], above.value[2, i], below.value[3, i] = z


@kernel()
def fit_band(first, last, image, merge, rows, spare, corners, joined):
    """Corner rows ``first`` to ``last`` - 1 of one image."""
    height, width = image.depth.shape
    above, below = rows
    above.state[:] = EMPTY
    if first > 0:
        judge_pixels(first - 1, image, above, spare)
    for j in range(first, last):
        if j < height:
            judge_pixels(j, image, below, spare)
        else:
            below.state[:] = EMPTY
        join_row(above, below, image.ids, j, merge, spare, joined[j])
        if j > 0:
            corners[j - 1, 1] = above.value[1, 1 : width + 1]
            corners[j - 1, 2] = above.value[2, 1 : width + 1]
        if j < height:
            corners[j, 0] = below.value[0, 1 : width + 1]
            corners[j, 3] = below.value[3, 1 : width + 1]
        above, below = below, above


@kernel(parallel=True)
def fit(images, merge, threads, corners, joined):
    """Corner depths (B,H,4,W) float32 and ``joined`` (B,H+1,W+1) of :class:`Images`."""
    depth, normal, ids, stored, stored_ids, matrices, limits = images
    count, height, width = depth.shape
    bands = (height + BAND) // BAND
    counter = np.zeros(1, np.int64)
    for _ in prange(threads):
        state = np.zeros((2, 4, width + 2), np.uint8)
        value = np.full((2, 4, width + 2), np.inf, np.float32)
        tolerance = np.zeros((2, 4, width + 2), np.float32)
        rows = (Judged(state[0], value[0], tolerance[0]), Judged(state[1], value[1], tolerance[1]))
        shared = np.zeros(64, np.int32)
        shared_words(shared)
        spare = Spare(
            np.zeros((4, width)),
            np.full(width, np.inf, np.float32),
            np.zeros(width + 1, np.bool_),
            shared,
        )
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= count * bands:
                break
            b, first = turn // bands, (turn % bands) * BAND
            limit = Limits(limits[b, 0], limits[b, 1], limits[b, 2], limits[b, 3])
            image = Image(depth[b], normal[b], ids[b], stored[b], stored_ids[b], matrices[b], limit)
            last = min(first + BAND, height + 1)
            fit_band(first, last, image, merge, rows, spare, corners[b], joined[b])


@kernel(parallel=True)
def split(corners, adaptive, shape):
    """Shape bits (B,H,W) of each quad: both triangles where the pixel is filled, split along the flatter diagonal."""
    count, height, _, width = corners.shape
    for n in prange(count * height):
        b, j = np.int64(n) // height, np.int64(n) % height
        for i in range(np.uintp(width)):
            z0, z1, z2, z3 = corners[b, j, 0, i], corners[b, j, 1, i], corners[b, j, 2, i], corners[b, j, 3, i]
            bits = np.uint8(FIRST | SECOND) if z0 < np.inf else np.uint8(0)
            if adaptive and abs(z1 - z3) < abs(z0 - z2):
                bits |= np.uint8(DIAGONAL)
            shape[b, j, i] = bits
