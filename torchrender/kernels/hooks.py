"""Who is asked before a kernel is compiled. Without numba, so that commands which need no kernel stay quick."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

_asked: list[Callable[[str], bool]] = []


@contextmanager
def before_compiling(hook: Callable[[str], bool]) -> Iterator[None]:
    """In here ``hook`` is asked before a kernel that Python calls is compiled.

    It gets the kernel's name, such as ``raster.tiles.draw``, and returns whether its code may be on disk now.
    """
    _asked.append(hook)
    try:
        yield
    finally:
        _asked.remove(hook)


def is_dealt_with(kernel: str) -> bool:
    """Whether somebody has dealt with a kernel that is about to be compiled."""
    return any(hook(kernel) for hook in _asked)
