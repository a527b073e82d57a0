"""Streams of EXT_meshopt_compression: vertices by byte planes, triangles by edge and vertex queues, plain indices.

Every read is checked against the end of the stream. Source: the extension's specification (Kapoulkine 2021), appendix
A.
"""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

GROUP = 16  # bytes that share a width
BLOCK_BYTES, BLOCK_MOST = 8192, 256
TAIL = 32
VERTICES, TRIANGLES, INDICES = 0xA0, 0xE1, 0xD1


@kernel()
def decode_vertices(data: np.ndarray, out: np.ndarray) -> bool:
    """Elements (N, stride) uint8 out of a stream (n,) uint8; False where it is damaged."""
    count, stride = out.shape
    tail = max(stride, TAIL)
    end = len(data) - tail
    if len(data) < 1 + tail or data[0] != VERTICES:
        return False
    last = data[len(data) - stride :].copy()
    block = min((BLOCK_BYTES // stride) & ~(GROUP - 1), BLOCK_MOST)
    plane = np.zeros(BLOCK_MOST, np.uint8)
    at = 1
    for first in range(0, count, block):
        rows = min(block, count - first)
        for k in range(stride):
            at = _bytes(data, at, end, plane, (rows + GROUP - 1) // GROUP)
            if at < 0:
                return False
            value = last[k]
            for i in range(rows):
                code = plane[i]
                value = np.uint8((value + ((code >> 1) ^ (0xFF if code & 1 else 0))) & 0xFF)
                out[first + i, k] = value
            last[k] = value
    return at == end


@kernel()
def _bytes(data: np.ndarray, at: int, end: int, plane: np.ndarray, groups: int) -> int:
    """Groups of 16 bytes into ``plane``; the place behind them, -1 where the stream ends too early."""
    widths = at
    at += (groups + 3) // 4
    if at > end:
        return -1
    for g in range(groups):
        width = (data[widths + g // 4] >> (2 * (g % 4))) & 3
        base = GROUP * g
        if width == 0:
            plane[base : base + GROUP] = 0
        elif width == 3:
            if at + GROUP > end:
                return -1
            plane[base : base + GROUP] = data[at : at + GROUP]
            at += GROUP
        else:
            bits = 2 * width
            packed, most = at, (1 << bits) - 1
            at += GROUP * bits // 8
            if at > end:
                return -1
            for i in range(GROUP):
                place = i * bits
                code = (data[packed + place // 8] >> (8 - bits - place % 8)) & most
                if code == most:
                    if at >= end:
                        return -1
                    code = data[at]
                    at += 1
                plane[base + i] = code
    return at


@kernel()
def decode_indices(data: np.ndarray, out: np.ndarray) -> bool:
    """Indices (N,) uint32 out of a stream (n,) uint8; False where it is damaged."""
    end = len(data) - 4
    if end < 1 or data[0] != INDICES:
        return False
    last = np.zeros(2, np.int64)
    at = 1
    for i in range(len(out)):
        number, at = _number(data, at, end)
        if at < 0:
            return False
        which, step = int(number & 1), int(number >> 1)
        last[which] = (last[which] + ((step >> 1) ^ -(step & 1))) & 0xFFFFFFFF
        out[i] = last[which]
    return at == end


@kernel()
def _number(data: np.ndarray, at: int, end: int) -> tuple[int, int]:
    """A number of seven bits a byte, and the place behind it."""
    value, shift = 0, 0
    for _ in range(5):
        if at >= end:
            return 0, -1
        byte = np.int64(data[at])
        at += 1
        value |= int((byte & 127) << shift)
        shift += 7
        if byte < 128:
            break
    return value, at


@kernel()
def decode_triangles(data: np.ndarray, out: np.ndarray) -> bool:
    """Indices (3T,) uint32 of a list of triangles out of a stream (n,) uint8; False where it is damaged."""
    triangles = len(out) // 3
    end = len(data) - 16
    if end < 1 + triangles or data[0] != TRIANGLES:
        return False
    edges, edge = np.full((16, 2), -1, np.int64), 0
    vertices, vertex = np.full(16, -1, np.int64), 0
    fresh, last = np.int64(0), np.int64(0)
    at = 1 + triangles
    for t in range(triangles):
        code = np.int64(data[1 + t])
        if code < 0xF0:
            row = (edge - 1 - (code >> 4)) & 15
            a, b, low = edges[row, 0], edges[row, 1], code & 15
            if low < 13:
                c = fresh if low == 0 else vertices[(vertex - 1 - low) & 15]
                fresh += low == 0
                keep = 1 if low == 0 else 0
            else:
                if low == 15:
                    step, at = _number(data, at, end)
                    if at < 0:
                        return False
                    last += (step >> 1) ^ -(step & 1)
                else:
                    last += 1 if low == 14 else -1
                c, keep = last, 1
            vertices[vertex] = c
            vertex = (vertex + keep) & 15
        else:
            # Three vertices of their own: each new, one of the queue, or a number behind.
            if code < 0xFE:
                pair, high = np.int64(data[end + (code & 15)]), 0
            else:
                if at >= end:
                    return False
                pair, high = np.int64(data[at]), 0 if code == 0xFE else 15
                at += 1
                if pair == 0:
                    fresh = np.int64(0)
            mid, low = pair >> 4, pair & 15
            a = b = c = np.int64(0)
            # New ones are counted first, in order; then the numbers are read.
            if high == 0:
                a = fresh
                fresh += 1
            if mid == 0:
                b = fresh
                fresh += 1
            elif mid < 15 or code < 0xFE:
                b = vertices[(vertex - mid) & 15]
            if low == 0:
                c = fresh
                fresh += 1
            elif low < 15 or code < 0xFE:
                c = vertices[(vertex - low) & 15]
            if code >= 0xFE:
                for k in range(3):
                    if (high, mid, low)[k] != 15:
                        continue
                    step, at = _number(data, at, end)
                    if at < 0:
                        return False
                    last += (step >> 1) ^ -(step & 1)
                    if k == 0:
                        a = last
                    elif k == 1:
                        b = last
                    else:
                        c = last
            vertices[vertex] = a
            vertex = (vertex + 1) & 15
            vertices[vertex] = b
            vertex = (vertex + (1 if mid == 0 or (mid == 15 and code >= 0xFE) else 0)) & 15
            vertices[vertex] = c
            vertex = (vertex + (1 if low == 0 or (low == 15 and code >= 0xFE) else 0)) & 15
            edges[edge, 0], edges[edge, 1] = b, a
            edge = (edge + 1) & 15
        edges[edge, 0], edges[edge, 1] = c, b
        edge = (edge + 1) & 15
        edges[edge, 0], edges[edge, 1] = a, c
        edge = (edge + 1) & 15
        out[3 * t], out[3 * t + 1], out[3 * t + 2] = a, b, c
    return at == end
