"""The glTF 2.0 container: GLB chunks, external buffers, accessors and images, checked before memory is taken.

A few bytes of JSON can declare billions of elements, so every count is compared with the bytes that are there.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from torchrender.errors import SceneFileError

Array = np.ndarray[Any, Any]

_COMPONENTS: dict[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_KNOWN = {
    "KHR_lights_punctual",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_emissive_strength",
    "KHR_materials_unlit",
    "KHR_texture_transform",
    "KHR_mesh_quantization",
}
_GLB_JSON, _GLB_BINARY = 0x4E4F534A, 0x004E4942


class GltfFile:
    """A ``.glb`` or ``.gltf`` file: its JSON and what the JSON points to.

    Raises:
        SceneFileError: damaged, cut off, not glTF 2.0, or it needs an extension that is not supported.
    """

    def __init__(self, path: Path, data: bytes) -> None:
        self.path = path
        self._binary = b""
        text = self._chunks(data) if data[:4] == b"glTF" else data
        try:
            self.json = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise SceneFileError(path, f"damaged or not glTF ({error})") from error
        if not isinstance(self.json, dict) or not isinstance(self.json.get("asset"), dict):
            raise SceneFileError(path, "not glTF: the JSON has no asset")
        version = str(self.json["asset"].get("version", ""))
        if not version.startswith("2."):
            raise SceneFileError(path, f"glTF 2.x is supported, the file is version {version or 'unknown'}")
        missing = sorted(set(self.entries("extensionsRequired")) - _KNOWN)
        if missing:
            raise SceneFileError(path, f"needs extensions that are not supported: {', '.join(map(str, missing))}")
        self._buffers: dict[int, bytes] = {}

    def _chunks(self, data: bytes) -> bytes:
        if len(data) < 20:
            raise SceneFileError(self.path, f"cut off: a GLB header has 20 bytes, the file {len(data)}")
        _, version, length = struct.unpack_from("<4sII", data)
        if version != 2:
            raise SceneFileError(self.path, f"GLB version 2 is supported, the file is version {version}")
        if length > len(data):
            raise SceneFileError(self.path, f"cut off: the header says {length} bytes, the file has {len(data)}")
        text, at = b"", 12
        while at + 8 <= length:
            size, kind = struct.unpack_from("<II", data, at)
            at += 8
            if at + size > length:
                raise SceneFileError(self.path, f"damaged: a chunk of {size} bytes at {at} passes the end")
            if kind == _GLB_JSON and not text:
                text = data[at : at + size]
            elif kind == _GLB_BINARY and not self._binary:
                self._binary = data[at : at + size]
            at += size
        if not text:
            raise SceneFileError(self.path, "damaged: no JSON chunk")
        return text

    # ------------------------------------------------------------- JSON access

    def entries(self, name: str) -> list[Any]:
        """A top-level array; empty if there is none."""
        value = self.json.get(name, [])
        if not isinstance(value, list):
            raise SceneFileError(self.path, "must be an array", key=name)
        return value

    def item(self, name: str, index: object) -> dict[str, Any]:
        """Entry ``index`` of a top-level array.

        Raises:
            SceneFileError: there is no such entry; the key names it.
        """
        entries: list[Any] = self.entries(name)
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            raise SceneFileError(
                self.path, f"there is no such entry, {name} has {len(entries)}", key=f"{name}[{index}]"
            )
        if not isinstance(entries[index], dict):
            raise SceneFileError(self.path, "must be an object", key=f"{name}[{index}]")
        return entries[index]

    def numbers(self, holder: dict[str, Any], name: str, default: list[float], key: str) -> Array:
        """A finite float64 array of ``len(default)`` numbers.

        Raises:
            SceneFileError: other than that many finite numbers.
        """
        value = holder.get(name, default)
        try:
            out = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            out = np.zeros(0)
        if out.shape != (len(default),) or not np.isfinite(out).all():
            raise SceneFileError(
                self.path, f"must be {len(default)} finite numbers, got {value!r}", key=f"{key}.{name}"
            )
        return out

    def number(self, holder: dict[str, Any], name: str, default: float, key: str) -> float:
        """One finite number."""
        value = holder.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise SceneFileError(self.path, f"must be a finite number, got {value!r}", key=f"{key}.{name}")
        return float(value)

    # ------------------------------------------------------------------ binary

    def _natural(self, holder: dict[str, Any], name: str, key: str, default: int | None = None) -> int:
        value = holder.get(name, default)
        if not isinstance(value, int) or isinstance(value, bool) or value < 0:
            raise SceneFileError(self.path, f"must be a whole number >= 0, got {value!r}", key=f"{key}.{name}")
        return value

    def _buffer(self, index: object) -> bytes:
        entry = self.item("buffers", index)
        assert isinstance(index, int)
        if index not in self._buffers:
            uri, key = entry.get("uri"), f"buffers[{index}]"
            data = self._binary if uri is None and index == 0 else self.resource(uri, key)
            size = self._natural(entry, "byteLength", key)
            if size > len(data):
                raise SceneFileError(self.path, f"declares {size} bytes, there are {len(data)}", key=key)
            self._buffers[index] = data
        return self._buffers[index]

    def resource(self, uri: object, key: str) -> bytes:
        """Bytes of a data URI or of a file beside this one.

        Raises:
            SceneFileError: missing or unreadable; web addresses are not fetched.
        """
        if not isinstance(uri, str):
            raise SceneFileError(self.path, "has neither data nor a uri", key=key)
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition(",")[2], validate=True)
            except (binascii.Error, ValueError) as error:
                raise SceneFileError(self.path, f"damaged data URI ({error})", key=key) from error
        if "://" in uri:
            raise SceneFileError(self.path, f"web addresses are not fetched: {uri!r}", key=key)
        try:
            return (self.path.parent / unquote(uri)).read_bytes()
        except (OSError, ValueError) as error:
            raise SceneFileError(self.path, f"file {uri!r} cannot be read", key=key) from error

    def view(self, index: object) -> tuple[bytes, int, int, int | None]:
        """Buffer, first byte, size and stride of a buffer view."""
        entry, key = self.item("bufferViews", index), f"bufferViews[{index}]"
        buffer = self._buffer(entry.get("buffer"))
        start, size = self._natural(entry, "byteOffset", key, 0), self._natural(entry, "byteLength", key)
        if start + size > len(buffer):
            raise SceneFileError(self.path, f"bytes {start} to {start + size} pass the end {len(buffer)}", key=key)
        return buffer, start, size, self._natural(entry, "byteStride", key) if "byteStride" in entry else None

    def accessor(self, index: object, kinds: tuple[str, ...], key: str) -> Array:
        """The elements (N,) or (N,width) of an accessor; normalised integers become floats.

        Raises:
            SceneFileError: another element type, or more elements than there are bytes for.
        """
        entry, own = self.item("accessors", index), f"accessors[{index}]"
        kind, component = entry.get("type"), entry.get("componentType")
        if kind not in kinds:
            raise SceneFileError(self.path, f"must be {' or '.join(kinds)}, is {kind!r}", key=f"{key} ({own})")
        if component not in _COMPONENTS:
            raise SceneFileError(self.path, f"unknown componentType {component!r}", key=own)
        dtype, width = np.dtype(_COMPONENTS[component]).newbyteorder("<"), _WIDTHS[kind]
        count = self._natural(entry, "count", own)
        sparse = entry.get("sparse")
        if "bufferView" in entry:
            out = self._elements(
                entry["bufferView"], self._natural(entry, "byteOffset", own, 0), count, width, dtype, own
            )
        elif sparse is not None and count <= 64 * len(self._buffer(0)):
            out = np.zeros((count, width), dtype)
        else:
            raise SceneFileError(self.path, f"declares {count} elements without data", key=own)
        if sparse is not None:
            out = self._replace_sparse(out, sparse, width, dtype, own)
        if entry.get("normalized") and dtype.kind in "iu":
            out = np.maximum(out.astype(np.float32) / np.float32(np.iinfo(dtype).max), -1.0)
        return out[:, 0] if kind == "SCALAR" else out

    def _elements(self, view: object, offset: int, count: int, width: int, dtype: np.dtype[Any], key: str) -> Array:
        buffer, start, size, stride = self.view(view)
        step = stride or width * dtype.itemsize
        needed = offset + (count - 1) * step + width * dtype.itemsize if count else 0
        if needed > size or step < width * dtype.itemsize:
            raise SceneFileError(
                self.path, f"declares {count} elements, which need {needed} bytes; its view has {size}", key=key
            )
        if not count:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, buffer, start + offset, (step, dtype.itemsize))

    def _replace_sparse(self, base: Array, sparse: Any, width: int, dtype: np.dtype[Any], key: str) -> Array:
        if not isinstance(sparse, dict) or not all(isinstance(sparse.get(k), dict) for k in ("indices", "values")):
            raise SceneFileError(self.path, "sparse needs indices and values", key=key)
        count, key = self._natural(sparse, "count", key), f"{key}.sparse"
        places, values = sparse["indices"], sparse["values"]
        if places.get("componentType") not in (5121, 5123, 5125):
            raise SceneFileError(self.path, "indices must be unsigned integers", key=key)
        kind = np.dtype(_COMPONENTS[places["componentType"]])
        rows = self._elements(
            places.get("bufferView"), self._natural(places, "byteOffset", key, 0), count, 1, kind, key
        )
        new = self._elements(
            values.get("bufferView"), self._natural(values, "byteOffset", key, 0), count, width, dtype, key
        )
        if count and int(rows.max()) >= len(base):
            raise SceneFileError(self.path, f"indices must be below {len(base)}, got {int(rows.max())}", key=key)
        out = base.copy()
        out[rows[:, 0]] = new
        return out
