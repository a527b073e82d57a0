"""Whole grids of packed bits: counting, and filling from the border. Source: specification 05, section 5.2."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(inline=True)
def ones_in(word):
    """Number of set bits of a uint64."""
    word -= (word >> np.uint64(1)) & np.uint64(0x5555555555555555)
    word = (word & np.uint64(0x3333333333333333)) + ((word >> np.uint64(2)) & np.uint64(0x3333333333333333))
    word = (word + (word >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
    return np.int64((word * np.uint64(0x0101010101010101)) >> np.uint64(56))


@kernel(inline=True)
def span(block, size, count):
    """First and one-past-last of ``count`` items in a block of ``size``."""
    first = np.int64(block) * size
    return first, min(first + size, count)


@kernel(parallel=True)
def count_ones(words):
    """Number of set bits of a flat uint64 array."""
    total = np.int64(0)
    for i in prange(len(words)):
        total += ones_in(words[i])
    return total


@kernel(parallel=True)
def count_runs(words, per_run, counts):
    """Set bits of each run of ``per_run`` words into ``counts``."""
    for r in prange(len(counts)):
        total = np.int64(0)
        for w in range(np.int64(r) * per_run, (np.int64(r) + 1) * per_run):
            total += ones_in(words[w])
        counts[r] = total


@kernel(parallel=True)
def list_ones(words, per_run, starts, numbers):
    """Numbers of all set bits in ascending order; ``starts`` = exclusive sums of :func:`count_runs`."""
    for r in prange(len(starts)):
        n = starts[r]
        for w in range(np.int64(r) * per_run, (np.int64(r) + 1) * per_run):
            word = words[w]
            while word != np.uint64(0):
                lowest = word & (~word + np.uint64(1))
                numbers[n] = w * 64 + ones_in(lowest - np.uint64(1))
                n += 1
                word ^= lowest


@kernel(inline=True)
def spread_up(seed, free):
    """Bits reached from ``seed`` through runs of ``free`` bits towards higher places."""
    for s in (1, 2, 4, 8, 16, 32):
        seed |= free & (seed << np.uint64(s))
        free &= free << np.uint64(s)
    return seed


@kernel(inline=True)
def spread_down(seed, free):
    for s in (1, 2, 4, 8, 16, 32):
        seed |= free & (seed >> np.uint64(s))
        free &= free >> np.uint64(s)
    return seed


@kernel(inline=True)
def spread_row(reached, free, k, j):
    """Spread along a row of words in both directions; returns whether anything changed."""
    changed = False
    carry = np.uint64(0)
    nw = reached.shape[2]
    for w in range(nw):
        before = reached[k, j, w]
        after = spread_up((before | carry) & free[k, j, w], free[k, j, w])
        carry = after >> np.uint64(63)
        reached[k, j, w] = after
        changed |= after != before
    carry = np.uint64(0)
    for w in range(nw - 1, -1, -1):
        before = reached[k, j, w]
        after = spread_down((before | carry) & free[k, j, w], free[k, j, w])
        carry = after << np.uint64(63)
        reached[k, j, w] = after
        changed |= after != before
    return changed


@kernel(parallel=True)
def spread_planes(reached, free, changed):
    """One sweep over the rows of each plane, forth and back; ``changed`` (nz,) bool."""
    nz, ny, nw = reached.shape
    for k in prange(nz):
        different = spread_row(reached, free, k, 0)
        for j in range(1, ny):
            for w in range(nw):
                more = reached[k, j - 1, w] & free[k, j, w] & ~reached[k, j, w]
                reached[k, j, w] |= more
                different |= more != np.uint64(0)
            different |= spread_row(reached, free, k, j)
        for j in range(ny - 2, -1, -1):
            for w in range(nw):
                more = reached[k, j + 1, w] & free[k, j, w] & ~reached[k, j, w]
                if more != np.uint64(0):
                    reached[k, j, w] |= more
                    spread_row(reached, free, k, j)
                    different = True
        changed[k] = different


@kernel(parallel=True)
def spread_across(reached, free, changed):
    """One sweep from plane to plane, forth and back; ``changed`` (ny,) bool."""
    nz, ny, nw = reached.shape
    for j in prange(ny):
        different = False
        for step in range(2 * nz - 2):
            k = step + 1 if step < nz - 1 else 2 * nz - 3 - step
            source = k - 1 if step < nz - 1 else k + 1
            for w in range(nw):
                more = reached[source, j, w] & free[k, j, w] & ~reached[k, j, w]
                if more != np.uint64(0):
                    reached[k, j, w] |= more
                    different = True
        changed[j] = different
