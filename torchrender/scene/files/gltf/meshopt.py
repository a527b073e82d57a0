"""EXT_meshopt_compression: bytes of a buffer view out of their compressed form, and the filters on them.

Source: the extension's specification (Kapoulkine 2021), appendices A (bitstream) and B (filters).
"""

from __future__ import annotations

from typing import Any

import numpy as np

EXTENSIONS = ("EXT_meshopt_compression",)
MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL")

Array = np.ndarray[Any, Any]


def decode_view(data: bytes, entry: dict[str, Any], count: int, stride: int) -> bytes:
    """The ``count * stride`` bytes of a view.

    Raises:
        ValueError: an unknown mode or filter, or a damaged stream; says which.
    """
    from torchrender.kernels.files.meshopt import decode_indices, decode_triangles, decode_vertices

    mode, kind = entry.get("mode"), entry.get("filter", "NONE")
    if mode not in MODES:
        raise ValueError(f"unknown mode {mode!r}")
    if kind not in FILTERS or (kind != "NONE" and mode != "ATTRIBUTES"):
        raise ValueError(f"unknown filter {kind!r} for mode {mode}")
    source = np.frombuffer(data, np.uint8)
    if mode == "ATTRIBUTES":
        if stride % 4 or not 0 < stride <= 256:
            raise ValueError(f"byteStride must be a multiple of 4 up to 256, got {stride}")
        # A block of 16 elements takes a byte for each of its bytes at least four times compressed away to nothing.
        if count > 256 * 16 * max(len(data), 1):
            raise ValueError(f"declares {count} elements in {len(data)} bytes")
        out = np.zeros((count, stride), np.uint8)
        if not decode_vertices(source, out):
            raise ValueError("damaged stream of vertices")
        return filtered(out, kind).tobytes()
    if stride not in (2, 4):
        raise ValueError(f"byteStride of indices must be 2 or 4, got {stride}")
    if count > 3 * max(len(data), 1):
        raise ValueError(f"declares {count} indices in {len(data)} bytes")
    indices = np.zeros(count, np.uint32)
    if mode == "TRIANGLES" and count % 3:
        raise ValueError(f"count of a list of triangles must be a multiple of 3, got {count}")
    if not (decode_triangles if mode == "TRIANGLES" else decode_indices)(source, indices):
        raise ValueError("damaged stream of indices")
    return indices.astype("<u2" if stride == 2 else "<u4").tobytes()


def filtered(values: Array, kind: str) -> Array:
    """Elements (N, stride) uint8 after a filter."""
    stride = values.shape[1]
    if kind == "OCTAHEDRAL":
        if stride not in (4, 8):
            raise ValueError(f"octahedral filter needs a byteStride of 4 or 8, got {stride}")
        return _octahedral(values.view("<i1" if stride == 4 else "<i2")).view(np.uint8)
    if kind == "QUATERNION":
        if stride != 8:
            raise ValueError(f"quaternion filter needs a byteStride of 8, got {stride}")
        return _quaternion(values.view("<i2")).view(np.uint8)
    if kind == "EXPONENTIAL":
        return _exponential(values.view("<i4")).view(np.uint8)
    return values


def _octahedral(codes: Array) -> Array:
    largest = float(np.iinfo(codes.dtype).max)
    x, y, one = (codes[:, k].astype(np.float32) for k in range(3))
    z = one - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    x = x + np.where(x >= 0, -fold, fold)
    y = y + np.where(y >= 0, -fold, fold)
    scale = largest / np.maximum(np.sqrt(x * x + y * y + z * z), 1e-30)
    out = codes.copy()
    for k, v in enumerate((x, y, z)):
        out[:, k] = _rounded(v * scale).clip(-largest - 1, largest)
    return out


def _quaternion(codes: Array) -> Array:
    biggest, scale = codes[:, 3] & 3, (codes[:, 3] | 3).astype(np.float32)
    unit = np.sqrt(np.float32(0.5)) / np.where(scale == 0, 1.0, scale)
    three = codes[:, :3].astype(np.float32) * unit[:, None]
    fourth = np.sqrt(np.maximum(1.0 - (three * three).sum(axis=1), 0.0))
    out = np.empty_like(codes)
    rows = np.arange(len(codes))
    for k, v in enumerate((three[:, 0], three[:, 1], three[:, 2], fourth)):
        out[rows, (biggest + 1 + k) % 4] = _rounded(v * 32767.0)
    return out


def _exponential(codes: Array) -> Array:
    exponent, mantissa = codes >> 24, (codes << 8) >> 8
    with np.errstate(over="ignore", under="ignore"):
        values: Array = np.ldexp(mantissa.astype(np.float64), exponent).astype("<f4")
    return values


def _rounded(values: Array) -> Array:
    """To the nearest whole number, halves away from zero."""
    return np.trunc(values + np.where(values >= 0, 0.5, -0.5))
