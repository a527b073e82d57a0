"""Scenes that a renderer keeps loaded, least recently used first to go."""

from __future__ import annotations

from collections import OrderedDict
from pathlib import Path
from typing import Any

from torchrender.errors import SceneFileError
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import SceneSource
from torchrender_service.renderers.keeping.sizes import TREE_BYTES, bytes_of
from torchrender_service.renderers.uploads.any_scene import load_any
from torchrender_service.renderers.viewing.survey import controls_of

MAX_BYTES = 2**31
"""Of all scenes that are kept, where nothing else is said."""
MAX_NAME = 80
"""Characters of a name that clients are shown."""
MAX_NAMES = 64


class SceneCache:
    """Loads scenes on first use.

    Args:
        max_bytes: of all scenes together, with their textures; the newest one is kept whatever it takes.
    """

    def __init__(self, max_bytes: int = MAX_BYTES) -> None:
        self._max = max_bytes
        self._scenes: OrderedDict[str, Scene] = OrderedDict()
        self._sizes: dict[str, int] = {}
        self.evictions = 0

    @property
    def bytes(self) -> int:
        """Of all scenes."""
        return sum(self._sizes.values())

    def get(self, source: SceneSource) -> Scene:
        """The scene, loaded where it is not.

        Raises:
            ServiceError: 404, the scene was deleted meanwhile.
            SceneFileError: the file is damaged.
        """
        if source.id not in self._scenes:
            scene = _loaded(source)
            self._scenes[source.id] = scene
            self._sizes[source.id] = bytes_of(scene) + TREE_BYTES * scene.geometry.triangle_count
        self._scenes.move_to_end(source.id)
        while len(self._scenes) > 1 and self.bytes > self._max:
            self.forget(next(iter(self._scenes)))
            self.evictions += 1
        return self._scenes[source.id]

    def revision(self, source: SceneSource) -> int:
        """How often a scene has changed: scenes of files never do."""
        del source
        return 0

    def forget(self, name: str) -> None:
        """Drop a scene."""
        self._scenes.pop(name, None)
        self._sizes.pop(name, None)

    def clear(self) -> None:
        """Drop all scenes."""
        self.evictions += len(self._scenes)
        self._scenes.clear()
        self._sizes.clear()


def _loaded(source: SceneSource) -> Scene:
    if source.path is None:
        return load(source.id)
    gone = ServiceError(404, "no-such-scene", f"there is no scene {source.id[:MAX_NAME]!r}")
    if not Path(source.path).is_file():
        raise gone
    try:
        return load_any(Path(source.path))
    except (SceneFileError, OSError):
        if not Path(source.path).is_file():  # it went while it was read
            raise gone from None
        raise


def shown(name: str) -> str:
    """A name as clients see it: cut where it is long."""
    return name if len(name) <= MAX_NAME else name[: MAX_NAME - 1] + "…"


def describe(scene: Scene, controls: str | None = None) -> dict[str, Any]:
    """What clients are told about a scene.

    Args:
        controls: how to move about in it; None: found out.
    """
    low, high = scene.bounds
    camera = scene.camera(width=640, height=360)
    return {
        "name": shown(scene.name),
        "triangles": scene.geometry.triangle_count,
        "lights": len(scene.lights),
        "cameras": [shown(name) for name in list(scene.cameras)[:MAX_NAMES]],
        "bounds": [low.tolist(), high.tolist()],
        "diagonal": scene.diagonal,
        "orthographic": camera.orthographic,
        "controls": controls or controls_of(scene, camera),
        "animations": {shown(name): duration for name, duration in list(scene.animations.items())[:MAX_NAMES]},
        "report": {part: [note[:200] for note in notes[:64]] for part, notes in scene.report.plain().items()},
    }
