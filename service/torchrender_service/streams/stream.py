"""One connection of the stream: newest pose in, keyframes out, never more than the credits on the way.

There is no queue of frames. A one-slot mailbox holds the newest pose; a keyframe is only begun when a credit is free,
and only when the view is about to run out of samples.
"""

from __future__ import annotations

import asyncio
import logging
import time
from dataclasses import dataclass
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from torchrender.wire.errors import ProtocolError
from torchrender.wire.messages import (
    MAJOR,
    Ack,
    Bye,
    CameraHeader,
    Hello,
    Message,
    Pick,
    Pose,
    Problem,
    Resync,
    Settings,
    Type,
    decode,
    encode,
)
from torchrender_service.errors import ServiceError
from torchrender_service.metrics import Metrics
from torchrender_service.problems import problem_of
from torchrender_service.renderers.contract import RendererPool
from torchrender_service.settings import Settings as ServiceSettings
from torchrender_service.streams.greeting import MAX_MESSAGE_BYTES, check_hello, welcome_of
from torchrender_service.streams.placement import Placement
from torchrender_service.streams.producer import Producer
from torchrender_service.streams.sessions import Session, SessionStore
from torchrender_service.streams.viewing import OnPick, Viewing, take_settings

LOG = logging.getLogger("torchrender_service.streams.stream")
FROM_CLIENT = (Type.HELLO, Type.POSE, Type.ACK, Type.RESYNC, Type.BYE, Type.SETTINGS, Type.PICK)
MAX_ERRORS = 16
SCENE_GONE = 4404
TICK_S = 0.25
CLOSE_S = 1.0
RETRY_S = 1.0
AGAIN_S = 0.1


class Closed(Exception):
    """The stream must end with a close code."""

    def __init__(self, code: int, reason: str) -> None:
        self.code = code
        self.reason = reason
        super().__init__(reason)


@dataclass(eq=False, kw_only=True)
class Surroundings:
    """What every stream uses."""

    settings: ServiceSettings
    sessions: SessionStore
    pool: RendererPool
    metrics: Metrics
    on_pick: OnPick | None = None  # hears of every pixel that was asked for


class Stream:
    """Runs one accepted connection."""

    def __init__(self, socket: WebSocket, session: Session, around: Surroundings) -> None:
        self._socket = socket
        self._session = session
        self._around = around
        self._hello = Hello(versions=(MAJOR, MAJOR))
        self._placement = Placement(around.settings.still_s, session.latency_s)
        self._placement.playing = session.clock.playing
        self._welcomed = False
        self._errors = 0
        self._viewing = Viewing(session, around.pool, self._send, around.on_pick)
        self._wake = asyncio.Event()
        self._end: asyncio.Future[Closed] = asyncio.get_running_loop().create_future()

    # ------------------------------------------------------------------ life

    async def run(self) -> None:
        """Serve until either side ends the stream."""
        session = self._session
        tasks: list[asyncio.Task[None]] = []
        self._around.sessions.connect(session, self)
        closed: Closed | None = None
        try:
            await self._greet()
            tasks = [asyncio.create_task(work()) for work in (self._receive, self._produce, self._watch, self._report)]
            waiting: list[asyncio.Future[Any]] = [*tasks, self._end]
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            if self._end.done():
                closed = self._end.result()
            else:
                next(task for task in tasks if task.done()).result()
        except Closed as error:
            closed = error
        except (WebSocketDisconnect, ConnectionError):
            pass
        except RuntimeError:  # the framework's, for a message to a client that has left
            if WebSocketState.DISCONNECTED not in (self._socket.client_state, self._socket.application_state):
                raise
        except asyncio.CancelledError:
            closed = Closed(1012, "the server is stopping")
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._finish(closed)

    def end(self, code: int, reason: str) -> None:
        """Make :meth:`run` say goodbye and return."""
        if not self._end.done():
            self._end.set_result(Closed(code, reason))

    def refresh(self) -> None:
        """The scene has changed: a new keyframe is wanted."""
        self._placement.refresh(scene=True)
        self._wake.set()

    def look(self, camera: CameraHeader) -> None:
        """Ask the client to look from there."""
        self._viewing.look(camera)

    @property
    def camera(self) -> CameraHeader | None:
        """Where the client looks from; None: it has not said yet."""
        return None if self._placement.pose is None else self._placement.pose.camera

    async def _report(self) -> None:
        """Signs of life, and answers, for clients that read them."""
        if self._hello.viewer:
            await self._viewing.report()
        else:
            await asyncio.Event().wait()

    async def _finish(self, closed: Closed | None) -> None:
        """Say goodbye in a short time; a peer that does not read is cut off."""
        session, around = self._session, self._around
        # Without a WELCOME there is no ticket to come back with.
        over = not self._welcomed or (closed is not None and closed.code in (1000, SCENE_GONE))
        if around.sessions.release(session, self) and over:
            around.sessions.end(session)
        if closed is None:
            return
        around.metrics.count("streams_dropped", reason=str(closed.code))
        LOG.info("stream ends", extra={"session": session.id, "code": closed.code, "reason": closed.reason})
        try:
            await asyncio.wait_for(self._say_goodbye(closed), CLOSE_S)
        except (asyncio.TimeoutError, WebSocketDisconnect, ConnectionError, RuntimeError):
            abort = self._socket.scope["extensions"].get("torchrender.abort")
            if abort is not None:
                abort()

    async def _say_goodbye(self, closed: Closed) -> None:
        if closed.code == SCENE_GONE:
            await self._complain(ServiceError(404, "no-such-scene", closed.reason))
        if closed.code != 1000:
            wait = RETRY_S if closed.code == 1012 else None
            await self._send(Bye(reason=closed.reason, retry_after_s=wait))
        await self._socket.close(closed.code, closed.reason[:100])

    async def _greet(self) -> None:
        settings, session = self._around.settings, self._session
        try:
            message = await asyncio.wait_for(self._next((Type.HELLO,)), settings.hello_s)
            assert isinstance(message, Hello)
            check_hello(message)
        except asyncio.TimeoutError:
            raise Closed(1002, "no HELLO came in time") from None
        except ProtocolError as error:
            await self._complain(error)
            raise Closed(1002, "HELLO with a common version and codec must come first") from error
        self._hello = message
        if message.layers is not None:
            session.extra_layers = min(session.extra_layers, message.layers)
        ticket = await self._renewed()
        self._welcomed = True
        await self._send(welcome_of(session, settings, ticket, self._max_pixels))

    async def _renewed(self) -> str:
        """A ticket to come back with."""
        try:
            return await self._around.sessions.renew(self._session)
        except ServiceError as error:
            await self._complain(error)
            raise Closed(1012 if error.status == 503 else 1008, error.detail) from error

    # --------------------------------------------------------------- messages

    async def _receive(self) -> None:
        while True:
            try:
                message = await self._next(FROM_CLIENT)
                if isinstance(message, Hello):
                    raise ProtocolError("HELLO: comes once, before all others")
            except ProtocolError as error:
                await self._complain(error)
                if error.fatal:
                    raise Closed(1002, "a message could not be read") from error
                self._count_error()
                continue
            if isinstance(message, Bye):
                raise Closed(1000, "goodbye")
            self._take(message)
            self._wake.set()

    async def _next(self, accept: tuple[Type, ...]) -> Message:
        event = await self._socket.receive()
        if event["type"] == "websocket.disconnect":
            raise WebSocketDisconnect(event.get("code", 1005))
        data = event.get("bytes")
        if data is None:
            raise ProtocolError("messages must be binary", fatal=True)
        if len(data) > MAX_MESSAGE_BYTES:  # where the server before this one lets it through
            raise Closed(1009, f"messages may have at most {MAX_MESSAGE_BYTES} bytes")
        return decode(data, accept).message

    def _take(self, message: Message) -> None:
        now, placement, session = time.monotonic(), self._placement, self._session
        if isinstance(message, Pose):
            placement.take_pose(message, now)
        elif isinstance(message, Ack):
            trip = placement.take_ack(message, now)
            session.latency_s = placement.latency_s
            if trip is not None:
                self._around.metrics.observe("keyframe_latency_seconds", trip)
        elif isinstance(message, Resync):
            placement.resync()
        elif isinstance(message, Settings):
            take_settings(session, message, now)
            placement.playing = session.clock.playing
            placement.refresh()
        elif isinstance(message, Pick):
            self._viewing.pick(message)

    def _count_error(self) -> None:
        self._errors += 1
        if self._errors >= MAX_ERRORS:
            raise Closed(1008, "too many messages that cannot be used")

    async def _complain(self, error: ProtocolError | ServiceError) -> None:
        kind = error.kind if isinstance(error, ServiceError) else "invalid-message"
        self._around.metrics.count("stream_errors", kind=kind)
        known = error if isinstance(error, ServiceError) else ServiceError(400, kind, str(error))
        await self._send(Problem(**problem_of(known)))

    async def _send(self, message: Message) -> None:
        await self._socket.send_bytes(encode(message))

    # -------------------------------------------------------------- keyframes

    async def _produce(self) -> None:
        session, around, placement = self._session, self._around, self._placement
        producer = Producer(
            session=session,
            placement=placement,
            pool=around.pool,
            metrics=around.metrics,
            max_pixels=self._max_pixels,
            webp="webp" in self._hello.color,
            mirrors=self._hello.mirrors,
            send=self._socket.send_bytes,
            complain=self._complain,
        )
        while True:
            now = time.monotonic()
            kind = placement.due(now)
            # A keyframe that the view could do without must not be what another session's waits for.
            may = {"smooth": around.pool.idle, "spare": around.pool.alone}.get(kind or "")
            if kind is None or (may is not None and not may(session.renderer)):
                await self._rest(placement.patience(now, TICK_S))
                continue
            try:
                with self._viewing.doing(kind):
                    await producer.make(kind)
            except ServiceError as error:
                await self._failed(error)

    async def _rest(self, seconds: float) -> None:
        """Until a message comes, or so long. ``wait_for`` may lose a cancellation that comes with a message."""
        timer = asyncio.get_running_loop().call_later(seconds, self._wake.set)
        try:
            await self._wake.wait()
        finally:
            timer.cancel()
            self._wake.clear()

    @property
    def _max_pixels(self) -> int:
        return min(self._around.settings.max_stream_pixels, self._hello.max_pixels)

    async def _failed(self, error: ServiceError) -> None:
        """Say so; a pose that cannot be rendered is not tried again, a busy renderer is."""
        if error.status == 404:
            raise Closed(SCENE_GONE, "the scene was deleted")
        await self._complain(error)
        if error.kind == "renderer-stopped":
            await asyncio.sleep(AGAIN_S)  # the next one is on its way: the job waits for it
        elif error.status in (429, 503):
            await asyncio.sleep(error.retry_after_s or RETRY_S)
        else:
            self._placement.drop_pose()
            if error.status == 422:
                self._count_error()

    async def _watch(self) -> None:
        """Drop a client that does not acknowledge."""
        while True:
            await asyncio.sleep(TICK_S)
            sent = self._placement.oldest_sent()
            if sent is not None and time.monotonic() - sent > self._around.settings.stall_s:
                raise Closed(1008, "keyframes are not acknowledged")
