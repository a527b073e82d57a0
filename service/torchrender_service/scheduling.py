"""What the processes of the service ask of the system's scheduler."""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress

LAST = 19
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def give_way(niceness: int) -> None:
    """Come after others with the system, where it has such an order; with LAST, run only while no other process wants
    the core: who wants it then has it at once, not at the end of a time slice."""
    if hasattr(os, "nice"):
        os.nice(niceness)
    if niceness >= LAST and hasattr(os, "SCHED_IDLE"):
        with suppress(OSError):  # some containers forbid it
            os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def go_on_when_alone() -> None:
    """Where the parent ends while this process is stopped, it goes on, and meets the end of its input (Linux)."""
    if sys.platform != "linux":
        return
    import ctypes

    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(signal.SIGCONT))
