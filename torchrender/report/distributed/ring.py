"""Consistent hashing with bounded loads: which renderer serves a scene, so that its trees are built once.

Places on a circle belong to renderers, many to each; a scene goes to the next place after its own hash. A renderer that
has more than its share of sessions is passed over. One more renderer, or one less, moves only the scenes next to its
places.

Source: Mirrokni, Thorup, Zadimoghaddam, "Consistent Hashing with Bounded Loads", SODA 2018.
"""

from __future__ import annotations

import bisect
import hashlib
import math
from collections.abc import Sequence

from torchrender.errors import OptionError

PLACES = 64
"""Of each renderer."""
BOUND = 1.25
"""Times the mean number of sessions that a renderer may have."""


class Ring:
    """Places of renderers 0 to ``count`` - 1.

    Raises:
        OptionError: count < 1.
    """

    def __init__(self, count: int) -> None:
        if count < 1:
            raise OptionError(f"count must be >= 1, got {count}")
        self._places = sorted((_hash(f"{renderer}/{k}"), renderer) for renderer in range(count) for k in range(PLACES))
        self._count = count

    def place(self, scene: str, sessions: Sequence[int]) -> int:
        """The renderer for one more session of a scene.

        Args:
            sessions: that each renderer has.
        """
        most = math.ceil(BOUND * (sum(sessions) + 1) / self._count)
        begin = bisect.bisect(self._places, (_hash(scene), -1))
        for step in range(len(self._places)):
            renderer = self._places[(begin + step) % len(self._places)][1]
            if sessions[renderer] < most:
                return renderer
        raise AssertionError("somebody has no more than the mean")


def _hash(text: str) -> int:
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
