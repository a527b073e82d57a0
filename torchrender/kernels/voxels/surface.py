"""Surface voxels: every triangle once, bits set in packed words. Source: specification 05, section 4.

A row of cells along x fills ``ceil(nx / 64)`` words; cell i is bit ``i % 64`` of word ``i // 64``.
"""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add, store_or
from torchrender.kernels.compile import kernel
from torchrender.kernels.voxels.bits import span
from torchrender.kernels.voxels.cells import cells_of, dominant_axis, load_corners

BLOCK = 512  # triangles handed to a thread at once


@kernel(inline=True)
def thread_arrays(threads, room):
    """Scratch for ``threads`` triangles at a time. Kept by the caller while :func:`thread_views` are in use."""
    return np.zeros((threads, 15, 4)), np.zeros((threads, 2, 3), np.int64), np.empty((threads, room), np.int64)


@kernel(inline=True)
def thread_views(scratch, thread):
    """Corners, cells and workspace of one thread."""
    numbers, places, cells = scratch
    n = numbers[thread]
    vectors = (borrowed(n[9]), borrowed(n[10]), borrowed(n[11]))
    work = (*vectors, borrowed(n[:9]), borrowed(places[thread, 0]), borrowed(places[thread, 1]))
    return borrowed(n[12:15]), borrowed(cells[thread]), work


@kernel(parallel=True)
def mark_surface(soup, room, threads, words, tally):
    """Set the bits of the cells that triangles meet.

    Args:
        soup: :class:`~torchrender.kernels.voxels.cells.Soup`.
        room: most cells that one triangle can meet.
        words: (nz ny nw,) uint64, changed in place.
        tally: (3,) int64, advanced: next block, pairs of triangle and cell, triangles without area.
    """
    total = len(soup.faces)
    blocks = (total + BLOCK - 1) // BLOCK
    bits = borrowed(words)
    scratch = thread_arrays(threads, room)
    for thread in prange(threads):
        p, cells, work = thread_views(scratch, thread)
        own = borrowed(soup)
        pairs, flat = np.int64(0), np.int64(0)
        while True:
            block = fetch_add(tally, 0, 1)
            if block >= blocks:
                break
            for t in range(block * BLOCK, min((block + 1) * BLOCK, total)):
                count = cells_of(own, t, p, cells, work)
                if count < 0:
                    flat += 1
                    continue
                pairs += count
                for n in range(count):
                    word, bit = cells[n] >> 6, np.uint64(1) << np.uint64(cells[n] & 63)
                    if bits[word] & bit == np.uint64(0):
                        store_or(bits, word, bit)
        fetch_add(tally, 1, pairs)
        fetch_add(tally, 2, flat)


@kernel(parallel=True)
def classify(vertices, faces, axes):
    """Dominant axis of each triangle, -1 without area, into ``axes`` (F,) int8."""
    origin = np.zeros(3)
    for block in prange((len(faces) + BLOCK - 1) // BLOCK):
        p, normal = np.zeros((3, 3)), np.zeros(3)
        first, last = span(block, BLOCK, len(faces))
        for t in range(first, last):
            load_corners(vertices, faces, t, origin, 1.0, p)
            axes[t] = dominant_axis(p, normal)
