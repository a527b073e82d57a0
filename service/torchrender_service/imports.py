"""Imports of a process that lasts."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def lasting_imports() -> Iterator[None]:
    """What is imported inside stays: the collector looks through it neither meanwhile nor later.

    Modules are hundreds of thousands of objects. While they come, the collector looks through all of them several
    times, and later in the midst of a keyframe.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
