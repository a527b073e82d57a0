"""Points in eight bytes: cells of the patch's box, quantised normals and a palette of radii.

Bytes: 0 to 2 coarse cell; 3 fine cell (3, 3 and 2 bits); 4 and 5 normal; 6 tangent choices, corner, 1 where the normal
is unknown; 7 radius. Source: specification 06, section 8.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

ANGLES, OCTAHEDRON = 0, 1
CELLS_LONG, CELLS_SHORT = 2048, 1024


class Boxes(NamedTuple):
    """Boxes of N patches, about their centres."""

    half: np.ndarray  # (N,3) float64 half extents
    short: np.ndarray  # (N,) int64 shortest axis, which gets fewer cells


class Tables(NamedTuple):
    """What codes stand for."""

    palette: np.ndarray  # (256,) radii, ascending
    directions: np.ndarray  # (65536,3) the normal of every pair of bytes
    tints: np.ndarray  # (256,) linear light of sRGB codes


@kernel(inline=True)
def encode_normal(x, y, z, kind):
    """Two bytes of a unit normal: polar angles, or the unfolded octahedron."""
    if kind == ANGLES:
        theta = math.acos(min(1.0, max(-1.0, z)))
        phi = math.atan2(y, x)
        if phi < 0.0:
            phi += 2.0 * math.pi
        return min(int(theta * (256.0 / math.pi)), 255), min(int(phi * (128.0 / math.pi)), 255)
    s = 1.0 / (abs(x) + abs(y) + abs(z))
    a, b = x * s, y * s
    if z < 0.0:
        a, b = (1.0 - abs(b)) * (1.0 if a >= 0.0 else -1.0), (1.0 - abs(a)) * (1.0 if b >= 0.0 else -1.0)
    return min(int((a + 1.0) * 128.0), 255), min(int((b + 1.0) * 128.0), 255)


@kernel(inline=True)
def decode_normal(first, second, kind):
    """Unit normal at the middle of its interval."""
    if kind == ANGLES:
        theta, phi = (first + 0.5) * (math.pi / 256.0), (second + 0.5) * (math.pi / 128.0)
        s = math.sin(theta)
        return s * math.cos(phi), s * math.sin(phi), math.cos(theta)
    a, b = (first + 0.5) / 128.0 - 1.0, (second + 0.5) / 128.0 - 1.0
    z = 1.0 - abs(a) - abs(b)
    if z < 0.0:
        a, b = (1.0 - abs(b)) * (1.0 if a >= 0.0 else -1.0), (1.0 - abs(a)) * (1.0 if b >= 0.0 else -1.0)
    s = 1.0 / math.sqrt(a * a + b * b + z * z)
    return a * s, b * s, z * s


@kernel(inline=True)
def longest_tangent(x, y, z):
    """Which of n x e_0, n x e_1, n x e_2 is longest: that of the smallest component."""
    x, y, z = abs(x), abs(y), abs(z)
    if x <= y and x <= z:
        return 0
    return 1 if y <= z else 2


@kernel(inline=True)
def nearest_radius(palette, value):
    """Index of the palette's nearest entry; the palette ascends."""
    high = np.searchsorted(palette, value)
    if high == 0:
        return 0
    if high == len(palette):
        return high - 1
    return high - 1 if value - palette[high - 1] <= palette[high] - value else high


@kernel(parallel=True)
def encode_nodes(nodes, start, boxes, palette, kind, codes):
    """Codes (T,8) of the :class:`Nodes` of N patches: ``start`` (N,L+1), ``boxes``: :class:`Boxes`."""
    position, normal, radius = nodes.position, nodes.normal, nodes.radius
    half, short = boxes
    for patch in prange(len(short)):
        axes = (1 if short[patch] == 0 else 0, 1 if short[patch] == 2 else 2, short[patch])
        for node in range(start[patch, 0], start[patch, -1]):
            fine = 0
            for place in range(3):
                axis = axes[place]
                cells = CELLS_SHORT if place == 2 else CELLS_LONG
                extent = half[patch, axis]
                share = 0.5 * (position[node, axis] / extent + 1.0) if extent > 0.0 else 0.5
                cell = min(max(int(share * cells), 0), cells - 1)
                bits = 2 if place == 2 else 3
                codes[node, place] = cell >> bits
                fine = (fine << bits) | (cell & ((1 << bits) - 1))
            codes[node, 3] = fine
            x, y, z = np.float64(normal[node, 0]), np.float64(normal[node, 1]), np.float64(normal[node, 2])
            if x == 0.0 and y == 0.0 and z == 0.0:
                codes[node, 4], codes[node, 5], codes[node, 6] = 0, 0, 1
            else:
                codes[node, 4], codes[node, 5] = encode_normal(x, y, z, kind)
                codes[node, 6] = longest_tangent(x, y, z) << 6
            codes[node, 7] = nearest_radius(palette, radius[node])


@kernel(parallel=True)
def decode_nodes(codes, colors, rows, first, boxes, tables, nodes):
    """Nodes of S runs ``rows`` (S,2) of the codes, side by side from ``first`` (S,) on; ``boxes``: :class:`Boxes`.

    ``tables``: :class:`Tables`; ``nodes``: :class:`Nodes`, filled.
    """
    palette, directions, tints = tables
    position, normal, radius, color, has_color = nodes
    half, short = boxes
    for run in prange(len(rows)):
        axes = (1 if short[run] == 0 else 0, 1 if short[run] == 2 else 2, short[run])
        at = first[run]
        for node in range(rows[run, 0], rows[run, 1]):
            fine = np.int64(codes[node, 3])
            c0 = (np.int64(codes[node, 0]) << 3) | (fine >> 5)
            c1 = (np.int64(codes[node, 1]) << 3) | ((fine >> 2) & 7)
            c2 = (np.int64(codes[node, 2]) << 2) | (fine & 3)
            position[at, axes[0]] = ((c0 + 0.5) * (2.0 / CELLS_LONG) - 1.0) * half[run, axes[0]]
            position[at, axes[1]] = ((c1 + 0.5) * (2.0 / CELLS_LONG) - 1.0) * half[run, axes[1]]
            position[at, axes[2]] = ((c2 + 0.5) * (2.0 / CELLS_SHORT) - 1.0) * half[run, axes[2]]
            known = np.float32(1.0) if codes[node, 6] & 3 == 0 else np.float32(0.0)
            pair = np.int64(codes[node, 4]) * 256 + codes[node, 5]
            for c in range(3):
                normal[at, c] = directions[pair, c] * known
            radius[at] = palette[codes[node, 7]]
            if has_color:
                for c in range(3):
                    color[at, c] = tints[colors[node, c]]
            at += 1


@kernel()
def direction_table(kind, directions):
    """The normal of every pair of bytes."""
    for first in range(256):
        for second in range(256):
            row = directions[first * 256 + second]
            row[0], row[1], row[2] = decode_normal(first, second, kind)
