"""The service on Ray Serve, as the study starts and hurts it."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from torchrender.errors import TorchRenderError
from torchrender_service.load_test.driver import LoadTestError, ServerUnderTest, resident_mb

STOP_S = 60.0
HAPROXY = "RAY_SERVE_ENABLE_HA_PROXY"
"""Of the environment, 1: Serve's requests go through HAProxy in place of its own proxy."""
HAPROXY_FILE = "RAY_SERVE_HAPROXY_BINARY_PATH"
"""Of the environment: the program."""
FOLDERS = ("/usr/sbin", "/usr/local/sbin")
"""Where it may be, beside those that are searched for programs."""


@dataclass(eq=False)
class RayUnderTest(ServerUnderTest):
    """A local cluster with the service; its processes are found by their titles."""

    def replicas(self) -> list[int]:
        """Processes of the replicas, without their renderers."""
        return [pid for pid in descendants(self.pid) if command_line(pid).startswith("ray::ServeReplica")]

    def scale(self, count: int) -> None:
        """Change the number of replicas."""
        assert self.process is not None and self.process.stdin is not None
        self.process.stdin.write(f"replicas {count}\n")
        self.process.stdin.flush()

    def memory_mb(self) -> float:
        """Resident memory of all of it."""
        return sum(resident_mb(pid) for pid in descendants(self.pid))


@contextmanager
def running_on_ray(replicas: int, haproxy: bool, /, **settings: str) -> Iterator[RayUnderTest]:
    """A fresh cluster with replicas of one core, in a folder of its own, behind Ray's proxy or HAProxy.

    Raises:
        TorchRenderError: HAProxy is not installed.
    """
    environment = proxied(haproxy)
    with tempfile.TemporaryDirectory() as folder, (Path(folder) / "log").open("w") as log:
        words = {"num_replicas": str(replicas), "num_cpus": "1", "data_dir": folder, **settings}
        port = free_port()
        command = [sys.executable, "-m", "torchrender_service.ray_local", "--port", str(port)]
        command += [f"{name}={value}" for name, value in words.items()]
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=log, text=True, env=environment)
        try:
            assert process.stdout is not None
            served = process.stdout.readline()
            if "http://" not in served:
                raise LoadTestError(f"it does not start: {(Path(folder) / 'log').read_text()[-500:]}")
            yield RayUnderTest(process, process.pid, "127.0.0.1", port, Path(folder) / "log")
        finally:
            process.terminate()
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    stream.close()


def haproxy_file() -> str | None:
    """HAProxy's program: the environment's, or one that is found."""
    named = os.environ.get(HAPROXY_FILE)
    return named or shutil.which("haproxy", path=os.pathsep.join([os.environ.get("PATH", ""), *FOLDERS]))


def proxied(haproxy: bool) -> dict[str, str]:
    """The environment for a cluster behind one proxy or the other.

    Raises:
        TorchRenderError: HAProxy is not installed.
    """
    environment = {name: value for name, value in os.environ.items() if name not in (HAPROXY, HAPROXY_FILE)}
    if not haproxy:
        return environment
    if (file := haproxy_file()) is None:
        raise TorchRenderError(f"HAProxy is not installed: no haproxy in PATH, none named by {HAPROXY_FILE}")
    return environment | {HAPROXY: "1", HAPROXY_FILE: file}


def free_port() -> int:
    """One that nobody listens on now."""
    with socket.socket() as made:
        made.bind(("127.0.0.1", 0))
        return int(made.getsockname()[1])


def command_line(pid: int) -> str:
    """Of a process, its title first; empty where the system does not show it."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
    except OSError:
        return ""


def descendants(pid: int) -> list[int]:
    """A process, its children, and theirs."""
    found, left = [], [pid]
    while left:
        one = left.pop()
        found.append(one)
        try:
            tasks = list(Path(f"/proc/{one}/task").iterdir())
            left += [int(child) for task in tasks for child in (task / "children").read_text().split()]
        except OSError:
            continue
    return found


def cpu_s(pid: int) -> float:
    """Time that a process and all below it have had on cores, in seconds, with those below that have ended."""
    ticks = 0
    for one in descendants(pid):
        try:
            fields = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        ticks += sum(map(int, fields[11:15]))  # in user and in system mode, its own and of children that have ended
    return ticks / os.sysconf("SC_CLK_TCK")
