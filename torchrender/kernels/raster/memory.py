"""Room that views are drawn in, kept from one to the next."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from torchrender.arrays import empty_aligned
from torchrender.kernels.raster import binning, tiles
from torchrender.kernels.raster.lanes.refused import NOTES, ROOM
from torchrender.kernels.raster.lanes.rows import TILE_HEIGHT, TILE_WIDTH
from torchrender.kernels.raster.records import Buffers
from torchrender.kernels.raster.resolve import CACHED

Array = np.ndarray[Any, Any]
KEPT_VERTICES = 1 << 21  # 64 MiB
KEPT_TRIANGLES = 1 << 20  # 64 MiB


class Memory(threading.local):
    """Projected vertices and lists of triangles, kept from view to view by each thread.

    Fresh pages cost more than what is written there.
    """

    def __init__(self) -> None:
        self._points = np.empty((0, 4))
        self._lists = _lists(0)
        self._buffers = _buffers(0, 0)
        self._notes = np.empty((0, 0, 0))

    @contextmanager
    def lent(self) -> Iterator[None]:
        """What was handed out last stays as it is while the context lasts."""
        points, lists = self._points, self._lists
        self._points, self._lists = np.empty((0, 4)), _lists(0)
        try:
            yield
        finally:
            self._points, self._lists = points, lists

    def points(self, count: int) -> Array:
        """Room for ``count`` projected vertices, not cleared."""
        if count > KEPT_VERTICES:
            return np.empty((count, 4))
        if len(self._points) < count:
            self._points = np.empty((count, 4))
        return self._points

    def lists(self, count: int) -> binning.Lists:
        """Room for ``count`` triangles, not cleared."""
        if count > KEPT_TRIANGLES:
            return _lists(count)
        if len(self._lists.places) < count:
            self._lists = _lists(count)
        return self._lists

    def buffers(self, threads: int, count: int = 1) -> Buffers:
        """A row per thread, with room for so many tiles, until the next ones are asked for; no planes are known."""
        if self._buffers.keys.shape != (threads, count * TILE_WIDTH * TILE_HEIGHT):
            self._buffers = _buffers(threads, count)
        self._buffers.known.fill(-1)
        return self._buffers

    def notes(self, threads: int) -> Array:
        """Room for those on a tile of each thread, not cleared."""
        if len(self._notes) != threads:
            self._notes = empty_aligned((threads, NOTES, ROOM), np.float64)
        return self._notes


def _buffers(threads: int, count: int) -> Buffers:
    pixels = count * TILE_WIDTH * TILE_HEIGHT
    sizes = ((pixels,), (pixels,), (count * tiles.BLOCKS,), (2, TILE_HEIGHT), (CACHED,), (CACHED, 6))
    kinds = (np.float64, np.int32, np.float64, np.int64, np.int64, np.float64)
    return Buffers(0, *(empty_aligned((threads, *size), kind) for size, kind in zip(sizes, kinds, strict=True)))


def _lists(count: int) -> binning.Lists:
    return binning.Lists(
        np.empty((count, 3), np.int64),
        np.empty(count, np.uint64),
        np.empty(count),
        np.empty(count, np.int32),
        np.empty((count, 4), np.int32),
        np.empty(count, np.int32),
    )
