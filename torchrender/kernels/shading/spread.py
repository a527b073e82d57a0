"""Numbers of the materials to the pixels that have them."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import MOST_KINDS

_NONE = np.uint32(0xFFFFFFFF)
_ONE = np.uint32(1)


@kernel(counted=False)
def kinds_of(mat, n, kinds):
    """Which materials the first ``n`` pixels have, in rising order; -> how many, 0 if more than ``kinds`` holds.

    Each turn looks for the next one in all pixels: several pixels at a time, as no branch depends on one.
    """
    least, count = np.uint32(0), 0
    while True:
        found = _NONE
        for i in range(n):
            m = mat[i]
            found = min(found, m if m >= least else _NONE)
        if found == _NONE:
            return count
        if count == MOST_KINDS:
            return 0
        kinds[count] = found
        count += 1
        least = np.uint32(found + _ONE)


@kernel(counted=False)
def spread(work, n, slot, numbers, column):
    """A number of the materials into ``slot`` of all pixels; after :func:`kinds_of` has told which there are."""
    to, mat, kinds, count = work.s[slot:], work.mat, work.kinds, work.found[3]
    if count == 0:
        for i in range(n):
            to[i] = np.float32(numbers[mat[i], column])
        return
    first = np.float32(numbers[kinds[0], column])
    for i in range(n):
        to[i] = first
    for k in range(1, count):
        m = kinds[k]
        value = np.float32(numbers[m, column])
        if value != first:
            for i in range(n):
                to[i] = value if mat[i] == m else to[i]
