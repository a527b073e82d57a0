"""Sessions, and the WebSocket that streams their keyframes."""

from __future__ import annotations

import secrets
from typing import Any

import msgspec
from fastapi import APIRouter, Request, WebSocket, WebSocketDisconnect

from torchrender.wire.messages import SUBPROTOCOL, CameraHeader
from torchrender_service.door.guard import check_host, check_origin, visit_of
from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problem_response, problems
from torchrender_service.renderers.jobs import Locate
from torchrender_service.streams.ledger import SessionRecord
from torchrender_service.streams.sessions import Session
from torchrender_service.streams.stream import Stream
from torchrender_service.web.schemas import PinholeCamera, SessionMade, SessionRequest, bounds_of, view_of
from torchrender_service.web.state import ServiceState, state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["stream"], route_class=StrictRoute)
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
    directory = state.sessions.directory
    await directory.check_room(client)
    source, facts = await state.scenes.find(body.scene), await state.scenes.facts(body.scene)
    renderer = state.pool.assign()  # it will have the scene, and is given out again if the stream begins soon
    try:
        found = await work(request, Locate(scene=source, view=view), renderer=renderer)
    finally:
        state.pool.release(renderer)
    record = SessionRecord(
        id=secrets.token_hex(8),
        scene=source.id,
        camera=msgspec.convert(found["camera"], CameraHeader),
        extra_layers=body.layers,
        overscan=body.overscan,
        bounds=bounds_of(body.budget_ms, body.max_error),
        client=client,
    )
    return {
        "session": record.id,
        "ticket": await directory.add(record),
        "expires_s": state.settings.ticket_s,
        "stream": "/v1/stream",
        "camera": PinholeCamera.of(record.camera),
        "scene_diagonal": facts["diagonal"],
        "up": [0.0, 1.0, 0.0],
    }


@router.websocket("/stream")
async def stream(socket: WebSocket) -> None:
    """Protocol ``torchrender.v1``; see PROTOCOL.md."""
    state = state_of(socket)
    try:
        session = await _admitted(socket, state)
    except ServiceError as error:
        state.metrics.count("rejected", kind=error.kind)
        await socket.send_denial_response(problem_response(error))
        return
    try:
        await socket.accept(subprotocol=SUBPROTOCOL)
    except (WebSocketDisconnect, RuntimeError):
        state.sessions.release(session, None)  # the client has left meanwhile, and may come back
        return
    await Stream(socket, session, state.around).run()


async def _admitted(socket: WebSocket, state: ServiceState) -> Session:
    """The session whose ticket came, checked before the connection is accepted; it gets its renderer now."""
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
    record = await state.sessions.redeem(tickets[0])
    session = state.sessions.find(record)
    if session is None:
        try:
            source, facts = await state.scenes.find(record.scene), await state.scenes.facts(record.scene)
        except ServiceError as error:
            if error.status == 404:
                state.sessions.directory.end(record.id)
            raise
        session = Session.of(record, source, facts, state.pool.assign())
        state.sessions.put(session)
    return session
