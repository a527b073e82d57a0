"""What is said of a batch's pictures: warnings of its processes, once each, by the names of the cameras."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from torchrender import errors
from torchrender.errors import TorchRenderWarning
from torchrender.pipeline.doubts import naming_cameras

MOST_TOLD = 20
"""Warnings of one run that are said; records of chunks hold them all."""

Said = dict[str, str]
"""Name of the class of a warning, by its text."""


@contextmanager
def collecting(said: Said, camera: str = "") -> Iterator[None]:
    """Warnings of this package go to ``said``, about the camera by its name; others stay what they are."""
    with warnings.catch_warnings(record=True) as caught, naming_cameras(camera):
        warnings.simplefilter("always", TorchRenderWarning)
        yield
    for one in caught:
        if issubclass(one.category, TorchRenderWarning):
            said[str(one.message)] = one.category.__name__
        else:
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)


def note_said(said: Said, record: dict[str, Any]) -> None:
    """Take what the record of a chunk says."""
    said.update(record.get("said", {}))


def say_all(said: Said) -> None:
    """Warn of what the processes of a run said."""
    for text, name in list(said.items())[:MOST_TOLD]:
        kind = getattr(errors, name, TorchRenderWarning)
        warnings.warn(text, kind, stacklevel=3)
    if len(said) > MOST_TOLD:
        told = f"{len(said) - MOST_TOLD} more warnings are in the records of the chunks"
        warnings.warn(told, TorchRenderWarning, stacklevel=3)
