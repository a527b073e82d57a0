"""Scenes that are built to do harm."""

from __future__ import annotations

import io
import json
import struct
from typing import Any

from PIL import Image as PilImage


def glb(document: dict[str, Any], data: bytes) -> bytes:
    """A GLB file of a document and its only buffer."""
    data += b"\0" * (-len(data) % 4)
    text = json.dumps({"asset": {"version": "2.0"}, "buffers": [{"byteLength": len(data)}], **document}).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks


def _triangle(extra: bytes = b"", **document: Any) -> bytes:
    """One triangle with texture coordinates, and whatever else comes behind it in the buffer."""
    position = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
    uv = struct.pack("<6f", 0, 0, 1, 0, 0, 1)
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}]
    if extra:
        views.append({"buffer": 0, "byteOffset": 60, "byteLength": len(extra)})
    float32 = 5126
    accessors = [
        {"bufferView": 0, "componentType": float32, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
        {"bufferView": 1, "componentType": float32, "count": 3, "type": "VEC2"},
    ]
    primitive: dict[str, Any] = {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}}
    if "materials" in document:
        primitive["material"] = 0
    whole = {
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        **document,
    }
    return glb(whole, position + uv + extra)


def large_texture_glb(side: int, shade: int = 0) -> bytes:
    """A texture of one colour, small as a file and large in memory."""
    out = io.BytesIO()
    PilImage.new("RGB", (side, side), (200, 30, shade)).save(out, "PNG")
    material = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    images = [{"bufferView": 2, "mimeType": "image/png"}]
    return _triangle(out.getvalue(), images=images, textures=[{"source": 0}], materials=[material])


def long_name_glb(length: int) -> bytes:
    """A scene whose name is as long as that."""
    name = "n" * length
    return _triangle(scenes=[{"name": name, "nodes": [0]}], nodes=[{"mesh": 0, "name": name}])


def long_key_toml(length: int) -> bytes:
    """A key of so many bytes in dotted parts."""
    return b"a" + b".a" * (length // 2) + b" = 1\n"
