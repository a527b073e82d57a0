"""Accessors: arrays in a glTF file, checked before memory is taken.

A few bytes of JSON can declare billions of elements, so every count is compared with the bytes that are there.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf.container import Array, GltfFile

COMPONENTS: dict[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
MATRICES = {"MAT2": (2, 2), "MAT3": (3, 3), "MAT4": (4, 4)}


class Accessors:
    """The accessors of one file."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file

    def count(self, index: object) -> int:
        """Elements that an accessor declares; 0 if it does not say."""
        count = self._file.item("accessors", index).get("count")
        return count if isinstance(count, int) and count > 0 else 0

    def read(self, index: object, kinds: tuple[str, ...], key: str) -> Array:
        """The elements (N,) or (N,width) of an accessor; normalised integers become floats.

        Raises:
            SceneFileError: another element type, or more elements than there are bytes for.
        """
        entry, own = self._file.item("accessors", index), f"accessors[{index}]"
        kind, component = entry.get("type"), entry.get("componentType")
        if kind not in kinds:
            raise SceneFileError(self._file.path, f"must be {' or '.join(kinds)}, is {kind!r}", key=f"{key} ({own})")
        if not isinstance(component, int) or component not in COMPONENTS:
            raise SceneFileError(self._file.path, f"unknown componentType {component!r}", key=own)
        dtype, width = np.dtype(COMPONENTS[component]).newbyteorder("<"), WIDTHS[kind]
        pad = _column_padding(kind, dtype.itemsize)
        count = self._file.natural(entry, "count", own)
        sparse = entry.get("sparse")
        if "bufferView" in entry and pad:
            out = self._padded(entry, count, kind, dtype, own)
        elif "bufferView" in entry:
            out = self._elements(
                entry["bufferView"], self._file.natural(entry, "byteOffset", own, 0), count, width, dtype, own
            )
        elif sparse is not None and count <= 64 * self._file.buffer_size():
            out = np.zeros((count, width), dtype)
        else:
            raise SceneFileError(self._file.path, f"declares {count} elements without data", key=own)
        if sparse is not None:
            out = self._replace_sparse(out, sparse, width, dtype, own)
        if entry.get("normalized") and dtype.kind in "iu":
            out = np.maximum(out.astype(np.float32) / np.float32(np.iinfo(dtype).max), -1.0)
        return out[:, 0] if kind == "SCALAR" else out

    def _padded(self, entry: dict[str, Any], count: int, kind: str, dtype: np.dtype[Any], key: str) -> Array:
        """Matrices of small numbers: each column starts at a multiple of four bytes."""
        columns, rows = MATRICES[kind]
        step = rows + _column_padding(kind, dtype.itemsize) // dtype.itemsize
        offset = self._file.natural(entry, "byteOffset", key, 0)
        wide = self._elements(entry["bufferView"], offset, count, columns * step, dtype, key)
        return wide.reshape(count, columns, step)[:, :, :rows].reshape(count, columns * rows)

    def _elements(self, view: object, offset: int, count: int, width: int, dtype: np.dtype[Any], key: str) -> Array:
        buffer, start, size, stride = self._file.view(view)
        step = stride or width * dtype.itemsize
        needed = offset + (count - 1) * step + width * dtype.itemsize if count else 0
        if needed > size or step < width * dtype.itemsize:
            raise SceneFileError(
                self._file.path, f"declares {count} elements, which need {needed} bytes; its view has {size}", key=key
            )
        if not count:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, buffer, start + offset, (step, dtype.itemsize))

    def _replace_sparse(self, base: Array, sparse: Any, width: int, dtype: np.dtype[Any], key: str) -> Array:
        if not isinstance(sparse, dict) or not all(isinstance(sparse.get(k), dict) for k in ("indices", "values")):
            raise SceneFileError(self._file.path, "sparse needs indices and values", key=key)
        count, key = self._file.natural(sparse, "count", key), f"{key}.sparse"
        places, values = sparse["indices"], sparse["values"]
        if places.get("componentType") not in (5121, 5123, 5125):
            raise SceneFileError(self._file.path, "indices must be unsigned integers", key=key)
        kind = np.dtype(COMPONENTS[places["componentType"]])
        rows = self._elements(
            places.get("bufferView"), self._file.natural(places, "byteOffset", key, 0), count, 1, kind, key
        )
        new = self._elements(
            values.get("bufferView"), self._file.natural(values, "byteOffset", key, 0), count, width, dtype, key
        )
        if count and int(rows.max()) >= len(base):
            raise SceneFileError(self._file.path, f"indices must be below {len(base)}, got {int(rows.max())}", key=key)
        out = base.copy()
        out[rows[:, 0]] = new
        return out


def _column_padding(kind: str, size: int) -> int:
    """Bytes between the columns of a matrix."""
    return -MATRICES[kind][0] * size % 4 if kind in MATRICES else 0
