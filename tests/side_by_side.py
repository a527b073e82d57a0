"""The type checker and all tests, side by side: ``python tests/side_by_side.py``, as ``make test`` runs them.

Pages wait for a browser and for clocks, and the type checker takes one core: beside them two processes share the other
tests. Types come before pages, whose first picture waits for kernels that would be compiled at the same time.
"""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from parts import BROWSER

ROOT = Path(__file__).resolve().parent.parent
TESTS = (sys.executable, "-m", "pytest")
SHOWN = (*TESTS, "-n", "2", "--dist", "loadfile", f"--ignore={BROWSER}")
"""What is seen while it runs."""
BESIDE = ((sys.executable, "-m", "mypy"), (*TESTS, BROWSER))
"""One after the other; seen when each has ended."""

Command = tuple[str, ...]


def run(shown: Command, beside: Sequence[Command]) -> int:
    """Run commands side by side; 0 if all of them end with 0, else 1. One that fails holds up no other."""
    codes: list[int] = []
    running: list[subprocess.Popen[str]] = []

    def follow() -> None:
        for command in beside:
            try:
                process = subprocess.Popen(
                    command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
                )
                running.append(process)
                said = process.communicate()[0]
                codes.append(process.returncode)
            except OSError as error:
                said = f"{error}\n"
                codes.append(1)
            sys.stdout.write(f"\n{' '.join(command[2:])}\n{said}")
            sys.stdout.flush()

    others = threading.Thread(target=follow, daemon=True)
    others.start()
    try:
        codes.append(subprocess.call(shown, cwd=ROOT))
        others.join()
    except BaseException:  # interrupted, as these processes are, too; none may outlive it
        for process in running:
            process.kill()
        raise
    return int(any(codes))


if __name__ == "__main__":
    try:
        sys.exit(run(SHOWN, BESIDE))
    except KeyboardInterrupt:
        sys.exit(130)
