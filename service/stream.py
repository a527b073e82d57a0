"""One connection of the stream: newest pose in, keyframes out, never more than the credits on the way.

There is no queue of frames. A one-slot mailbox holds the newest pose; a keyframe is only begun when a credit is free,
and only when the view is about to run out of samples.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from dataclasses import dataclass

import msgspec
from starlette.websockets import WebSocket, WebSocketDisconnect

from service.errors import ProtocolError, ServiceError
from service.jobs import MakeKeyframe
from service.keyframes import LOSSLESS, QUALITY_MOVING, QUALITY_STILL
from service.messages import (
    CREDITS,
    MAJOR,
    Ack,
    Bye,
    CameraHeader,
    Hello,
    Message,
    Pose,
    Problem,
    Resync,
    Settings,
    Type,
    Welcome,
    decode,
    encode,
)
from service.metrics import Metrics
from service.pool import Pool
from service.prediction import MAX_HOLES, needs_keyframe, overscanned, predicted, same_view
from service.problems import problem_of
from service.sessions import Session, SessionStore
from service.settings import Settings as ServiceSettings

LOG = logging.getLogger("service.stream")
FROM_CLIENT = (Type.HELLO, Type.POSE, Type.ACK, Type.RESYNC, Type.BYE, Type.SETTINGS)
MAX_MESSAGE_BYTES = 65536
MAX_ERRORS = 16
SCENE_GONE = 4404
TICK_S = 0.25
CLOSE_S = 1.0
RETRY_S = 1.0
REACH_S = 0.5  # extra cameras stand where the client will be after this time


class Closed(Exception):
    """The stream must end with a close code."""

    def __init__(self, code: int, reason: str) -> None:
        self.code = code
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True)
class Shown:
    """The newest keyframe."""

    view: CameraHeader  # without overscan, after prediction
    pose: CameraHeader  # that asked for it
    overscan: float
    typical_depth: float
    still: bool


@dataclass(eq=False)
class Flight:
    """A keyframe without acknowledgement."""

    begun: float  # when its rendering began
    timed: bool  # its round trip is like that of the next one
    sent: float | None = None


@dataclass(eq=False, kw_only=True)
class Surroundings:
    """What every stream uses."""

    settings: ServiceSettings
    sessions: SessionStore
    pool: Pool
    metrics: Metrics


class Stream:
    """Runs one accepted connection."""

    def __init__(self, socket: WebSocket, session: Session, around: Surroundings) -> None:
        self._socket = socket
        self._session = session
        self._around = around
        self._hello = Hello(versions=(MAJOR, MAJOR))
        self._pose: Pose | None = None
        self._pose_at = 0.0
        self._moved_at = 0.0
        self._holes = 0.0
        self._fresh = True  # one keyframe is wanted whatever the pose
        self._shown: Shown | None = None
        self._on_the_way: dict[int, Flight] = {}  # by keyframe id
        self._errors = 0
        self._wake = asyncio.Event()
        self._end: asyncio.Future[Closed] = asyncio.get_running_loop().create_future()

    # ------------------------------------------------------------------ life

    async def run(self) -> None:
        """Serve until either side ends the stream."""
        session, tasks = self._session, []
        session.stream = self
        closed: Closed | None = None
        try:
            await self._greet()
            tasks = [asyncio.create_task(work()) for work in (self._receive, self._produce, self._watch)]
            await asyncio.wait([*tasks, self._end], return_when=asyncio.FIRST_COMPLETED)
            if self._end.done():
                closed = self._end.result()
            else:
                next(task for task in tasks if task.done()).result()
        except Closed as error:
            closed = error
        except (WebSocketDisconnect, ConnectionError):
            pass
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

    async def _finish(self, closed: Closed | None) -> None:
        """Say goodbye in a short time; a peer that does not read is cut off."""
        session, around = self._session, self._around
        if session.stream is self:
            around.sessions.release(session)
            if closed is not None and closed.code in (1000, SCENE_GONE):
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
        if closed.code != 1000:
            wait = RETRY_S if closed.code == 1012 else None
            await self._send(Bye(reason=closed.reason, retry_after_s=wait))
        await self._socket.close(closed.code, closed.reason[:100])

    async def _greet(self) -> None:
        settings, session = self._around.settings, self._session
        try:
            message = await asyncio.wait_for(self._next((Type.HELLO,)), settings.hello_s)
        except asyncio.TimeoutError:
            raise Closed(1002, "no HELLO came in time") from None
        except ProtocolError as error:
            await self._complain(error)
            raise Closed(1002, "the first message must be HELLO") from error
        assert isinstance(message, Hello)
        low, high = message.versions
        if not low <= MAJOR <= high:
            await self._complain(ProtocolError(f"versions must include {MAJOR}, got {low} to {high}"))
            raise Closed(1002, "no common version")
        if "pz1" not in message.depth or "jpeg" not in message.color:
            await self._complain(ProtocolError("depth must include pz1 and color must include jpeg"))
            raise Closed(1002, "no common codec")
        self._hello = message
        if message.layers is not None:
            session.layers = min(session.layers, message.layers)
        facts = session.facts
        limits = {
            "max_pixels": self._max_pixels,
            "max_message_bytes": MAX_MESSAGE_BYTES,
            "resume_s": settings.resume_s,
            "stall_s": settings.stall_s,
            "overscan": session.overscan,
            "layers": session.layers,
        }
        welcome = Welcome(
            version=MAJOR,
            session=session.id,
            resume=self._around.sessions.ticket(session),
            credits=CREDITS,
            limits=limits,
            scene={"id": session.scene.id} | {k: facts[k] for k in ("name", "triangles", "diagonal", "bounds")},
            camera=session.camera,
        )
        await self._send(welcome)

    # --------------------------------------------------------------- messages

    async def _receive(self) -> None:
        while True:
            try:
                message = await self._next(FROM_CLIENT)
            except ProtocolError as error:
                await self._complain(error)
                self._errors += 1
                if error.fatal:
                    raise Closed(1002, "a message could not be read") from error
                if self._errors >= MAX_ERRORS:
                    raise Closed(1008, "too many messages that cannot be used") from error
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
        return decode(data, accept).message

    def _take(self, message: Message) -> None:
        now = time.monotonic()
        if isinstance(message, Pose):
            self._take_pose(message, now)
        elif isinstance(message, Ack):
            self._take_ack(message, now)
        elif isinstance(message, Resync):
            self._on_the_way.clear()
            self._fresh = True
        elif isinstance(message, Settings):
            self._session.bounds = msgspec.structs.replace(
                self._session.bounds, budget_ms=message.budget_ms, max_error=message.max_error
            )
            if message.layers is not None:
                self._session.layers = message.layers
            self._fresh = True

    def _take_ack(self, ack: Ack, now: float) -> None:
        flight = self._on_the_way.pop(ack.id, None)
        if flight is None:
            return
        self._holes = ack.holes
        trip = now - flight.begun
        self._around.metrics.observe("keyframe_latency_seconds", trip)
        if flight.timed:
            old = self._session.latency_s
            self._session.latency_s = trip if old == 0.0 else 0.7 * old + 0.3 * trip

    def _take_pose(self, pose: Pose, now: float) -> None:
        """The mailbox has one slot; a pose that was overtaken on the way is not put there."""
        old = self._pose
        if old is not None and pose.seq < old.seq:
            return
        if old is None or not same_view(old.camera, pose.camera):
            self._moved_at = now
        self._pose, self._pose_at = pose, now

    async def _complain(self, error: ProtocolError | ServiceError) -> None:
        kind = error.kind if isinstance(error, ServiceError) else "invalid-message"
        self._around.metrics.count("stream_errors", kind=kind)
        known = error if isinstance(error, ServiceError) else ServiceError(400, kind, str(error))
        await self._send(Problem(**problem_of(known)))

    async def _send(self, message: Message) -> None:
        await self._socket.send_bytes(encode(message))

    # -------------------------------------------------------------- keyframes

    async def _produce(self) -> None:
        while True:
            kind = self._due()
            if kind is None:
                with contextlib.suppress(asyncio.TimeoutError):
                    await asyncio.wait_for(self._wake.wait(), self._patience())
                self._wake.clear()
                continue
            await self._keyframe(still=kind == "still")

    def _due(self) -> str | None:
        """Which kind of keyframe is wanted now: "moving", "still" or None."""
        pose, shown = self._pose, self._shown
        if pose is None or len(self._on_the_way) >= CREDITS:
            return None
        if self._fresh or shown is None:
            return "moving"
        view = predicted(pose, self._lead())
        if needs_keyframe(shown.view, view, shown.typical_depth, shown.overscan):
            return "moving"
        if same_view(shown.pose, pose.camera) and not pose.moving:
            moved = not same_view(shown.view, pose.camera)
        else:
            moved = True
            if self._holes > MAX_HOLES and not same_view(shown.pose, pose.camera):
                return "moving"
        rested = time.monotonic() - self._moved_at >= self._around.settings.still_s
        return "still" if rested and (moved or not shown.still) else None

    def _patience(self) -> float:
        """Seconds until something may become due without a message."""
        return max(0.01, min(TICK_S, self._moved_at + self._around.settings.still_s - time.monotonic()))

    def _lead(self) -> float:
        """Seconds from the pose to the moment when its keyframe is shown."""
        return time.monotonic() - self._pose_at + self._session.latency_s

    @property
    def _max_pixels(self) -> int:
        return min(self._around.settings.max_stream_pixels, self._hello.max_pixels)

    async def _keyframe(self, *, still: bool) -> None:
        pose, session = self._pose, self._session
        assert pose is not None
        view = pose.camera if still else predicted(pose, self._lead())
        camera = overscanned(view, session.overscan, self._max_pixels)
        number, session.next_id = session.next_id, session.next_id + 1
        self._fresh = False
        flight = self._on_the_way[number] = Flight(time.monotonic(), timed=not still)
        lossless = still and "webp" in self._hello.color
        speed = sum(v * v for v in pose.velocity) ** 0.5 if pose.moving else 0.0
        job = MakeKeyframe(
            session=session.id,
            scene=session.scene,
            id=number,
            pose=pose.seq,
            time_ms=pose.time_ms,
            camera=camera,
            still=still,
            layers=session.layers,
            direction=pose.velocity if speed else (0.0, 0.0, 0.0),
            baseline=speed * REACH_S,
            color="webp" if lossless else "jpeg",
            quality=LOSSLESS if lossless else QUALITY_STILL if still else QUALITY_MOVING,
            bounds=session.bounds,
        )
        try:
            made = await self._around.pool.run(job, renderer=session.renderer)
        except ServiceError as error:
            await self._failed(error, number)
            return
        overscan = min(camera.width * view.fx / (camera.fx * view.width), session.overscan)
        self._shown = Shown(view, pose.camera, overscan, made["typical_depth"], still)
        if number not in self._on_the_way:  # a RESYNC came meanwhile
            return
        self._holes = 0.0
        flight.sent = time.monotonic()
        for message in made["messages"]:
            await self._socket.send_bytes(message)
        metrics = self._around.metrics
        metrics.count("keyframes", kind="still" if still else "moving")
        metrics.count("keyframe_bytes", sum(map(len, made["messages"])))

    async def _failed(self, error: ServiceError, number: int) -> None:
        """Say so; a pose that cannot be rendered is not tried again, a busy renderer is."""
        self._on_the_way.pop(number, None)
        await self._complain(error)
        if error.status == 404:
            raise Closed(SCENE_GONE, "the scene was deleted")
        self._fresh = True
        if error.status in (429, 503):
            await asyncio.sleep(error.retry_after_s or RETRY_S)
        else:
            self._pose = None

    async def _watch(self) -> None:
        """Drop a client that does not acknowledge."""
        while True:
            await asyncio.sleep(TICK_S)
            sent = [flight.sent for flight in self._on_the_way.values() if flight.sent is not None]
            if sent and time.monotonic() - min(sent) > self._around.settings.stall_s:
                raise Closed(1008, "keyframes are not acknowledged")
