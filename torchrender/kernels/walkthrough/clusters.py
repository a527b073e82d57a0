"""Connected pieces of a cloud of points: who lies within a distance of whom."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel


@kernel()
def root(parent, k):
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@kernel()
def find(keys, wanted):
    """Row of ``wanted`` in the ascending ``keys``, or -1."""
    row = np.searchsorted(keys, wanted)
    return row if row < len(keys) and keys[row] == wanted else -1


@kernel()
def near(position, first, second, limit):
    """Whether two runs of points come within the distance."""
    for a in range(first[0], first[1]):
        for b in range(second[0], second[1]):
            dx = position[a, 0] - position[b, 0]
            dy = position[a, 1] - position[b, 1]
            dz = position[a, 2] - position[b, 2]
            if dx * dx + dy * dy + dz * dz <= limit:
                return True
    return False


@kernel()
def join_cells(keys, starts, stride, offsets, position, limit, parent):
    """Join cells by union-find in ``parent`` (C,).

    ``keys`` (C,) ascending numbers of the cells that hold points ``position[starts[c]:starts[c + 1]]``; ``offsets``
    (K,3) of the neighbours to look at, ``stride`` (3,) of a cell's number along each axis. With ``limit`` >= 0, the
    square of a distance, cells are joined only if two of their points come within it; below 0, always.
    """
    for c in range(len(keys)):
        for k in range(len(offsets)):
            other = find(
                keys, keys[c] + offsets[k, 0] * stride[0] + offsets[k, 1] * stride[1] + offsets[k, 2] * stride[2]
            )
            if other < 0:
                continue
            a, b = root(parent, c), root(parent, other)
            if a == b:
                continue
            own, far = (starts[c], starts[c + 1]), (starts[other], starts[other + 1])
            if limit < 0.0 or near(position, own, far, limit):
                parent[max(a, b)] = min(a, b)
