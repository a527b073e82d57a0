"""KHR_draco_mesh_compression through the package DracoPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.scene.files.gltf.container import Array

EXTENSION = "KHR_draco_mesh_compression"
MAX_FACES_PER_BYTE = 4096
_MESH, _SEQUENTIAL, _METADATA = 1, 0, 0x8000


def decode(data: bytes, wanted: dict[str, int], most_faces: int) -> tuple[Array, dict[str, Array]]:
    """Faces (F,3) int64, and the attributes (V,width) whose ids in the stream are ``wanted``, by name.

    Raises:
        ValueError: damaged, or more than ``most_faces`` faces; says which.
    """
    declared = _declared_faces(data)
    if declared > min(most_faces, MAX_FACES_PER_BYTE * len(data)):
        raise ValueError(f"declares {declared} faces")
    try:
        import DracoPy

        mesh = DracoPy.decode(data)
    # The package raises its own classes, and those of the C++ library below it.
    except Exception as error:
        raise ValueError(f"damaged Draco stream ({error})") from error
    faces = getattr(mesh, "faces", None)
    if faces is None:
        raise ValueError("the Draco stream holds points, not triangles")
    by_id = {a["unique_id"]: np.asarray(a["data"]) for a in mesh.attributes}
    missing = [f"{name} ({number})" for name, number in wanted.items() if number not in by_id]
    if missing:
        raise ValueError(f"the Draco stream has no {', '.join(missing)}")
    return np.asarray(faces, np.int64).reshape(-1, 3), {name: by_id[n] for name, n in wanted.items()}


def _declared_faces(data: bytes) -> int:
    """Faces that the header of a mesh announces; 0 where it does not stand at a known place.

    Source: Draco bitstream specification 2.2, sections 5.1 and 5.3.
    """
    if len(data) < 12 or data[:5] != b"DRACO":
        raise ValueError("no Draco stream")
    flags = int.from_bytes(data[9:11], "little")
    if data[7] != _MESH or flags & _METADATA:
        return 0
    if data[8] == _SEQUENTIAL:
        return _number(data, 11)[0]
    vertices, at = _number(data, 12)
    # A mesh has three vertices for each face at most.
    return max((vertices + 2) // 3, _number(data, at)[0])


def _number(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(data) and shift < 35:
        value |= (data[at] & 127) << shift
        shift, at = shift + 7, at + 1
        if data[at - 1] < 128:
            break
    return value, at


def typed(values: Array, entry: dict[str, Any]) -> Array:
    """Decoded values as the accessor declares them: normalised integers become floats."""
    if entry.get("normalized") and values.dtype.kind in "iu":
        largest = np.float32(np.iinfo(values.dtype).max)
        scaled: Array = np.maximum(values.astype(np.float32) / largest, -1.0)
        return scaled
    return values
