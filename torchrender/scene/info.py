"""What a scene holds, in numbers, and what is odd about it."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import torch

from torchrender.checks import check_class
from torchrender.scene.material import TEXTURES
from torchrender.scene.model import Scene
from torchrender.scene.smooth import weld


def scene_info(scene: Scene) -> dict[str, Any]:
    """Counts, size and warnings of a scene, as plain values that JSON can hold.

    ``closed``: every edge of every object is shared by exactly two faces that run along it in opposite directions.
    Corners at the same position count as one.
    """
    check_class("scene", scene, Scene)
    geometry = scene.geometry
    degenerate = int((geometry.face_normals.abs().sum(dim=1) == 0).sum())
    open_edges = _open_edges(scene)
    found = [getattr(m, name) for m in scene.materials for name in TEXTURES]
    textures = {id(t) for t in found if t is not None}
    low, high = scene.bounds
    return {
        "name": scene.name,
        "triangles": geometry.triangle_count,
        "vertices": int(geometry.vertices.shape[0]),
        "meshes": len(scene.meshes),
        "objects": int(torch.unique(geometry.object_id).numel()),
        "materials": len(scene.materials),
        "textures": len(textures),
        "lights": dict(Counter(type(light).__name__ for light in scene.lights)),
        "environment": None if scene.environment is None else scene.environment.name,
        "media": len(scene.media),
        "cameras": list(scene.cameras),
        "animations": {name: round(duration, 6) for name, duration in scene.animations.items()},
        "read": [str(note) for note in scene.report.read],
        "repaired": [str(note) for note in scene.report.repaired],
        "not_used": [str(note) for note in scene.report.not_used],
        "bounds": [low.tolist(), high.tolist()],
        "diagonal": scene.diagonal,
        "degenerate_triangles": degenerate,
        "open_edges": open_edges,
        "closed": geometry.triangle_count > 0 and open_edges == 0,
        "warnings": _warnings(scene, degenerate, open_edges),
    }


def _open_edges(scene: Scene) -> int:
    """Edges that are not shared by exactly two faces of the same object with opposite directions."""
    geometry = scene.geometry
    if not geometry.triangle_count:
        return 0
    _, place = weld(geometry.vertices.numpy())
    faces = place[geometry.faces.numpy()]
    whole = (faces != np.roll(faces, -1, axis=1)).all(axis=1)
    faces, objects = faces[whole], geometry.object_id.numpy()[whole]
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2)
    owner = np.unique(objects, return_inverse=True)[1].repeat(3)
    low, high = ends.min(axis=1), ends.max(axis=1)
    order = np.lexsort((high, low, owner))
    edges = np.stack([owner, low, high], axis=1)[order]
    if not len(edges):
        return 0
    starts = np.flatnonzero(np.concatenate([[True], (edges[1:] != edges[:-1]).any(axis=1)]))
    uses = np.diff(np.concatenate([starts, [len(edges)]]))
    balance = np.add.reduceat(np.where(ends[:, 0] < ends[:, 1], 1, -1)[order], starts)
    return int(((uses != 2) | (balance != 0)).sum())


def _warnings(scene: Scene, degenerate: int, open_edges: int) -> list[str]:
    found = []
    if not scene.geometry.triangle_count:
        found.append("the scene has no triangles")
    if degenerate:
        found.append(f"{degenerate} triangles have no area")
    if open_edges:
        found.append(f"not closed: {open_edges} edges are not shared by two faces; solid voxels need closed objects")
    missing = sorted(
        {
            scene.materials[m.material].name
            for m in scene.meshes
            if m.uv is None and scene.materials[m.material].diffuse_texture is not None
        }
    )
    if missing:
        found.append(f"textured materials on meshes without texture coordinates: {', '.join(missing)}")
    if scene.photometric:
        found.append("lights in candela and lux: pictures need an exposure (render chooses one)")
    if scene.with_default_light() is not scene:
        found.append("no light: a default light will be used")
    return found
