"""Scenes that a renderer keeps loaded, least recently used first to go."""

from __future__ import annotations

import contextlib
import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from torchrender.errors import InputError, SceneFileError
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender_service.errors import ServiceError
from torchrender_service.logs import hearing, pass_on
from torchrender_service.renderers.jobs import SceneSource
from torchrender_service.renderers.keeping.sizes import TREE_BYTES, bytes_of
from torchrender_service.renderers.keeping.textures import bounded, bytes_of_levels, within
from torchrender_service.renderers.uploads.any_scene import load_any
from torchrender_service.renderers.viewing.survey import controls_of

MAX_BYTES = 2**31
"""Of all scenes that are kept, where nothing else is said."""
MAX_NAME = 80
"""Characters of a name that clients are shown."""
MAX_NAMES = 64


class Loading:
    """One scene, loaded by whoever needs it first; others wait for it."""

    def __init__(self, source: SceneSource, texture_bytes: int | None = None) -> None:
        self._source = source
        self._texture_bytes = texture_bytes
        self._lock = threading.Lock()
        self._scene: Scene | None = None
        self.said: Mapping[str, type[Warning]] = {}  # that it warned of
        self._error: Exception | None = None

    @property
    def done(self) -> bool:
        """Nothing is left to do."""
        return self._scene is not None or self._error is not None

    def run(self) -> None:
        """Load it, unless that is done."""
        with self._lock:
            if self.done:
                return
            try:
                with hearing(self._source.id) as self.said:
                    self._scene = _loaded(self._source, self._texture_bytes)
            except Exception as error:
                self._error = error

    def take(self) -> Scene:
        """The scene. Errors as :meth:`SceneCache.get`."""
        self.run()
        if self._error is not None:
            raise self._error
        assert self._scene is not None
        return self._scene


class SceneCache:
    """Loads scenes on first use.

    Args:
        max_bytes: of all scenes together, with their textures; the newest one is kept whatever it takes.
        texture_bytes: of one scene of a file, with all levels; None: all that it has.
    """

    def __init__(self, max_bytes: int = MAX_BYTES, texture_bytes: int | None = None) -> None:
        self._max = max_bytes
        self._texture_bytes = texture_bytes
        self._scenes: OrderedDict[str, Scene] = OrderedDict()
        self._sizes: dict[str, int] = {}
        self._loading: dict[str, Loading] = {}
        self._said: dict[str, Mapping[str, type[Warning]]] = {}  # by loading, until a job has been told
        self.evictions = 0
        self.dropped = 0  # scenes, for whatever reason

    @property
    def bytes(self) -> int:
        """Of all scenes."""
        return sum(self._sizes.values())

    def has(self, source: SceneSource) -> bool:
        """Whether a scene is loaded."""
        return source.id in self._scenes

    def ahead(self, source: SceneSource) -> Callable[[], Scene]:
        """What gives a scene in another thread, which loads it first where it is not. Errors as :meth:`get`."""
        if source.id in self._scenes:
            scene = self._scenes[source.id]
            return lambda: scene
        return self._loading.setdefault(source.id, Loading(source, self._texture_bytes)).take

    def get(self, source: SceneSource) -> Scene:
        """The scene, loaded where it is not. The first job that asks for it hears what its loading warned of.

        Raises:
            ServiceError: 404, the scene was deleted meanwhile.
            SceneFileError: the file is damaged.
        """
        if source.id not in self._scenes:
            self.ahead(source)
            self._keep(source.id, self._loading.pop(source.id))
        self._scenes.move_to_end(source.id)
        pass_on(self._said.pop(source.id, {}))
        for name in [name for name, one in self._loading.items() if one.done]:
            self._adopt(name, self._loading.pop(name))
        while len(self._scenes) > 1 and self.bytes > self._max:
            self.forget(next(iter(self._scenes)))
            self.evictions += 1
        return self._scenes[source.id]

    def _adopt(self, name: str, loading: Loading) -> None:
        """Keep what was loaded ahead, though nobody may wait for it any more."""
        with contextlib.suppress(Exception):  # told whoever asks for it again
            self._keep(name, loading)

    def _keep(self, name: str, loading: Loading) -> None:
        scene = loading.take()
        self._scenes[name], self._said[name] = scene, loading.said
        self._sizes[name] = bytes_of(scene) + bytes_of_levels(scene) + TREE_BYTES * scene.geometry.triangle_count

    def revision(self, source: SceneSource) -> int:
        """How often a scene has changed: scenes of files never do."""
        del source
        return 0

    def forget(self, name: str) -> None:
        """Drop a scene."""
        self._loading.pop(name, None)
        self.dropped += self._scenes.pop(name, None) is not None
        self._sizes.pop(name, None)
        self._said.pop(name, None)

    def clear(self) -> None:
        """Drop all scenes."""
        self.evictions += len(self._scenes)
        self.dropped += len(self._scenes)
        self._scenes.clear()
        self._sizes.clear()
        self._loading.clear()
        self._said.clear()


def _loaded(source: SceneSource, texture_bytes: int | None) -> Scene:
    if source.path is None:
        return load(source.id)
    gone = ServiceError(404, "no-such-scene", f"there is no scene {source.id[:MAX_NAME]!r}")
    if not Path(source.path).is_file():
        raise gone
    try:
        with bounded(texture_bytes) as bound:
            scene = load_any(Path(source.path))
        return within(scene, texture_bytes, bound.lost)
    except (SceneFileError, OSError):
        if not Path(source.path).is_file():  # it went while it was read
            raise gone from None
        raise


def scene_at(scene: Scene, time: float | None) -> Scene:
    """A scene at a time of its animation, seconds; None: as its file stands.

    Raises:
        InputError: it has no animation.
    """
    if time is None:
        return scene
    if not scene.animations:
        raise InputError(f"time is for scenes with an animation: {shown(scene.name)!r} has none, got {time:g}")
    return scene.at(time)


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
