"""From quads with shared corners to one indexed mesh: count rows, then write every row at its place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corners import DIAGONAL


class Joined(NamedTuple):
    """The quads of B images; see ``corners``."""

    corners: np.ndarray  # (B,H,4,W) float32 depths
    joined: np.ndarray  # (B,H+1,W+1) int32
    shape: np.ndarray  # (B,H,W) uint8


class Vertices(NamedTuple):
    """N vertices, corner row after corner row."""

    position: np.ndarray  # (N,3) float64
    corner: np.ndarray  # (N,) int64 number within its image
    guessed: np.ndarray  # (N,) bool
    color: np.ndarray  # (N,3) float32, or no rows


class Faces(NamedTuple):
    """M quads, pixel row after pixel row."""

    corners: np.ndarray  # (2M,3) int32
    source: np.ndarray  # (M,) int64 pixel within its image
    counts: np.ndarray  # (B*H,5) int64 quads with 0 to 4 true corners in each row


@kernel(inline=True)
def leaders_below(word, k):
    """How many vertices of a corner come before the one that pixel ``k`` uses."""
    label = (word >> (2 * k)) & 3
    marks = (word >> 8) & ((1 << label) - 1)
    return np.int64((marks & 1) + ((marks >> 1) & 1) + ((marks >> 2) & 1))


@kernel(inline=True)
def leaders(word):
    return np.int64(((word >> 8) & 1) + ((word >> 9) & 1) + ((word >> 10) & 1) + ((word >> 11) & 1))


@kernel(parallel=True)
def count_rows(joined, shape, vertices, quads):
    """Vertices in each corner row (B*(H+1),) and quads in each pixel row (B*H,)."""
    count, rows, columns = joined.shape
    for n in prange(count * rows):
        b, j = np.int64(n) // rows, np.int64(n) % rows
        total = np.int64(0)
        for i in range(columns):
            total += leaders(joined[b, j, i])
        vertices[b * rows + j] = total
        if j < rows - 1:
            filled = np.int64(0)
            for i in range(columns - 1):
                filled += np.int64(shape[b, j, i] != 0)
            quads[b * (rows - 1) + j] = filled


@kernel(inline=True)
def corner_depth(corners, b, j, i, k):
    """Corner ``k`` of the pixel for which image corner (j,i) is that corner."""
    return np.float64(corners[b, j - (1 if k == 1 or k == 2 else 0), k, i - (1 if k >= 2 else 0)])


@kernel(inline=True)
def write_vertices(b, j, at, quads, pose, vertices):
    """Vertices of corner row ``j``: position, corner number, whether guessed."""
    corners, joined, _ = quads
    position, place, guessed, _ = vertices
    columns = joined.shape[2]
    for i in range(columns):
        word = joined[b, j, i]
        for k in range(4):
            if not (word >> (8 + k)) & 1:
                continue
            z = corner_depth(corners, b, j, i, k)
            for a in range(3):
                ray = pose[a, 0] * i + (pose[a, 1] * j + pose[a, 2])
                position[at, a] = z * ray + pose[a, 3]
            place[at] = j * columns + i
            guessed[at] = not (word >> (12 + k)) & 1
            at += 1


@kernel(inline=True)
def write_color(b, j, at, joined, color, out):
    """Mean colour of the samples around each vertex of corner row ``j``."""
    for i in range(joined.shape[2]):
        word = joined[b, j, i]
        for leader in range(4):
            if not (word >> (8 + leader)) & 1:
                continue
            r = g = s = np.float32(0.0)
            members = np.float32(0.0)
            for k in range(4):
                if (word >> (2 * k)) & 3 == leader:
                    y, x = j - (1 if k == 1 or k == 2 else 0), i - (1 if k >= 2 else 0)
                    r += color[b, y, x, 0]
                    g += color[b, y, x, 1]
                    s += color[b, y, x, 2]
                    members += np.float32(1.0)
            out[at, 0], out[at, 1], out[at, 2] = r / members, g / members, s / members
            at += 1


@kernel(inline=True)
def write_faces(b, j, top, bottom, at, quads, made, counts):
    """Faces of pixel row ``j``; ``top`` and ``bottom``: first vertex of the corner rows above and below."""
    _, joined, shape = quads
    faces, source, _ = made
    columns = shape.shape[2]
    for i in range(columns):
        w0, w1, w2, w3 = joined[b, j, i], joined[b, j + 1, i], joined[b, j + 1, i + 1], joined[b, j, i + 1]
        bits = shape[b, j, i]
        next_top, next_bottom = top + leaders(w0), bottom + leaders(w1)
        if bits != 0:
            c0, c1 = top + leaders_below(w0, 0), bottom + leaders_below(w1, 1)
            c2, c3 = next_bottom + leaders_below(w2, 2), next_top + leaders_below(w3, 3)
            if bits & DIAGONAL:
                c0, c1, c2, c3 = c1, c2, c3, c0
            faces[2 * at, 0], faces[2 * at, 1], faces[2 * at, 2] = c0, c1, c2
            faces[2 * at + 1, 0], faces[2 * at + 1, 1], faces[2 * at + 1, 2] = c2, c3, c0
            source[at] = j * columns + i
            counts[((w0 >> 12) & 1) + ((w1 >> 13) & 1) + ((w2 >> 14) & 1) + ((w3 >> 15) & 1)] += 1
            at += 1
        top, bottom = next_top, next_bottom


@kernel(parallel=True)
def write_mesh(quads, poses, color, first_vertex, first_quad, vertices, faces):
    """Fill the mesh of B images.

    ``quads``: :class:`Joined`; ``poses`` (B,3,4): world = z P[:, :3] (u, v, 1) + P[:, 3]; ``first_vertex``
    (B*(H+1),) and ``first_quad`` (B*H,): where each row begins; ``color`` (B,H,W,3) or no elements; ``vertices``:
    :class:`Vertices`, ``faces``: :class:`Faces`, filled.
    """
    joined, tint, counts = quads.joined, vertices.color, faces.counts
    count, rows, _ = joined.shape
    for n in prange(count * rows):
        b, j = np.int64(n) // rows, np.int64(n) % rows
        here = b * rows + j
        write_vertices(b, j, first_vertex[here], quads, poses[b], vertices)
        if color.shape[0] > 0:
            write_color(b, j, first_vertex[here], joined, color, tint)
        if j < rows - 1:
            row = b * (rows - 1) + j
            top, bottom = first_vertex[here], first_vertex[here + 1]
            write_faces(b, j, top, bottom, first_quad[row], quads, faces, counts[row])
