"""What the processes of the service ask of the system's scheduler."""

from __future__ import annotations

import os
from contextlib import suppress

LAST = 19


def give_way(niceness: int) -> None:
    """Come after others with the system, where it has such an order."""
    if hasattr(os, "nice"):
        os.nice(niceness)


def give_all_way() -> None:
    """Run only while no other process wants the core."""
    give_way(LAST)
    if hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):  # some containers forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
