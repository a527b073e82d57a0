"""What the processes of the service ask of the system's scheduler."""

from __future__ import annotations

import os
from contextlib import suppress

LAST = 19


def give_way(niceness: int) -> None:
    """Come after others with the system, where it has such an order; with LAST, run only while no other process wants
    the core: who wants it then has it at once, not at the end of a time slice."""
    if hasattr(os, "nice"):
        os.nice(niceness)
    if niceness >= LAST and hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):  # some containers forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
