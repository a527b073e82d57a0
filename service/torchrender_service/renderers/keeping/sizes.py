"""Bytes of what is kept: every array counts once, whoever holds it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from torch import Tensor

from torchrender.numerics.texels.coded import CodedTexture, codes_of

_PLAIN = (str, bytes, int, float, bool, type(None), type)
TREE_BYTES = 160
"""Of a triangle in the tree of a ray caster, which no array shows."""


def bytes_of(*things: Any, known: set[int] | None = None) -> int:
    """Bytes of all arrays that can be reached from ``things``.

    Args:
        known: addresses of arrays that are counted already; those that are counted now are added.
    """
    seen: set[int] = set()
    memory: set[int] = set() if known is None else known
    total, waiting = 0, list(things)
    while waiting:
        thing = waiting.pop()
        if isinstance(thing, _PLAIN) or id(thing) in seen:
            continue
        seen.add(id(thing))
        found = _array(thing)
        if found is not None:
            address, size = found
            if address not in memory:
                memory.add(address)
                total += size
            continue
        waiting.extend(_parts(thing))
    return total


def _array(thing: Any) -> tuple[int, int] | None:
    """Address and bytes of what an array lies in; of a part the whole."""
    if isinstance(thing, CodedTexture):
        thing = thing.numbers() if codes_of(thing) is None else thing.codes
    if isinstance(thing, Tensor):
        storage = thing.untyped_storage()
        return storage.data_ptr(), storage.nbytes()
    if isinstance(thing, np.ndarray):
        while isinstance(thing.base, np.ndarray):
            thing = thing.base
        return int(thing.__array_interface__["data"][0]), thing.nbytes
    return None


def _parts(thing: Any) -> list[Any]:
    if isinstance(thing, Mapping):
        return [*thing.values()]
    if isinstance(thing, list | tuple | set | frozenset):
        return [*thing]
    if not type(thing).__module__.startswith("torchrender"):
        return []
    parts = list(getattr(thing, "__dict__", {}).values())
    for kind in type(thing).__mro__:
        parts += [getattr(thing, name) for name in getattr(kind, "__slots__", ()) if hasattr(thing, name)]
    return parts
