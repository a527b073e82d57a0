"""Where a picture that somebody waits for is made: one table of reasons, of which the first that holds decides.

Pictures have a renderer of their own where there are several, and share it with streams where there is one. The
renderer of large pictures, which the system serves last, helps out while it has none.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

HELP_S, PATIENCE_S, LOADING_S = 1.0, 2.0, 8.0
"""So long a picture waits for the renderer of large ones: then it goes to the others. The second beside streams, the
third where the scene must be loaded first: that would be done twice."""


@dataclass(frozen=True, kw_only=True)
class Standing:
    """What decides."""

    free: bool  # the picture has no budget, and no pace that is known where others like it were made
    small: bool
    streams: bool  # somebody looks at streams of the renderer that pictures have
    ahead: int  # jobs there
    other: bool  # there is a renderer of large pictures
    ready: bool = False  # it runs, and has made a first picture
    large: bool = False  # it has a large picture
    slow: bool = False  # it got nothing done just now
    ahead_there: int = 0  # jobs there
    loaded_there: bool = True  # it has the scene


class Place(NamedTuple):
    """A row of the table."""

    why: str
    holds: Callable[[Standing], bool]
    aside: bool = False  # in the renderer of large pictures
    patience_s: float = 0.0  # there
    wanted: bool = False  # it would be, were the renderer ready


PLACES = (
    Place("there is no other renderer", lambda s: not s.other),
    Place("its pace is known there", lambda s: not s.free),
    Place("it is in nobody's way there", lambda s: not s.streams and not (s.small and s.ahead)),
    Place("the renderer of large pictures starts", lambda s: not s.ready, wanted=True),
    Place("the renderer of large pictures has one", lambda s: s.large),
    Place("the renderer of large pictures was too slow", lambda s: s.slow),
    Place("streams have the renderer", lambda s: s.streams and s.loaded_there, aside=True, patience_s=PATIENCE_S),
    Place("streams have it, and the scene is loaded", lambda s: s.streams, aside=True, patience_s=LOADING_S),
    Place("less waits there", lambda s: s.ahead_there < s.ahead, aside=True, patience_s=HELP_S),
    Place("as much waits there", lambda _: True),
)


def place_of(standing: Standing) -> Place:
    """The first that holds."""
    return next(place for place in PLACES if place.holds(standing))
