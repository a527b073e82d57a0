"""Visibility of many light samples from many receivers: packets of neighbouring receivers through a triangle tree.

All rays of one packet start at one light sample. A ray aims either at the receiver itself or at the centre of the
shadow-map texel that the receiver falls into; in the second case the answer is that of the whole shadow map, of which
nothing is drawn but the texels that somebody asks for.

The tree is searched once for a group of receivers and a tile of the light: what reaches into the shaft between them is
listed, and the packets of the tile's samples only ask the list.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.boxes import SCALE
from torchrender.kernels.rays.bvh_build import STACK
from torchrender.kernels.rays.ray_packet import (
    CHOSEN,
    DARK,
    GROUP,
    LIT,
    OUTSIDE,
    TRACED,
    Packet,
    block_listed,
    block_packet,
    make_packet,
)
from torchrender.kernels.shadows.shaft_culling import ABOVE, NONE, Receivers, collect, make_shaft

LIMIT, COLUMN, ROW, FACE = 3, 4, 5, 6
"""Places in a ray; its direction of depth one comes first."""

LISTED = 512
"""Triangles listed for a group of receivers and a part of the light; where there are more, the tree is searched."""


class LightViews(NamedTuple):
    """The light's samples and the shadow-map cameras at each of them; lengths in scene units."""

    samples: np.ndarray  # (S,3) float64
    rotations: np.ndarray  # (S,F,3,3) float64, rows: right, down, forward; F faces around each sample
    focal: np.ndarray  # (S,) float64 pixels
    names: np.ndarray  # (S,) int64 bit in which each sample's result is stored
    size: int  # texels of a side
    near: float
    constant_bias: float  # share of the depth
    slope_bias: float  # texel footprints per unit of tan(theta)
    largest_slope: float  # cap of tan(theta)
    texels: bool  # aim at texel centres
    outline: np.ndarray  # (3,3) float64 corner and edges of the parallelogram that holds all samples
    tiles: np.ndarray  # (G,3,3) float64 the same of parts of the light
    runs: np.ndarray  # (2,G+1) int64 samples runs[q,g] to runs[q,g+1] lie in tile g. Those of q = 0, the probes, are
    # traced first; a group that sees none of them is in umbra. Without probes all are traced


@kernel(inline=True)
def _aim(points, normals, i, views, s, ray):
    """One receiver and one light sample: its state, and in ``ray`` direction of depth one, depth limit, texel, face."""
    px, py, pz = points[i, 0], points[i, 1], points[i, 2]
    dx, dy, dz = px - views.samples[s, 0], py - views.samples[s, 1], pz - views.samples[s, 2]
    nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
    facing = -(nx * dx + ny * dy + nz * dz)
    if not facing > 0.0:
        return DARK
    rotation = views.rotations
    face, z = 0, -np.inf
    for f in range(rotation.shape[1]):
        depth = rotation[s, f, 2, 0] * dx + rotation[s, f, 2, 1] * dy + rotation[s, f, 2, 2] * dz
        if depth > z:
            face, z = f, depth
    if not z > views.near:
        return OUTSIDE
    focal, half = views.focal[s], 0.5 * views.size
    a = (rotation[s, face, 0, 0] * dx + rotation[s, face, 0, 1] * dy + rotation[s, face, 0, 2] * dz) / z
    b = (rotation[s, face, 1, 0] * dx + rotation[s, face, 1, 1] * dy + rotation[s, face, 1, 2] * dz) / z
    u, v = np.floor(focal * a + half), np.floor(focal * b + half)
    if u < 0.0 or v < 0.0 or u >= views.size or v >= views.size:
        return OUTSIDE
    length2 = dx * dx + dy * dy + dz * dz
    across2 = length2 * (nx * nx + ny * ny + nz * nz) - facing * facing
    cap = views.largest_slope
    slope = (
        np.sqrt(across2) / facing if 0.0 < across2 < cap * cap * facing * facing else (cap if across2 > 0.0 else 0.0)
    )
    ray[LIMIT] = z - z * (views.constant_bias + views.slope_bias * slope / focal)
    ray[COLUMN], ray[ROW], ray[FACE] = u, v, face
    if not ray[LIMIT] > 0.0:
        return LIT
    if views.texels:
        a, b = (u + 0.5 - half) / focal, (v + 0.5 - half) / focal
        for k in range(3):
            ray[k] = a * rotation[s, face, 0, k] + b * rotation[s, face, 1, k] + rotation[s, face, 2, k]
    else:
        ray[0], ray[1], ray[2] = dx / z, dy / z, dz / z
    return TRACED


class _Scratch(NamedTuple):
    """One thread's room for a group."""

    rays: np.ndarray  # (GROUP,4) direction and limit
    status: np.ndarray  # (GROUP,) int64
    packet: Packet
    ray: np.ndarray  # (7,)
    stack: np.ndarray  # (STACK,) int32


@kernel(inline=True)
def _trace_sample(tree, group, views, s, listed, scratch):
    """States of a group's receivers under one sample: DARK, LIT or OUTSIDE; returns how many are outside.

    ``listed`` = (slots of the triangles that count, how many; more than there is room for: search the tree).
    """
    rays, status, packet, ray, stack = scratch
    points, normals, begin, members = group
    slots, count = listed
    scale = tree.frame[SCALE]
    pending, missed = np.int64(0), np.int64(0)
    status[:] = DARK
    for j in range(members):
        state = _aim(points, normals, begin + j, views, s, ray)
        if state == TRACED and count == 0:
            state = LIT
        missed += np.int64(state == OUTSIDE)
        pending += np.int64(state == TRACED)
        for k in range(4):
            rays[j, k] = ray[k]
        rays[j, LIMIT] *= scale
        status[j] = state
    origin = (views.samples[s, 0] * scale, views.samples[s, 1] * scale, views.samples[s, 2] * scale)
    near = views.near * scale
    while pending > 0:
        alive, farthest = make_packet(rays, status, packet)
        pending -= alive
        if count <= slots.shape[0]:
            block_listed(tree.corners, slots, count, origin, near, farthest, alive, packet)
        else:
            block_packet(tree, origin, near, farthest, alive, packet, stack)
        for j in range(members):
            if status[j] == CHOSEN:
                status[j] = LIT if packet.rays[2, j] > 0.0 else DARK
    return missed


@kernel(parallel=True)
def light_bits(tree, points, normals, views, skip, threads, bits, outside):
    """Which light samples each receiver sees.

    Args:
        tree: :class:`~torchrender.kernels.rays.bvh_build.Bvh`.
        points, normals: (P,3) float64 receivers, neighbours next to each other; normals face the viewer.
        views: :class:`LightViews`.
        skip: look for groups that nothing can shadow.
        threads: workers.
        bits: (P,ceil(S/64)) int64, zero; bit k % 64 of word k // 64 is set where the sample of name k is visible.
        outside: (threads,) int64, advanced by the number of pairs outside every shadow map (they count as lit), groups
            apart that nothing can shadow.
    """
    count, samples, tiles = points.shape[0], views.samples.shape[0], views.tiles.shape[0]
    groups = (count + GROUP - 1) // GROUP
    turn = np.zeros(1, np.int64)
    filled = tree.corners.shape[0] > 0
    for thread in prange(threads):
        status, stack, shaft = np.zeros(GROUP, np.int64), np.zeros(STACK, np.int32), np.zeros((8, 4))
        packet = Packet(np.zeros((3, 3)), np.zeros((5, 7)), np.zeros((3, GROUP)))
        scratch = _Scratch(np.zeros((GROUP, 4)), status, packet, np.zeros(7), stack)
        slots, listed = np.zeros((tiles, LISTED), np.int32), np.zeros(tiles, np.int64)
        missed = np.int64(0)
        while True:
            group = fetch_add(turn, 0, 1)
            if group >= groups:
                break
            begin = group * GROUP
            members = min(count - begin, GROUP)
            own = Receivers(points, normals, begin, members)
            if filled and skip and make_shaft(own, views.outline, views, shaft) == ABOVE:
                if collect(tree, shaft, stack, slots[0], 0) == 0:
                    for s in range(samples):
                        for j in range(members):
                            bits[begin + j, views.names[s] >> 6] |= np.int64(1) << np.int64(views.names[s] & 63)
                    continue
            for g in range(tiles):
                listed[g] = LISTED + 1 if filled else 0
                if filled and make_shaft(own, views.tiles[g], views, shaft) != NONE:
                    listed[g] = collect(tree, shaft, stack, slots[g], LISTED)
            seen = 0
            for q in range(2):
                if q == 1 and seen == 0 and views.runs[0, tiles] > 0:
                    break
                for g in range(tiles):
                    for s in range(views.runs[q, g], views.runs[q, g + 1]):
                        lists = (slots[g], listed[g])
                        missed += _trace_sample(tree, own, views, s, lists, scratch)
                        word, bit = views.names[s] >> 6, np.int64(1) << np.int64(views.names[s] & 63)
                        for j in range(members):
                            if status[j] == LIT or status[j] == OUTSIDE:
                                bits[begin + j, word] |= bit
                                seen += 1
        outside[thread] = missed


@kernel(parallel=True)
def look_up(maps, points, normals, views, s, bits, outside):
    """One light sample's bits from its whole shadow map ``maps`` (F,size,size); arguments as in :func:`light_bits`."""
    count = points.shape[0]
    parts = outside.shape[0]
    name = views.names[s]
    word, bit = name >> 6, np.int64(1) << np.int64(name & 63)
    for part in prange(parts):
        ray = np.zeros(7)
        for i in range(np.int64(part) * count // parts, (np.int64(part) + 1) * count // parts):
            state = _aim(points, normals, i, views, s, ray)
            if state == DARK:
                continue
            outside[part] += np.int64(state == OUTSIDE)
            if state == TRACED and np.float64(maps[int(ray[FACE]), int(ray[ROW]), int(ray[COLUMN])]) < ray[LIMIT]:
                continue
            bits[i, word] |= bit
