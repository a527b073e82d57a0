"""What the pictures of a scene leave for the next ones, whoever asks for them: maps, trees, and how quick they were."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import Pace
from torchrender_service.renderers.keeping.sizes import TREE_BYTES, bytes_of

SELDOM = 8
"""Pictures for the same use between two looks at what they leave: one takes as much as the next."""
MAX_PACES = 32
"""Uses of one scene whose pace is remembered."""


@dataclass(eq=False)
class Left:
    """Of one scene."""

    history: RenderHistory = field(default_factory=RenderHistory)
    paces: OrderedDict[Hashable, Pace | None] = field(default_factory=OrderedDict)
    bytes: int = 0
    values: tuple[Any, ...] = ()  # that were counted
    counted: tuple[Any, ...] = ()  # use and names of the buffers of the last picture
    unweighed: int = 0  # pictures like it since


class LastingParts:
    """What is shared between pictures, for each scene; the scene that was asked for longest ago goes first.

    Args:
        max_bytes: of all together; the newest is kept whatever it takes.
    """

    def __init__(self, max_bytes: int) -> None:
        self._max = max_bytes
        self._scenes: OrderedDict[str, Left] = OrderedDict()
        self.evictions = 0

    @property
    def bytes(self) -> int:
        """Of all scenes."""
        return sum(left.bytes for left in self._scenes.values())

    def __contains__(self, scene: str) -> bool:
        return scene in self._scenes

    def get(self, scene: str, use: Hashable) -> RenderHistory:
        """What earlier pictures of a scene left, with the pace of those for the same use."""
        left = self._scenes.get(scene)
        if left is None:
            return RenderHistory()
        self._scenes.move_to_end(scene)
        return replace(left.history, pace=left.paces.get(use))

    def put(self, scene: str, use: Hashable, history: RenderHistory, *, whole: bool = False) -> None:
        """Keep what a picture left for others.

        Args:
            whole: also what only serves the same view again, such as maps that are fitted to it.
        """
        left = self._scenes.setdefault(scene, Left())
        self._scenes.move_to_end(scene)
        shared = history.shared()
        kept = history.kept if whole else {**left.history.kept, **shared.kept}
        left.history = replace(shared, kept=kept)
        left.paces[use] = history.pace
        left.paces.move_to_end(use)
        while len(left.paces) > MAX_PACES:
            left.paces.popitem(last=False)
        values = tuple(one.value for one in left.history.kept.values())
        if len(values) == len(left.values) and all(a is b for a, b in zip(values, left.values, strict=True)):
            return  # nothing was made anew, as for most pictures
        like = (use, *left.history.kept)
        left.unweighed = left.unweighed + 1 if like == left.counted else 0
        left.counted = like
        if left.unweighed % SELDOM:
            return
        left.values = values
        triangles = 0 if history.given is None else history.given.geometry.triangle_count
        left.bytes = bytes_of(left.history.kept) + (TREE_BYTES * triangles if left.history.kept else 0)
        while len(self._scenes) > 1 and self.bytes > self._max:
            self._scenes.popitem(last=False)
            self.evictions += 1

    def forget(self, scene: str) -> None:
        """Drop a scene."""
        self._scenes.pop(scene, None)

    def clear(self) -> None:
        """Drop everything."""
        self.evictions += len(self._scenes)
        self._scenes.clear()
