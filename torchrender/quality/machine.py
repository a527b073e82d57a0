"""Where figures were measured: every report carries this record."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path

import torch

from torchrender import __version__
from torchrender.kernels.compile import thread_count

_PACKAGES = ("torch", "numpy", "numba", "embreex", "open3d", "moderngl", "trimesh", "pyvista")


def machine_record() -> dict[str, object]:
    """Processor, cores, threads, versions, commit and date."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "torch_threads": torch.get_num_threads(),
        "kernel_threads": thread_count(),
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.machine()}",
        "packages": {name: found for name in _PACKAGES if (found := _version(name)) is not None},
        "torchrender": __version__,
        "commit": _commit(),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
    }


def machine_line(record: dict[str, object] | None = None) -> str:
    """The record in one sentence, for the head of a page."""
    r = record or machine_record()
    return (
        f"{r['processor']}, {r['cores']} cores, {r['kernel_threads']} kernel threads, {r['system']}, "
        f"Python {r['python']}, commit {r['commit']}, {r['date']}."
    )


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass
    return platform.processor() or "unknown processor"


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str:
    folder = Path(__file__).resolve().parent
    command = ["git", "-C", str(folder), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
