"""How processes give way, each tried in one of its own: there is no way back."""

from __future__ import annotations

import os
import select
import signal
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


PARENT = """
import os, signal, subprocess, sys
child = subprocess.Popen([sys.executable, "-c", sys.argv[1]], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
child.stdout.readline()
os.kill(child.pid, signal.SIGSTOP)
os.waitid(os.P_PID, child.pid, os.WSTOPPED)
print(child.pid, flush=True)
os.kill(os.getpid(), signal.SIGKILL)
"""
CHILD = """
import sys
from torchrender_service.scheduling import go_on_when_alone
go_on_when_alone()
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.mark.skipif(sys.platform != "linux", reason="others have no such signal")
def test_a_stopped_process_outlives_no_parent() -> None:
    """The system only lets whole groups go on that nobody is left to look after; here somebody is."""
    with subprocess.Popen([sys.executable, "-c", PARENT, CHILD], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        handle = os.pidfd_open(child)
        assert parent.wait(30.0) == -signal.SIGKILL
        ended = bool(select.select([handle], [], [], 30.0)[0])
        if not ended:
            signal.pidfd_send_signal(handle, signal.SIGKILL)
        os.close(handle)
        assert ended, "it still stands"
