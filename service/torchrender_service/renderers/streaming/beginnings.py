"""What new sessions of a scene begin with: the light of a picture that others made, and of single pixels that they
shaded since, and maps it was made with. After a renderer died all sessions are new ones to the next."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, replace

from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.pipeline.history import Kept, RenderHistory
from torchrender_service.renderers.keeping.sizes import bytes_of
from torchrender_service.renderers.streaming.carrying import LitViews
from torchrender_service.renderers.streaming.session import SessionState

MAX_SCENES = 4
LITTLE = 1 << 13
"""Pixels: a session that has shaded fewer takes on what others have. One that has its own stays with them: what ten
sessions shade at ten places would soon push out each other's."""


@dataclass(frozen=True, eq=False)
class Beginning:
    """Of one scene."""

    lit: LitViews
    maps: Mapping[str, Kept]  # by name of the buffer: fitted to its view, and used while they cover another
    picture_bytes: int  # of the pictures and maps

    @classmethod
    def of(cls, lit: LitViews, maps: Mapping[str, Kept]) -> Beginning:
        """With the bytes of what is held."""
        return cls(lit, maps, bytes_of([lit.pictures, lit.quick, maps]))

    @property
    def bytes(self) -> int:
        """Of what is held."""
        return self.picture_bytes + bytes_of(self.lit.gathered)


class Beginnings:
    """Of the scenes that had a picture last: the last smooth one, and before there is one the first."""

    def __init__(self) -> None:
        self._scenes: OrderedDict[str, Beginning] = OrderedDict()
        self.bytes = 0  # of all

    def __contains__(self, scene: str) -> bool:
        return scene in self._scenes

    def keep(self, scene: str, state: SessionState) -> None:
        """New sessions begin with the light that this one has."""
        self._put(scene, Beginning.of(state.lit.newest(), _maps(state.history)))

    def keep_shaded(self, scene: str, state: SessionState) -> None:
        """Light of a few pixels, and the maps that they were shaded with, serve what other sessions would shade."""
        known, maps = self._scenes.get(scene), _maps(state.history)
        if known is None:
            return
        if any(maps[name] is not known.maps.get(name) for name in maps):
            known = Beginning.of(known.lit, maps)
        lit = known.lit.with_gathered(state.lit)
        if lit is not known.lit or known is not self._scenes[scene]:
            self._put(scene, replace(known, lit=lit))

    def lend(self, scene: str, lit: LitViews) -> None:
        """A session that has shaded little goes on with what others shaded since it began."""
        known = self._scenes.get(scene)
        if known is not None and len(lit.gathered) < min(LITTLE, len(known.lit.gathered)):
            lit.gathered = lit.with_gathered(known.lit).gathered

    def begin(self, scene: str, history: RenderHistory) -> SessionState:
        """A session, with what all pictures of the scene share."""
        known = self._scenes.get(scene)
        if known is None:
            return SessionState(history)
        return SessionState(replace(history, kept={**history.kept, **known.maps}), lit=known.lit.newest())

    def forget(self, scene: str) -> None:
        """Drop one scene's."""
        self._put(scene, None)

    def clear(self) -> None:
        """Drop all."""
        self._scenes.clear()
        self.bytes = 0

    def _put(self, scene: str, made: Beginning | None) -> None:
        self._scenes.pop(scene, None)
        if made is not None:
            self._scenes[scene] = made
        while len(self._scenes) > MAX_SCENES:
            self._scenes.popitem(last=False)
        self.bytes = sum(one.bytes for one in self._scenes.values())


def _maps(history: RenderHistory) -> dict[str, Kept]:
    return {name: kept for name, kept in history.kept.items() if name == SHADOW_MAP.name}
