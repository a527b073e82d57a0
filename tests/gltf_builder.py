"""A tiny writer of GLB files, so that tests say what is in theirs."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}

TRIANGLE = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]


class Glb:
    """Collects binary data and JSON; ``json`` may be changed freely before :meth:`write`."""

    def __init__(self, **json_parts: Any) -> None:
        self.binary = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], **json_parts}

    def view(self, data: bytes) -> int:
        """Append bytes; the number of their buffer view."""
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data + b"\0" * (-len(data) % 4)
        return len(self.json["bufferViews"]) - 1

    def accessor(self, values: Any, dtype: str = "float32", **extra: Any) -> int:
        """Append an array (N,) or (N,width); the number of its accessor."""
        array = np.asarray(values, dtype=dtype)
        width = 1 if array.ndim == 1 else array.shape[1]
        self.json["accessors"].append(
            {
                "bufferView": self.view(array.tobytes()),
                "componentType": _COMPONENTS[dtype],
                "count": len(array),
                "type": _KINDS[width],
                **extra,
            }
        )
        return len(self.json["accessors"]) - 1

    def mesh(self, vertices: Any = None, faces: Any = None, *, material: int | None = None, **attributes: int) -> int:
        """Append a mesh of one primitive (default: one triangle); the number of the mesh."""
        primitive: dict[str, Any] = {
            "attributes": {"POSITION": self.accessor(TRIANGLE if vertices is None else vertices), **attributes}
        }
        if faces is not None:
            primitive["indices"] = self.accessor(np.asarray(faces).reshape(-1), "uint16")
        if material is not None:
            primitive["material"] = material
        self.json.setdefault("meshes", []).append({"primitives": [primitive]})
        return len(self.json["meshes"]) - 1

    def bytes(self) -> bytes:
        """The whole file."""
        parts = {"scenes": [{"nodes": [0]}], "scene": 0, **self.json}
        parts.setdefault("buffers", [{"byteLength": len(self.binary)}])
        text = json.dumps(parts).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        path.write_bytes(self.bytes())
        return path
