"""Keyframe containers that were made, kept in memory for reprojection; the oldest go first."""

from __future__ import annotations

import hashlib
from collections import OrderedDict

from torchrender_service.errors import ServiceError


class KeptContainers:
    """Containers by the hash of their content, ``max_bytes`` in all."""

    def __init__(self, max_bytes: int) -> None:
        self._max = max_bytes
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._size = 0

    def put(self, container: bytes) -> str:
        """Keep a container; returns its id. One that is larger than everything allowed is not kept."""
        name = hashlib.sha256(container).hexdigest()
        if name in self._kept:
            self._kept.move_to_end(name)
            return name
        self._kept[name] = container
        self._size += len(container)
        while self._size > self._max:
            _, dropped = self._kept.popitem(last=False)
            self._size -= len(dropped)
        return name

    def get(self, name: str) -> bytes:
        """The container.

        Raises:
            ServiceError: 404.
        """
        if name not in self._kept:
            raise ServiceError(404, "no-such-keyframes", "there are no keyframes of this id, or they were dropped")
        self._kept.move_to_end(name)
        return self._kept[name]
