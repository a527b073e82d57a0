"""Scenes that a renderer keeps loaded, least recently used first to go."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any

from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender_service.renderers.jobs import SceneSource

MAX_TRIANGLES = 5_000_000
"""Triangles of all scenes that are kept, the newest one left out of account: about 2 GB."""


class SceneCache:
    """Loads scenes on first use."""

    def __init__(self, max_triangles: int = MAX_TRIANGLES) -> None:
        self._max = max_triangles
        self._scenes: OrderedDict[str, Scene] = OrderedDict()

    def get(self, source: SceneSource) -> Scene:
        """The scene, loaded where it is not.

        Raises:
            SceneFileError: the file is gone or damaged.
        """
        if source.id not in self._scenes:
            self._scenes[source.id] = load(source.id if source.path is None else Path(source.path))
        self._scenes.move_to_end(source.id)
        while len(self._scenes) > 1 and self._triangles() > self._max:
            self._scenes.popitem(last=False)
        return self._scenes[source.id]

    def forget(self, name: str) -> None:
        """Drop a scene."""
        self._scenes.pop(name, None)

    def _triangles(self) -> int:
        return sum(scene.geometry.triangle_count for scene in list(self._scenes.values())[:-1])


def describe(scene: Scene) -> dict[str, Any]:
    """What clients are told about a scene."""
    low, high = scene.bounds
    camera = scene.camera(width=640, height=360)
    return {
        "name": scene.name,
        "triangles": scene.geometry.triangle_count,
        "lights": len(scene.lights),
        "cameras": list(scene.cameras)[:64],
        "bounds": [low.tolist(), high.tolist()],
        "diagonal": scene.diagonal,
        "orthographic": camera.orthographic,
        "animations": {name[:80]: duration for name, duration in list(scene.animations.items())[:64]},
        "report": {part: [note[:200] for note in notes[:64]] for part, notes in scene.report.plain().items()},
    }
