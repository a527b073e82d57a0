"""Which of the four pixels at a corner of a depth image share a vertex, and at what depth."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

EMPTY, GUESSED, TRUE = 0, 1, 2
"""States of a pixel's corner."""


@kernel()
def shared_words(words):
    """Fill the (64,) words of corners for every set of pairs that share a vertex, as if all four pixels were there.

    Bits 0 to 5 of the index: pairs 01, 02, 03, 12, 13, 23.
    """
    label = np.zeros(4, np.int64)
    for pairs in range(64):
        label[:] = np.arange(4)
        bit = 0
        for a in range(4):
            for b in range(a + 1, 4):
                if (pairs >> bit) & 1:
                    low, high = min(label[a], label[b]), max(label[a], label[b])
                    for k in range(4):
                        label[k] = low if label[k] == high else label[k]
                bit += 1
        word = 0
        for k in range(4):
            word |= label[k] << (2 * k)
            word |= 1 << (8 + k) if label[k] == k else 0
        words[pairs] = word


@kernel(inline=True)
def is_shared(a, b, s, z, t, merge, owner):
    """Whether pixels ``a`` and ``b`` at a corner share a vertex; ``s``, ``z``, ``t``, ``owner``: of all four."""
    near = abs(z[a] - z[b]) <= min(t[a], t[b])
    guessed = (s[a] == GUESSED) & (s[b] == GUESSED) & merge & (owner[a] == owner[b]) & near
    return np.int32(1) if guessed | ((s[a] == TRUE) & (s[b] == TRUE)) else np.int32(0)


@kernel(inline=True)
def part_of(k, n, word, s, z):
    """What pixel ``n`` adds to the sum and number of guesses that share the vertex of pixel ``k``."""
    member = (s[n] == GUESSED) & ((word >> (2 * n)) & 3 == (word >> (2 * k)) & 3)
    return (np.float64(z[n]), 1) if member else (0.0, 0)


@kernel(inline=True)
def merged(k, word, s, z):
    """Depth of the corner of pixel ``k``: of guesses that share a vertex the mean."""
    z0, n0 = part_of(k, 0, word, s, z)
    z1, n1 = part_of(k, 1, word, s, z)
    z2, n2 = part_of(k, 2, word, s, z)
    z3, n3 = part_of(k, 3, word, s, z)
    count = n0 + n1 + n2 + n3
    return np.float32((z0 + z1 + z2 + z3) / max(count, 1)) if (s[k] == GUESSED) & (count > 1) else z[k]


@kernel(inline=True)
def group(s, z, t, owner, merge, words):
    """Who shares the corner: the word of ``joined``, and the depths, of merged guesses their mean; no branches.

    ``s``, ``z``, ``t``, ``owner``: state, depth, tolerance and object of the four pixels.
    """
    pairs = is_shared(0, 1, s, z, t, merge, owner) | is_shared(0, 2, s, z, t, merge, owner) << 1
    pairs |= is_shared(0, 3, s, z, t, merge, owner) << 2 | is_shared(1, 2, s, z, t, merge, owner) << 3
    pairs |= is_shared(1, 3, s, z, t, merge, owner) << 4 | is_shared(2, 3, s, z, t, merge, owner) << 5
    word = np.int64(words[np.uintp(pairs)])
    there = (s[0] != EMPTY) | (s[1] != EMPTY) << 1 | (s[2] != EMPTY) << 2 | (s[3] != EMPTY) << 3
    true = (s[0] == TRUE) | (s[1] == TRUE) << 1 | (s[2] == TRUE) << 2 | (s[3] == TRUE) << 3
    word = word & 255 | word & (np.int64(there) << 8) | np.int64(true) << 12
    depths = (merged(0, word, s, z), merged(1, word, s, z), merged(2, word, s, z), merged(3, word, s, z))
    return np.int32(word), depths
