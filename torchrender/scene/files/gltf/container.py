"""The glTF 2.0 container: GLB chunks, external buffers and views of them, checked before memory is taken."""

from __future__ import annotations

import base64
import binascii
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.content import json_values
from torchrender.scene.files.gltf.extensions import SUPPORTED
from torchrender.scene.files.gltf.meshopt import EXTENSIONS, decode_view
from torchrender.scene.files.report import Notes

Array = np.ndarray[Any, Any]

_GLB_JSON, _GLB_BINARY = 0x4E4F534A, 0x004E4942
MAX_DECODED = 2**31
"""Bytes that all compressed parts of a file may unfold to."""


class GltfFile:
    """A ``.glb`` or ``.gltf`` file: its JSON and what the JSON points to.

    Raises:
        SceneFileError: damaged, cut off, not glTF 2.0, or it needs an extension that is not supported.
    """

    def __init__(self, path: Path, data: bytes, notes: Notes | None = None) -> None:
        self.path = path
        self._binary = b""
        text = self._chunks(data) if data[:4] == b"glTF" else data
        try:
            self.json = json_values(text.removeprefix(b"\xef\xbb\xbf"))
        except ValueError as error:
            raise SceneFileError(path, f"damaged or not glTF ({error})") from error
        if not isinstance(self.json, dict) or not isinstance(self.json.get("asset"), dict):
            raise SceneFileError(path, "not glTF: the JSON has no asset")
        version = str(self.json["asset"].get("version", ""))
        if not version.startswith("2."):
            raise SceneFileError(path, f"glTF 2.x is supported, the file is version {version or 'unknown'}")
        missing = sorted(set(self.entries("extensionsRequired")) - SUPPORTED)
        if missing:
            raise SceneFileError(path, f"needs extensions that are not supported: {', '.join(map(str, missing))}")
        self._buffers: dict[int, bytes] = {}
        self._decoded: dict[int, bytes] = {}
        self._taken = 0
        self.notes = Notes(path) if notes is None else notes

    def take(self, size: int, key: str) -> None:
        """Count bytes that something compressed unfolds to.

        Raises:
            SceneFileError: more than ``MAX_DECODED`` in all.
        """
        self._taken += size
        if self._taken > MAX_DECODED:
            raise SceneFileError(self.path, f"unfolds to more than {MAX_DECODED} bytes", key=key)

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

    def natural(self, holder: dict[str, Any], name: str, key: str, default: int | None = None) -> int:
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
            size = self.natural(entry, "byteLength", key)
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
            reason = getattr(error, "strerror", None) or str(error)
            raise SceneFileError(self.path, f"file {uri!r} cannot be read ({reason})", key=key) from error

    def view(self, index: object) -> tuple[bytes, int, int, int | None]:
        """Buffer, first byte, size and stride of a buffer view."""
        entry, key = self.item("bufferViews", index), f"bufferViews[{index}]"
        assert isinstance(index, int)
        found = [e for e in EXTENSIONS if e in object_of(entry.get("extensions"))]
        if found:
            return self._unfolded(index, entry["extensions"][found[0]], f"{key}.extensions.{found[0]}")
        buffer = self._buffer(entry.get("buffer"))
        start, size = self.natural(entry, "byteOffset", key, 0), self.natural(entry, "byteLength", key)
        if start + size > len(buffer):
            raise SceneFileError(self.path, f"bytes {start} to {start + size} pass the end {len(buffer)}", key=key)
        return buffer, start, size, self.natural(entry, "byteStride", key) if "byteStride" in entry else None

    def _unfolded(self, index: int, entry: Any, key: str) -> tuple[bytes, int, int, int | None]:
        """A view whose bytes are compressed (EXT_meshopt_compression)."""
        if not isinstance(entry, dict):
            raise SceneFileError(self.path, "must be an object", key=key)
        count, stride = self.natural(entry, "count", key), self.natural(entry, "byteStride", key)
        if index not in self._decoded:
            source = self._buffer(entry.get("buffer"))
            start, size = self.natural(entry, "byteOffset", key, 0), self.natural(entry, "byteLength", key)
            if start + size > len(source):
                raise SceneFileError(self.path, f"bytes {start} to {start + size} pass the end {len(source)}", key=key)
            self.take(count * stride, key)
            try:
                self._decoded[index] = decode_view(source[start : start + size], entry, count, stride)
            except ValueError as error:
                raise SceneFileError(self.path, str(error), key=key) from error
        return self._decoded[index], 0, count * stride, stride

    def buffer_size(self) -> int:
        """Bytes of the first buffer: what a file may declare in proportion to."""
        return len(self._buffer(0)) if self.entries("buffers") else 0


def object_of(value: Any) -> dict[str, Any]:
    """The value where it is an object, else an empty one."""
    return value if isinstance(value, dict) else {}
