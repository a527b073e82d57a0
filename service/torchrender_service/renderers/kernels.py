"""Kernels that streams need, compiled by processes apart: the server knows no numba.

What first keyframes need is compiled before the first client comes; the rest afterwards, while the server is ready
already, by processes that give way to renderers. A renderer that needs one of these earlier waits for it.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import sys

LOG = logging.getLogger("torchrender_service.renderers.kernels")
FIRST = "serve.first"
PARTS = (FIRST, "serve")


class KernelPreparation:
    """Compiles them once, side by side, and knows how far it is."""

    def __init__(self) -> None:
        self.done = 0
        self.total = 0
        self.first = asyncio.Event()  # those that first keyframes need are compiled

    @property
    def finished(self) -> bool:
        """Those that first keyframes need are compiled."""
        return self.first.is_set()

    @property
    def text(self) -> str:
        """For whoever waits; empty when nothing is left to do."""
        if not self.total:
            return "" if self.finished else "looking for kernels"
        if self.finished:
            left = self.done < self.total
            return f"compiling kernels for further settings, once: {self.done} of {self.total}" if left else ""
        return f"compiling kernels, once: {self.done} of {self.total}"

    async def run(self) -> None:
        """Until all are compiled. Where that fails, renderers compile what they need themselves."""
        environment = {k: v for k, v in os.environ.items() if k != "TORCHRENDER_API_KEY"}
        process = None
        try:
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "torchrender.kernels.warm_up", *PARTS,
                stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, env=environment,
            )  # fmt: skip
            assert process.stdout is not None
            async for line in process.stdout:
                told = json.loads(line)
                if "failed" in told:
                    LOG.warning("a kernel was not compiled; renderers do it as they need it", extra=told)
                    continue
                if told["total"] and (told["done"] == 0 or told["done"] == told["total"]):
                    LOG.info("compiling kernels, once", extra=told)
                self.done, self.total = told["done"], told["total"]
                if told["part"] != FIRST or self.done == self.total:
                    self.first.set()
            if await process.wait():
                LOG.warning("kernels were not compiled; renderers do it as they need them")
        except (OSError, ValueError, KeyError) as error:
            LOG.warning("kernels were not compiled; renderers do it as they need them: %s", error)
        finally:
            if process is not None and process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.terminate()
                await process.wait()
            self.done, self.total = 0, 0
            self.first.set()
