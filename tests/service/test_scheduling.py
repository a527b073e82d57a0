"""How processes give way, each tried in one of its own: there is no way back."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


def tried(call: str) -> list[str]:
    """Policy and niceness of a process after a call."""
    code = (
        f"import os; from torchrender_service.scheduling import give_way; {call}; "
        "print(os.sched_getscheduler(0), os.nice(0))"
    )
    return subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout.split()


@pytest.mark.skipif(sys.platform != "linux", reason="others have other orders")
def test_processes_give_way_as_far_as_they_say() -> None:
    own = os.nice(0)
    assert tried("give_way(3)") == [str(os.SCHED_OTHER), str(min(19, own + 3))]
    assert tried("give_way(19)") == [str(os.SCHED_IDLE), "19"]
