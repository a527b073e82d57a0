"""Health, readiness and metrics."""

from __future__ import annotations

import logging
from typing import Any

from fastapi import APIRouter, Request, Response

from torchrender import __version__
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import CONTENT_TYPE
from torchrender_service.problems import problems
from torchrender_service.web.state import state_of

LOG = logging.getLogger("torchrender_service.web.routes_status")
router = APIRouter(tags=["status"])
_TEXT: dict[int | str, dict[str, Any]] = {
    200: {"description": "Text format of Prometheus.", "content": {"text/plain": {}}}
}


@router.get("/health")
async def health() -> dict[str, Any]:
    """The server answers."""
    return {"status": "ok", "version": __version__}


@router.get("/ready", responses=problems(503))
async def ready(request: Request) -> dict[str, Any]:
    """All renderers run with the kernels of first keyframes compiled, and the server is not stopping.

    Else it says how far it is; once it is ready, ``progress`` tells what is being compiled behind that, if anything is.
    """
    state = state_of(request)
    if state.stopping or not state.pool.ready:
        what = "stopping" if state.stopping else "starting"
        more = "" if state.stopping else f": {state.pool.progress}"
        raise ServiceError(503, what, f"the server is {what}{more}", retry_after_s=2.0)
    return {"status": "ready"} | ({"progress": state.pool.progress} if state.pool.progress else {})


@router.get(
    "/metrics",
    response_class=Response,
    responses=_TEXT | problems(),
)
async def metrics(request: Request) -> Response:
    """Counters, gauges and histograms for Prometheus."""
    state = state_of(request)
    gauges = {
        "streams": len(state.sessions.connections),
        "jobs": state.pool.waiting,
        "scenes": len(state.scenes.names),
        "connections": len(state.connections),
    }
    try:
        gauges["sessions"] = await state.sessions.directory.count()
    except ServiceError as error:
        LOG.warning("no count of sessions: %s", error.detail)
    return Response(state.metrics.text(gauges), media_type=CONTENT_TYPE)
