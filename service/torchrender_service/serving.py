"""The service from a command: its first renderer starts while the server is still being imported."""

from __future__ import annotations

import asyncio
import functools

from torchrender_service.imports import lasting_imports
from torchrender_service.renderers.processes.start import begin_process, end_process, kind_of
from torchrender_service.settings import Settings


def run(settings: Settings, *, start: str = "") -> None:
    """Serve until a signal stops it; the page begins with the scene ``start``.

    Raises:
        OptionError: the data folder, or host and port, cannot be used.
    """
    asyncio.run(_run(settings, start))


async def _run(settings: Settings, start: str) -> None:
    first = await begin_process(kind_of(settings, "0"))
    try:
        # These take as long as the process needs to start: both at once is half of the time until /ready.
        with lasting_imports():
            from torchrender_service.renderers.pool import Pool
            from torchrender_service.web.server import serve

        await serve(settings, functools.partial(Pool, first=first), start=start)
    finally:
        await end_process(first)
