"""Scenes that a program holds and changes, where a renderer looks for them."""

from __future__ import annotations

import threading

from torchrender.scene.model import Scene
from torchrender_service.renderers.jobs import SceneSource
from torchrender_service.renderers.scene_cache import SceneCache


class LiveScenes(SceneCache):
    """Scenes by id, put there by the program; others come from their files. Any thread may ask."""

    def __init__(self) -> None:
        super().__init__()
        self._live: dict[str, tuple[Scene, int]] = {}
        self._lock = threading.Lock()

    def put(self, scene: str, value: Scene) -> None:
        """A scene is there, or has changed."""
        with self._lock:
            _, revision = self._live.get(scene, (None, -1))
            self._live[scene] = (value, revision + 1)

    def drop(self, scene: str) -> None:
        """It is shown no longer."""
        with self._lock:
            self._live.pop(scene, None)

    def get(self, source: SceneSource) -> Scene:
        """The scene as it is now. Errors as :meth:`SceneCache.get`."""
        with self._lock:
            if source.id in self._live:
                return self._live[source.id][0]
        return super().get(source)

    def revision(self, source: SceneSource) -> int:
        """How often it has changed."""
        with self._lock:
            return self._live[source.id][1] if source.id in self._live else 0
