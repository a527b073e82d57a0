"""Jobs for requests: in the class and for the client of the request, and no longer than somebody waits for them."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Coroutine
from typing import Any

from starlette.requests import Request

from torchrender_service.door.guard import visit_of
from torchrender_service.door.traces import span
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.asked import Asked, rank_of
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import Job
from torchrender_service.web.state import state_of

CLIENT_LEFT = 499


async def work(request: Request, job: Job, *, renderer: RendererHandle | None = None) -> dict[str, Any]:
    """The result of a job for a request whose body was read.

    Raises:
        ServiceError: as :meth:`RendererPool.run`, or 499 where the client went away.
    """
    state, visit = state_of(request), visit_of(request.scope)
    rank = rank_of(job)
    asked = Asked(client=visit.client, rank=rank)
    visit.facts["class"] = rank.name.lower()
    scene = getattr(job, "scene", None)
    if scene is not None:
        visit.facts["scene"] = scene.id
    try:
        with span(type(job).__name__, {"class": rank.name.lower()}):
            return await while_there(request, state.pool.run(job, renderer=renderer, asked=asked))
    finally:
        visit.facts["waited_ms"] = round(1e3 * asked.waited_s, 1)
        if asked.place:
            visit.facts["place"] = asked.place


async def while_there(request: Request, wanted: Coroutine[Any, Any, dict[str, Any]]) -> dict[str, Any]:
    """The result, unless the client leaves before: then the work is cancelled.

    Raises:
        ServiceError: 499, the client left.
    """
    task = asyncio.ensure_future(wanted)
    leaving = asyncio.ensure_future(_left(request))
    try:
        await asyncio.wait((task, leaving), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            return task.result()
        raise ServiceError(CLIENT_LEFT, "client-left", "the client closed the connection")
    finally:
        for one in (task, leaving):
            one.cancel()
        with contextlib.suppress(asyncio.CancelledError, Exception):
            await asyncio.gather(task, leaving, return_exceptions=True)


async def _left(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
