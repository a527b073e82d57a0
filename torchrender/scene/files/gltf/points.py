"""Points of a glTF file: primitives of mode POINTS, in the places of their nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import SceneFileError
from torchrender.scene.files.gltf.container import Array, GltfFile
from torchrender.scene.files.gltf.meshes import primitives_of
from torchrender.scene.files.gltf.nodes import chosen_scene, read_nodes
from torchrender.scene.files.gltf.primitives import POINTS, TRIANGLES, PrimitiveReader
from torchrender.scene.files.report import Notes
from torchrender.scene.motion.pose import posed
from torchrender.scene.place import place_arrays


def has_only_points(file: GltfFile) -> bool:
    """Whether all primitives of a file are points, and there are some."""
    modes = [p.get("mode", TRIANGLES) for k in range(len(file.entries("meshes"))) for p in primitives_of(file, k)]
    return bool(modes) and all(m == POINTS for m in modes)


def read_gltf_points(path: Path, data: bytes, notes: Notes) -> dict[str, Array | None]:
    """Position (P,3) float64, normal (P,3), colour (P,3) and opacity (P,) of all points; None: no point has one.

    What is mended is noted.

    Raises:
        SceneFileError: damaged, or without points.
    """
    file = GltfFile(path, data, notes)
    nodes, order = read_nodes(file, chosen_scene(file, None)[0])
    worlds, _ = posed(nodes, None, None, np.eye(4))
    reader = PrimitiveReader(file)
    parts: list[tuple[Array, Array | None, Array | None]] = []
    for index in order:
        node: dict[str, Any] = file.item("nodes", index)
        for number, entry in enumerate(primitives_of(file, node["mesh"]) if "mesh" in node else []):
            if entry.get("mode", TRIANGLES) == POINTS:
                position, normal, color = reader.points(entry, f"meshes[{node['mesh']}].primitives[{number}]")
                moved, _, turned = place_arrays(position, np.zeros((0, 3), np.int64), normal, worlds[index])
                parts.append((moved, turned, color))
    if not parts:
        raise SceneFileError(path, "holds no points")
    colors = _joined([p[2] for p in parts], [len(p[0]) for p in parts], 4, 1.0)
    return {
        "position": np.concatenate([p[0] for p in parts]),
        "normal": _joined([p[1] for p in parts], [len(p[0]) for p in parts], 3, 0.0),
        "color": None if colors is None else colors[:, :3],
        "opacity": None if colors is None or bool((colors[:, 3] == 1.0).all()) else colors[:, 3],
    }


def _joined(parts: list[Array | None], counts: list[int], width: int, missing: float) -> Array | None:
    if all(p is None for p in parts):
        return None
    full = [np.full((n, width), missing, np.float32) if p is None else p for p, n in zip(parts, counts, strict=True)]
    return np.concatenate(full)
