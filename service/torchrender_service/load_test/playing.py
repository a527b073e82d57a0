"""One attack in a process of its own, which takes no time from those who measure.

An attacker has a machine of its own: what it computes itself must not be what the others notice. So its process comes
last with the system, and the server, busy with what it sends, does not.

    python -m torchrender_service.load_test.playing NAME SERVER

Says ``ready`` once what it will send is made, waits for a line, attacks until it is ended, and writes what it found
out where the attack comes to an end by itself; then it waits until it is ended.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from torchrender_service.load_test.attacks import ATTACKS
from torchrender_service.load_test.driver import ServerUnderTest, processor_s
from torchrender_service.scheduling import LAST, give_way

THREADS = 64
STOP_S = 5.0


def main(name: str, told: str) -> int:
    """Play."""
    facts = json.loads(told)
    log = facts["log"] and Path(facts["log"])
    server = ServerUnderTest(None, facts["pid"], facts["host"], facts["port"], log, facts["attacker"])
    attack = next(one for one in ATTACKS if one.name == name)
    attack.prepare()
    _many_files()
    give_way(LAST)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    if not sys.stdin.readline():
        return 1
    sys.stdout.write(asyncio.run(_play(attack.play(server))) + "\n")
    sys.stdout.flush()
    sys.stdin.readline()  # who measures looks first what it took
    return 0


async def _play(found: Any) -> str:
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(THREADS))
    return str(await found)


def _many_files() -> None:
    if sys.platform != "win32":
        import resource

        hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


class Player:
    """The process, as who measures sees it."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        self.processor_s = 0.0  # that the attack took, once it is over

    async def play(self, seconds: float) -> str | None:
        """Attack for so long at most; what was found out, None where it went on until then.

        Raises:
            RuntimeError: the attack broke.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        before = sum(processor_s(self._process.pid))
        self._process.stdin.write(b"go\n")
        try:
            line = await asyncio.wait_for(self._process.stdout.readline(), seconds)
        except asyncio.TimeoutError:
            return None
        finally:
            self.processor_s = max(0.0, sum(processor_s(self._process.pid)) - before)
            await self.end()
        if not line:
            raise RuntimeError("the attack broke")
        return line.decode().strip()

    async def end(self) -> None:
        """Now, with all its connections."""
        with contextlib.suppress(ProcessLookupError):
            self._process.kill()
        await asyncio.wait_for(self._process.wait(), STOP_S)


@contextlib.asynccontextmanager
async def player(server: ServerUnderTest, name: str) -> AsyncIterator[Player]:
    """An attack that is ready to begin."""
    log = None if server.log is None else str(server.log)
    facts = {"pid": server.pid, "host": server.host, "port": server.port, "log": log, "attacker": server.attacker}
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "torchrender_service.load_test.playing", name, json.dumps(facts)),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        cwd=Path.cwd(),
    )
    made = Player(process)
    try:
        assert process.stdout is not None
        if not await process.stdout.readline():
            raise RuntimeError("the attack cannot be prepared")
        yield made
    finally:
        await made.end()


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
