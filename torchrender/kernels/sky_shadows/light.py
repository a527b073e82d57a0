"""Light at points among spheres: which texels the spheres hide, and what the others send.

The bits of all spheres are joined by OR; counts of bits in blocks of 4 x 4 texels weigh light times cosine of whole
blocks, and the two finest levels of wavelets of what is hidden, looked up by the blocks' codes, meet those of the
light. Source: specification 08, sections 5, 6.1 and 8.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numba.cpython.unsafe.numbers import trailing_zeros

from torchrender.kernels.compile import kernel
from torchrender.kernels.sky_shadows.caps import BLOCKS, ROWS, SIDE, WORDS, add_cap, pack_blocks

SKIP, BLOCK, HALF = 0, 1, 2
"""What a sphere does to a point inside it: nothing, hide everything, or hide the half-space towards its centre."""


class Samples(NamedTuple):
    """P points."""

    position: np.ndarray  # (P,3) float64
    normal: np.ndarray  # (P,3) float32 unit
    own: np.ndarray  # (P,) int32 the sphere that is not looked at; nor others of its body around the point; -1: none
    solid: np.ndarray  # (P,) int32 what spheres around the point do: SKIP, BLOCK or HALF
    shift: np.ndarray  # (P,3) float32 added to column, row and radius before the table rounds them, -0.5 to 0.5


class Caps(NamedTuple):
    """The table of caps; without rows: caps are found one by one."""

    bits: np.ndarray  # (6144 R, 96) int64
    filled: np.ndarray  # (6144 R,) int64 rows of blocks that hold a bit
    radii: int  # R
    smallest: float  # relative radii below are left out


class Light(NamedTuple):
    """Light times cosine, by normal; N stored normals, K fine wavelets of the light in order of their blocks."""

    whole: np.ndarray  # (N,4) float32 without anything hidden; the fourth is that of even light
    block: np.ndarray  # (N,384,4) float32 of the 16th part of a block
    mean: np.ndarray  # (N,K) float32 mean cosine over pi in the wavelet's square
    value: np.ndarray  # (K,4) float32 of the wavelet
    column: np.ndarray  # (K,) int32 in the table of codes
    start: np.ndarray  # (385,) int32 first wavelet of each block
    cells: int  # cells of a cube face between stored normals, which are blended; negative: the nearest of so many


@kernel()
def count_blocks(words, counts):
    """Bits in each of the 384 codes of words (96,) int64."""
    even, pairs, nibbles = np.uint64(0x5555555555555555), np.uint64(0x3333333333333333), np.uint64(0x0F0F0F0F0F0F0F0F)
    for w in range(WORDS):
        x = np.uint64(words[w])
        x = x - ((x >> np.uint64(1)) & even)
        x = (x & pairs) + ((x >> np.uint64(2)) & pairs)
        x = (x + (x >> np.uint64(4))) & nibbles
        x = x + (x >> np.uint64(8))
        for part in range(4):
            counts[4 * w + part] = np.int32((x >> np.uint64(16 * part)) & np.uint64(31))


@kernel(inline=True)
def texel_index(x, y, z, right, down):
    """Number of the texel of the direction (x, y, z), moved by so many texels within its face; of equal axes the first
    counts. No branches."""
    a, b, c = abs(x), abs(y), abs(z)
    first, second = (a >= b) & (a >= c), b >= c
    major = a if first else (b if second else c)
    along = x if first else (y if second else z)
    face = (0 if first else (2 if second else 4)) + (0 if along >= 0.0 else 1)
    u = (-z if along >= 0.0 else z) if first else (x if second else (x if along >= 0.0 else -x))
    v = -y if first or not second else (z if along >= 0.0 else -z)
    scale = 16.0 / major if major > 0.0 else 0.0
    column = min(max(int(u * scale + 16.0 + right), 0), SIDE - 1)
    row = min(max(int(v * scale + 16.0 + down), 0), SIDE - 1)
    return (face * SIDE + row) * SIDE + column


@kernel()
def scratch_of(spheres):
    """What :func:`hide` works in: rows of caps, columns of the spheres (4,S) centre and radius, entries, states."""
    count = spheres.shape[0]
    columns = np.empty((4, count))
    for s in range(count):
        for c in range(4):
            columns[c, s] = spheres[s, c]
    return np.zeros(ROWS, np.uint32), columns, np.zeros(count, np.int64), np.zeros(count, np.uint8)


@kernel()
def find_entries(samples, i, columns, caps, entry, state):
    """Row ``entry`` (S,) of the table of caps for each sphere as sample i sees it, -1 at its centre, and its ``state``
    (S,): 0 behind the surface or left out, 1 before it, 2 around the sample.

    Without branches, so that spheres go through the processor several at a time.
    """
    px, py, pz = samples.position[i, 0], samples.position[i, 1], samples.position[i, 2]
    nx, ny, nz = np.float64(samples.normal[i, 0]), np.float64(samples.normal[i, 1]), np.float64(samples.normal[i, 2])
    bins, smallest = caps.radii, caps.smallest
    right, down, wider = (
        np.float64(samples.shift[i, 0]), np.float64(samples.shift[i, 1]), np.float64(samples.shift[i, 2])
    )  # fmt: skip
    for s in range(columns.shape[1]):
        x, y, z, radius = columns[0, s] - px, columns[1, s] - py, columns[2, s] - pz, columns[3, s]
        distance = math.sqrt(x * x + y * y + z * z)
        around = distance <= radius
        size = 1.0 if around else radius / distance
        row = texel_index(x, y, z, right, down) * bins + min(max(int(size * bins + wider), 0), bins - 1)
        entry[s] = row if distance > 0.0 else -1
        seen = (radius > 0.0) & (size >= smallest) & (around | (nx * x + ny * y + nz * z > -radius))
        state[s] = (2 if around else 1) if seen else 0


@kernel()
def join_entries(own, solid, spheres, table, found, words):
    """Sets words (96,) to what the spheres' rows of the table, ``found`` by :func:`find_entries`, hold; False if that
    is everything."""
    bits, filled = table
    entry, state = found
    words[:] = 0
    for s in range(entry.size):
        if state[s] == 0 or s == own:
            continue
        if state[s] == 2:
            if solid == SKIP or (own >= 0 and spheres[s, 4] == spheres[own, 4]):
                continue
            if solid == BLOCK:
                return False
            if entry[s] < 0:  # its centre lies in no direction
                continue
        row = entry[s]
        mask = filled[row]
        while mask != 0:
            group = 2 * trailing_zeros(mask)
            words[group] |= bits[row, group]
            words[group + 1] |= bits[row, group + 1]
            mask &= mask - 1
    return True


@kernel()
def hide_exactly(samples, i, spheres, caps, rows, words):
    """Sets words (96,) to what spheres (S,5) hide from sample i, cap by cap; False if that is everything."""
    px, py, pz = samples.position[i, 0], samples.position[i, 1], samples.position[i, 2]
    nx, ny, nz = np.float64(samples.normal[i, 0]), np.float64(samples.normal[i, 1]), np.float64(samples.normal[i, 2])
    rows[:] = np.uint32(0)
    own, solid = samples.own[i], samples.solid[i]
    for s in range(spheres.shape[0]):
        radius = spheres[s, 3]
        if s == own or not radius > 0.0:
            continue
        x, y, z = spheres[s, 0] - px, spheres[s, 1] - py, spheres[s, 2] - pz
        distance = math.sqrt(x * x + y * y + z * z)
        size = 1.0
        if distance <= radius:
            if solid == SKIP or (own >= 0 and spheres[s, 4] == spheres[own, 4]):
                continue
            if solid == BLOCK:
                return False
            if distance == 0.0:
                continue
        else:
            size = radius / distance
        x, y, z = x / distance, y / distance, z / distance
        if size >= caps.smallest and nx * x + ny * y + nz * z > -size:
            add_cap(x, y, z, math.sqrt(max(1.0 - size * size, 0.0)), rows)
    pack_blocks(rows, words)
    return True


@kernel()
def hide(samples, i, spheres, caps, scratch, words):
    """Sets words (96,) to what spheres (S,5) hide from sample i; False if that is everything.

    ``scratch``: rows (192,), columns of the spheres, entries and states (S,).
    """
    rows, columns, entry, state = scratch
    if caps.filled.size == 0:
        return hide_exactly(samples, i, spheres, caps, rows, words)
    find_entries(samples, i, columns, caps, entry, state)
    return join_entries(samples.own[i], samples.solid[i], spheres, (caps.bits, caps.filled), (entry, state), words)


@kernel()
def stored_normals(x, y, z, cells, index, weight):
    """The stored normals (4,) about the direction (x, y, z), and their weights; one alone where ``cells`` is 0."""
    a, b, c = abs(x), abs(y), abs(z)
    if a >= b and a >= c:
        face, u, v, major = (0, -z, -y, a) if x >= 0.0 else (1, z, -y, a)
    elif b >= c:
        face, u, v, major = (2, x, z, b) if y >= 0.0 else (3, x, -z, b)
    else:
        face, u, v, major = (4, x, -y, c) if z >= 0.0 else (5, -x, -y, c)
    if not major > 0.0:
        face, u, v, major = 2, 0.0, 0.0, 1.0
    u, v = 0.5 * (u / major + 1.0), 0.5 * (v / major + 1.0)
    if cells <= 0:
        side = -cells
        index[0] = (face * side + min(int(v * side), side - 1)) * side + min(int(u * side), side - 1)
        weight[0] = 1.0
        return 1
    column, row = min(int(u * cells), cells - 1), min(int(v * cells), cells - 1)
    right, down = u * cells - column, v * cells - row
    side = cells + 1
    corner = (face * side + row) * side + column
    index[0], index[1], index[2], index[3] = corner, corner + 1, corner + side, corner + side + 1
    weight[0], weight[1] = (1.0 - right) * (1.0 - down), right * (1.0 - down)
    weight[2], weight[3] = (1.0 - right) * down, right * down
    return 4


@kernel()
def gather(words, codes, counts, light, fine, place, out):
    """Light (8,): left by what words (96,) hide, and with nothing hidden, each of three colours and of even light.

    ``place``: normals, weights, number.
    """
    index, weight, normals = place
    block, mean, value, column, start = light.block, light.mean, light.value, light.column, light.start
    count_blocks(words, counts)
    red = green = blue = even = 0.0
    left = False
    for k in range(normals):
        red += weight[k] * light.whole[index[k], 0]
        green += weight[k] * light.whole[index[k], 1]
        blue += weight[k] * light.whole[index[k], 2]
        even += weight[k] * light.whole[index[k], 3]
    out[4], out[5], out[6], out[7] = red, green, blue, even
    for w in range(WORDS):
        if words[w] == 0:  # most of the sky
            left = True
            continue
        for b in range(4 * w, 4 * w + 4):
            count = counts[b]
            if count < 16:
                left = True
            if count == 0:
                continue
            r = g = s = e = 0.0
            for k in range(normals):
                row = index[k]
                r += weight[k] * block[row, b, 0]
                g += weight[k] * block[row, b, 1]
                s += weight[k] * block[row, b, 2]
                e += weight[k] * block[row, b, 3]
            red -= count * r
            green -= count * g
            blue -= count * s
            even -= count * e
            if count == 16:
                continue
            code = codes[b]
            for t in range(start[b], start[b + 1]):
                hidden = fine[code, column[t]]
                if hidden == 0:
                    continue
                facing = 0.0
                for k in range(normals):
                    facing += weight[k] * mean[index[k], t]
                facing *= hidden * 0.0078125
                red -= facing * value[t, 0]
                green -= facing * value[t, 1]
                blue -= facing * value[t, 2]
    if not left:
        red = green = blue = even = 0.0
    out[0], out[1], out[2], out[3] = red, green, blue, even


@kernel(parallel=True)
def light_points(samples, spheres, caps, light, fine, chunk, out, negative):
    """Light out (P,8) float32 that arrives at samples over pi, clamped at 0, and that would with nothing hidden.
    ``negative`` (T,) counts what was below zero.

    ``spheres`` (S,5) float64 centre, radius and number of the body, ``fine`` (65536,16) int8 coefficients of codes.
    """
    count = samples.position.shape[0]
    parts = (count + chunk - 1) // chunk
    for part in prange(parts):
        words = np.zeros(WORDS, np.int64)
        scratch = scratch_of(spheres)
        codes, counts = words.view(np.uint16), np.zeros(BLOCKS, np.int32)
        index, weight = np.zeros(4, np.int64), np.zeros(4)
        color = np.zeros(8)
        below = 0
        first = np.int64(part) * chunk
        for i in range(first, min(first + chunk, count)):
            if not hide(samples, i, spheres, caps, scratch, words):
                words[:] = -1
            normals = stored_normals(
                np.float64(samples.normal[i, 0]),
                np.float64(samples.normal[i, 1]),
                np.float64(samples.normal[i, 2]),
                light.cells,
                index,
                weight,
            )
            gather(words, codes, counts, light, fine, (index, weight, normals), color)
            for c in range(4):
                if color[c] < 0.0 and c < 3:
                    below += 1
                out[i, c] = np.float32(max(color[c], 0.0))
                out[i, 4 + c] = np.float32(color[4 + c])
        negative[part] = below


@kernel(parallel=True)
def hidden_words(samples, spheres, caps, words):
    """What spheres (S,5) hide from each sample: words (P,96) int64."""
    count = samples.position.shape[0]
    parts = (count + 63) // 64
    for part in prange(parts):
        scratch = scratch_of(spheres)
        first = np.int64(part) * 64
        for i in range(first, min(first + 64, count)):
            if not hide(samples, i, spheres, caps, scratch, words[i]):
                words[i, :] = -1
