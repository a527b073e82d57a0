"""Spatial clusters of triangles: an order that keeps neighbours together, their boxes, and the vertices they need."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel, thread_count
from torchrender.kernels.raster.project import BLOCK

BITS = 7  # of each coordinate in a Morton code: two million cells are plenty for clusters of a hundred triangles
DIGIT = 11  # bits sorted in one pass


@kernel()
def spread(value):
    """The bits of a number below 1024 three places apart."""
    value = (value | (value << 16)) & 0x030000FF
    value = (value | (value << 8)) & 0x0300F00F
    value = (value | (value << 4)) & 0x030C30C3
    return (value | (value << 2)) & 0x09249249


@kernel(parallel=True)
def morton_codes(vertices, faces, starts, codes):
    """Sort keys (F,): the run ``starts[k]..starts[k+1]`` a triangle belongs to, then its place on a Morton curve."""
    steps = (1 << BITS) - 1
    for run in prange(starts.shape[0] - 1):
        low = np.full(3, np.inf)
        high = np.full(3, -np.inf)
        for t in range(starts[run], starts[run + 1]):
            for k in range(3):
                corner = vertices[faces[t, 0], k]
                low[k] = min(low[k], corner)
                high[k] = max(high[k], corner)
        for t in range(starts[run], starts[run + 1]):
            code = np.int64(0)
            for k in range(3):
                size = high[k] - low[k]
                share = (vertices[faces[t, 0], k] - low[k]) / size if size > 0.0 else 0.0
                code |= spread(np.int64(share * steps)) << (2 - k)
            codes[t] = (np.int64(run) << (3 * BITS)) | code


@kernel()
def radix_order(codes, bits):
    """Stable order (F,) int32 of keys below ``1 << bits``."""
    count = codes.shape[0]
    order = np.arange(count).astype(np.int32)
    other = np.zeros(count, np.int32)
    places = np.zeros((1 << DIGIT) + 1, np.int64)
    for shift in range(0, bits, DIGIT):
        places[:] = 0
        for k in range(count):
            places[((codes[k] >> shift) & ((1 << DIGIT) - 1)) + 1] += 1
        for d in range(1 << DIGIT):
            places[d + 1] += places[d]
        for k in range(count):
            digit = (codes[order[k]] >> shift) & ((1 << DIGIT) - 1)
            other[places[digit]] = order[k]
            places[digit] += 1
        order, other = other, order
    return order


@kernel(parallel=True)
def take_vertices(vertices, rows, taken):
    """``taken`` (N,3) = ``vertices[rows]``, by all threads: memory is waited for most of the time."""
    for n in prange(rows.shape[0]):
        v = rows[n]
        taken[n, 0], taken[n, 1], taken[n, 2] = vertices[v, 0], vertices[v, 1], vertices[v, 2]


@kernel(parallel=True)
def cluster_boxes(vertices, faces, order, clusters, boxes):
    """Bounding box (C,2,3) of the triangles ``order[first:end]`` of each cluster."""
    for c in prange(clusters.shape[0]):
        low_x = low_y = low_z = np.inf
        high_x = high_y = high_z = -np.inf
        for place in range(clusters[c, 0], clusters[c, 1]):
            for corner in range(3):
                v = faces[order[place], corner]
                x, y, z = vertices[v, 0], vertices[v, 1], vertices[v, 2]
                low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
                high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
        boxes[c, 0, 0], boxes[c, 0, 1], boxes[c, 0, 2] = low_x, low_y, low_z
        boxes[c, 1, 0], boxes[c, 1, 1], boxes[c, 1, 2] = high_x, high_y, high_z


@kernel(parallel=True)
def collect_blocks(faces, order, clusters, stamps, starts, blocks):
    """Count (into starts[c + 1], while ``blocks`` is empty) or write the vertex blocks of each cluster, each once."""
    chunks = stamps.shape[0]
    per = (clusters.shape[0] + chunks - 1) // chunks
    writing = blocks.shape[0] > 0
    for chunk in prange(chunks):
        begin = np.int64(chunk) * per
        for c in range(begin, min(begin + per, clusters.shape[0])):
            count = 0
            for place in range(clusters[c, 0], clusters[c, 1]):
                for corner in range(3):
                    block = faces[order[place], corner] // BLOCK
                    if stamps[chunk, block] != c + 1:
                        stamps[chunk, block] = c + 1
                        if writing:
                            blocks[starts[c] + count] = block
                        count += 1
            if not writing:
                starts[c + 1] = count


@kernel()
def renumber(faces, order, number, used, renamed, listed):
    """Number vertices as they are first used; returns how many there are.

    ``number`` (V,): -1, becomes the new one of each; ``used`` (V,): the old one of each; ``renamed`` (F,3): faces in
    new numbers; ``listed`` (F,3): these in ``order``.
    """
    count = np.int32(0)
    for place in range(order.shape[0]):
        t = order[place]
        for corner in range(3):
            v = faces[t, corner]
            n = number[v]
            if n < 0:
                n = count
                number[v] = n
                used[n] = v
                count += np.int32(1)
            renamed[t, corner] = n
            listed[place, corner] = n
    return count


def spatial_order(vertices, faces, starts):
    """Triangle ids (F,) int32, run by run, neighbours close together."""
    codes = np.zeros(len(faces), np.int64)
    morton_codes(vertices, faces, starts, codes)
    return radix_order(codes, 3 * BITS + max(len(starts) - 2, 0).bit_length())


def vertex_blocks(faces, order, clusters, vertex_count):
    """Compressed rows: the blocks of BLOCK vertices that cluster c uses are ``blocks[starts[c]:starts[c + 1]]``."""
    total = max(1, -(-vertex_count // BLOCK))
    chunks = thread_count()
    starts = np.zeros(len(clusters) + 1, np.int64)
    collect_blocks(faces, order, clusters, np.zeros((chunks, total), np.int32), starts, np.zeros(0, np.int32))
    starts = np.cumsum(starts)
    blocks = np.zeros(int(starts[-1]), np.int32)
    if len(blocks):
        collect_blocks(faces, order, clusters, np.zeros((chunks, total), np.int32), starts, blocks)
    return starts, blocks


def first_use(faces, order, vertex_count):
    """Vertices (N,) int32 in the order of their first use, faces (F,3) in these numbers, and the same in order."""
    number, used = np.full(vertex_count, -1, np.int32), np.empty(vertex_count, np.int32)
    renamed, listed = np.empty_like(faces), np.empty_like(faces)
    count = renumber(faces, order, number, used, renamed, listed)
    return used[:count].copy(), renamed, listed
