"""Sessions, and the WebSocket that streams their keyframes."""

from __future__ import annotations

import secrets
import time
from typing import Any

import msgspec
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect

from torchrender.wire.messages import SUBPROTOCOL, CameraHeader
from torchrender_service.door.guard import check_host, check_origin, visit_of
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problem_response
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import Locate, View
from torchrender_service.streams.sessions import Session
from torchrender_service.streams.stream import Stream
from torchrender_service.web.schemas import PinholeCamera, SessionMade, SessionRequest, bounds_of, problems, view_of
from torchrender_service.web.state import ServiceState, state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["stream"])
TICKET = "bearer."


@router.post(
    "/sessions", status_code=201, response_model=SessionMade, responses=problems(400, 403, 404, 413, 422, 429, 503)
)
async def make_session(request: Request, body: SessionRequest) -> dict[str, Any]:
    """Prepare a stream. The ticket opens its WebSocket once, within ``expires_s`` seconds."""
    state = state_of(request)
    if state.stopping:
        raise ServiceError(503, "stopping", "the server is stopping", retry_after_s=5.0)
    view = view_of(body.camera, body.width, body.height)
    limit = state.settings.max_stream_pixels
    if view.width * view.height > limit:
        detail = f"width x height must be at most {limit}, got {view.width} x {view.height}"
        raise ServiceError(422, "too-many-pixels", detail)
    client = visit_of(request.scope).client
    state.sessions.check_room(client)
    renderer = state.pool.assign()
    try:
        session = await _prepared(request, body, view, renderer)
        ticket = state.sessions.add(session)
    except BaseException:  # also where the client goes away meanwhile
        state.pool.release(renderer)
        raise
    return {
        "session": session.id,
        "ticket": ticket,
        "expires_s": state.settings.ticket_s,
        "stream": "/v1/stream",
        "camera": PinholeCamera.of(session.camera),
        "scene_diagonal": session.facts["diagonal"],
        "up": [0.0, 1.0, 0.0],
    }


async def _prepared(request: Request, body: SessionRequest, view: View, renderer: RendererHandle) -> Session:
    """A session whose renderer knows its scene and first view."""
    state = state_of(request)
    source, facts = state.scenes.source(body.scene), await state.scenes.facts(body.scene)
    found = await work(request, Locate(scene=source, view=view), renderer=renderer)
    return Session(
        id=secrets.token_hex(8),
        scene=source,
        facts=facts,
        camera=msgspec.convert(found["camera"], CameraHeader),
        extra_layers=body.layers,
        overscan=body.overscan,
        bounds=bounds_of(body.budget_ms, body.max_error),
        renderer=renderer,
        client=visit_of(request.scope).client,
        expires=time.monotonic() + state.settings.ticket_s,
    )


@router.websocket("/stream")
async def stream(socket: WebSocket) -> None:
    """Protocol ``torchrender.v1``; see PROTOCOL.md."""
    state = state_of(socket)
    try:
        session = _admitted(socket, state)
    except ServiceError as error:
        state.metrics.count("rejected", kind=error.kind)
        await socket.send_denial_response(problem_response(error))
        return
    try:
        await socket.accept(subprotocol=SUBPROTOCOL)
    except (WebSocketDisconnect, RuntimeError):
        return  # the client has left meanwhile; its session expires
    await Stream(socket, session, state.around).run()


def _admitted(socket: WebSocket, state: ServiceState) -> Session:
    """The session whose ticket came, checked before the connection is accepted."""
    if state.stopping:
        raise ServiceError(503, "stopping", "the server is stopping", retry_after_s=5.0)
    check_host(socket.headers, state.settings)
    check_origin(socket.headers, state.settings)
    offered = socket.scope["subprotocols"]
    if SUBPROTOCOL not in offered:
        raise ServiceError(400, "subprotocol", f"offer the subprotocols {SUBPROTOCOL} and {TICKET}TICKET")
    tickets = [word[len(TICKET) :] for word in offered if word.startswith(TICKET)]
    if len(tickets) != 1:
        raise ServiceError(401, "ticket", f"offer one subprotocol {TICKET}TICKET")
    return state.sessions.redeem(tickets[0])
