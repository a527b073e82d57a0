"""What a caller chooses of a file that holds more than one picture can show."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchrender.errors import OptionError


@dataclass(frozen=True, kw_only=True)
class FileChoice:
    """Which part of a file, in which state.

    Raises:
        OptionError: a time that is not a finite number.
    """

    time: float | None = None  # seconds; None: the pose that the file stands in, or the start of ``animation``
    animation: str | int | None = None  # name or number; None: the first one
    variant: str | None = None  # of KHR_materials_variants; None: the materials of the file itself
    subscene: str | int | None = None  # name or number of a scene in the file; None: its default one
    drop_invalid: bool = False  # leave vertices and points out that are not finite

    def __post_init__(self) -> None:
        if self.time is not None and not math.isfinite(self.time):
            raise OptionError(f"time must be a finite number of seconds, got {self.time}")

    @property
    def is_plain(self) -> bool:
        """Nothing was chosen that only some files know."""
        return self.time is None and self.animation is None and self.variant is None and self.subscene is None


PLAIN_CHOICE = FileChoice()
