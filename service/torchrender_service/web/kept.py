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
from torchrender_service.scenes.storage import SharedStorage

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
    """Containers by the hash of their content, ``max_bytes`` in all.

    Args:
        storage: where the others look, too.
    """

    def __init__(self, max_bytes: int, storage: SharedStorage | None = None) -> None:
        self._max = max_bytes
        self._storage = storage
        self._kept: OrderedDict[str, bytes] = OrderedDict()
        self._size = 0

    async def put(self, container: bytes, name: str | None = None) -> str:
        """Keep a container; returns its id. One that is larger than everything allowed is not kept.

        Raises:
            ServiceError: 503 or 507, the shared storage.
        """
        name = name or id_of(container)
        if self._storage is not None and name not in self._kept:
            await self._storage.put(name, container)
        return self._put(container, name)

    def _put(self, container: bytes, name: str) -> str:
        if name in self._kept:
            self._kept.move_to_end(name)
            return name
        self._kept[name] = container
        self._size += len(container)
        while self._size > self._max:
            _, dropped = self._kept.popitem(last=False)
            self._size -= len(dropped)
        return name

    async def has(self, name: str) -> bool:
        """Whether a container is kept."""
        if name not in self._kept and self._storage is not None:
            data = await self._storage.get(name)
            if data is not None:
                self._put(data, name)
        return name in self._kept

    async def get(self, name: str) -> bytes:
        """The container.

        Raises:
            ServiceError: 404; 503, the shared storage.
        """
        if not await self.has(name):
            raise ServiceError(404, "no-such-keyframes", "there are no keyframes of this id, or they were dropped")
        self._kept.move_to_end(name)
        return self._kept[name]


@dataclass(eq=False)
class KeptPhoto:
    """A photo, and the renderer that has it ready."""

    name: str
    data: bytes
    renderer: RendererHandle
    used: float


class KeptPhotos:
    """Photos by the hash of their content, ``max_bytes`` in all. All jobs for one go to the same renderer.

    Args:
        storage: where the others look, too.
    """

    def __init__(self, pool: RendererPool, max_bytes: int, storage: SharedStorage | None = None) -> None:
        self._pool = pool
        self._storage = storage
        self._max = max_bytes
        self._kept: OrderedDict[str, KeptPhoto] = OrderedDict()

    async def put(self, data: bytes) -> KeptPhoto:
        """Keep a photo.

        Raises:
            ServiceError: 503 or 507, the shared storage.
        """
        name = id_of(data)
        if self._storage is not None and name not in self._kept:
            await self._storage.put(name, data)
        return self._put(data, name)

    def _put(self, data: bytes, name: str) -> KeptPhoto:
        if name not in self._kept:
            self._kept[name] = KeptPhoto(name, data, self._pool.assign(background=True), time.monotonic())
        photo = self._touch(name)
        while len(self._kept) > 1 and sum(len(p.data) for p in self._kept.values()) > self._max:
            self._drop(next(iter(self._kept)))
        return photo

    async def get(self, name: str) -> KeptPhoto:
        """The photo.

        Raises:
            ServiceError: 404; 503, the shared storage.
        """
        if name not in self._kept and self._storage is not None:
            data = await self._storage.get(name)
            if data is not None:
                return self._put(data, name)
        if name not in self._kept:
            raise ServiceError(404, "no-such-photo", "there is no photo of this id, or it was dropped: send it again")
        return self._touch(name)

    async def drop(self, name: str) -> None:
        """Forget a photo."""
        if self._storage is not None:
            await self._storage.drop(name)
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
