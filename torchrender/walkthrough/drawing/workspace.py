"""Room for what a picture needs on the way, kept by each thread: fresh pages cost more than what is written there."""

from __future__ import annotations

import threading

import numpy as np

from torchrender.walkthrough.frames.record import Array

KEPT = 1 << 24
"""Floats of one buffer (64 MiB) beyond which it is not kept."""


class Workspace(threading.local):
    """Arrays by name, not cleared: valid until the same thread asks for the name again."""

    def __init__(self) -> None:
        self._held: dict[str, Array] = {}

    def floats(self, name: str, shape: tuple[int, ...]) -> Array:
        """A float32 array of ``shape``."""
        count = int(np.prod(shape))
        if count > KEPT:
            return np.empty(shape, np.float32)
        held = self._held.get(name)
        if held is None or len(held) < count:
            held = self._held[name] = np.empty(count, np.float32)
        return held[:count].reshape(shape)


WORKSPACE = Workspace()
