"""What is kept in memory for later requests, the oldest going first: keyframe containers, and photos of clients."""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from dataclasses import dataclass

from torchrender.wire.errors import ProtocolError
from torchrender.wire.messages import Keyframe, Type, decode
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.contract import RendererHandle, RendererPool

LASTS_S = 3600.0
"""Seconds after its last use that a photo is dropped."""


def id_of(data: bytes) -> str:
    """What is kept goes by the hash of its content: the same thing sent twice is kept once."""
    return hashlib.sha256(data).hexdigest()


def count_keyframes(container: bytes, *, max_pixels: int, max_images: int) -> int:
    """How many keyframes a container declares; their pictures are only decoded when they are used.

    Raises:
        ProtocolError: no container, cut off, or more or larger pictures than allowed.
    """
    rest, count = memoryview(container), 0
    while rest:
        received = decode(rest, (Type.KEYFRAME,), whole=False)
        header = received.message
        assert isinstance(header, Keyframe)
        if count == max_images or header.camera.width * header.camera.height > max_pixels:
            raise ProtocolError(f"a container may hold {max_images} pictures of {max_pixels} pixels each")
        count += 1
        rest = rest[received.size :]
    if not count:
        raise ProtocolError("the container holds no keyframe")
    return count


class KeptContainers:
    """Containers by the hash of their content, ``max_bytes`` in all."""

    def __init__(self, max_bytes: int) -> None:
        self._max = max_bytes
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._size = 0

    def put(self, container: bytes, name: str | None = None) -> str:
        """Keep a container; returns its id. One that is larger than everything allowed is not kept."""
        name = name or id_of(container)
        if name in self._kept:
            self._kept.move_to_end(name)
            return name
        self._kept[name] = container
        self._size += len(container)
        while self._size > self._max:
            _, dropped = self._kept.popitem(last=False)
            self._size -= len(dropped)
        return name

    def has(self, name: str) -> bool:
        """Whether a container is kept."""
        return name in self._kept

    def get(self, name: str) -> bytes:
        """The container.

        Raises:
            ServiceError: 404.
        """
        if name not in self._kept:
            raise ServiceError(404, "no-such-keyframes", "there are no keyframes of this id, or they were dropped")
        self._kept.move_to_end(name)
        return self._kept[name]


@dataclass(eq=False)
class KeptPhoto:
    """A photo, and the renderer that has it ready."""

    data: bytes
    renderer: RendererHandle
    used: float


class KeptPhotos:
    """Photos by the hash of their content, ``max_bytes`` in all. All jobs for one go to the same renderer."""

    def __init__(self, pool: RendererPool, max_bytes: int) -> None:
        self._pool = pool
        self._max = max_bytes
        self._kept: OrderedDict[str, KeptPhoto] = OrderedDict()

    def put(self, data: bytes) -> str:
        """Keep a photo; returns its id."""
        name = id_of(data)
        if name not in self._kept:
            self._kept[name] = KeptPhoto(data, self._pool.assign(background=True), time.monotonic())
        self._touch(name)
        while len(self._kept) > 1 and sum(len(p.data) for p in self._kept.values()) > self._max:
            self._drop(next(iter(self._kept)))
        return name

    def get(self, name: str) -> KeptPhoto:
        """The photo.

        Raises:
            ServiceError: 404.
        """
        if name not in self._kept:
            raise ServiceError(404, "no-such-photo", "there is no photo of this id, or it was dropped: send it again")
        return self._touch(name)

    def drop(self, name: str) -> None:
        """Forget a photo."""
        if name in self._kept:
            self._drop(name)

    def expire(self) -> None:
        """Forget photos that nobody uses any more."""
        limit = time.monotonic() - LASTS_S
        for name in [name for name, photo in self._kept.items() if photo.used < limit]:
            self._drop(name)

    def _touch(self, name: str) -> KeptPhoto:
        photo = self._kept[name]
        photo.used = time.monotonic()
        self._kept.move_to_end(name)
        return photo

    def _drop(self, name: str) -> None:
        self._pool.release(self._kept.pop(name).renderer)
