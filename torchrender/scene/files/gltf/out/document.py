"""A GLB file in the making: its JSON, and the binary chunk that accessors and images point into."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError

MAX_BYTES = 2**32 - 1
_FLOAT, _UINT = 5126, 5125
_VERTICES, _INDICES = 34962, 34963


class GlbDocument:
    """Entries are added group by group and named by number, as the format wants."""

    def __init__(self, name: str) -> None:
        self.json: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "torchrender"},
            "scene": 0,
            "scenes": [{"name": name, "nodes": []}],
        }
        self.extensions: set[str] = set()
        self._binary = bytearray()

    def add(self, group: str, entry: dict[str, Any]) -> int:
        """Number of a new entry of a group."""
        entries = self.json.setdefault(group, [])
        entries.append(entry)
        return len(entries) - 1

    def node(self, entry: dict[str, Any]) -> None:
        """A node of the scene."""
        self.json["scenes"][0]["nodes"].append(self.add("nodes", entry))

    def view(self, data: bytes, target: int | None = None) -> int:
        """Number of the view of bytes that are added."""
        self._binary += b"\0" * (-len(self._binary) % 4)
        entry: dict[str, Any] = {"buffer": 0, "byteOffset": len(self._binary), "byteLength": len(data)}
        if target is not None:
            entry["target"] = target
        self._binary += data
        return self.add("bufferViews", entry)

    def accessor(self, values: np.ndarray, kind: str, *, limits: bool = False) -> int:
        """Number of the accessor of an array: uint32 for integers, else float32."""
        integer = values.dtype.kind in "iu"
        values = np.ascontiguousarray(values, dtype="<u4" if integer else "<f4")
        entry = {
            "bufferView": self.view(values.tobytes(), _INDICES if integer else _VERTICES),
            "componentType": _UINT if integer else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if limits:
            entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        return self.add("accessors", entry)

    def content(self, name: str | Path) -> bytes:
        """The file; ``name`` is for messages.

        Raises:
            SceneFileError: more than 4 GiB.
        """
        if self.extensions:
            self.json["extensionsUsed"] = sorted(self.extensions)
        self._binary += b"\0" * (-len(self._binary) % 4)
        self.json["buffers"] = [{"byteLength": len(self._binary)}]
        text = json.dumps(self.json, separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + len(self._binary)
        if total > MAX_BYTES:
            raise SceneFileError(name, f"a GLB file has at most {MAX_BYTES} bytes, this scene needs {total}")
        head = struct.pack("<4sII", b"glTF", 2, total) + struct.pack("<II", len(text), 0x4E4F534A)
        return head + text + struct.pack("<II", len(self._binary), 0x004E4942) + bytes(self._binary)
