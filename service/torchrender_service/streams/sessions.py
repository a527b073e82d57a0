"""Sessions whose streams this process serves, and their one-use tickets."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from torchrender.wire.messages import CameraHeader
from torchrender.wire.viewing import Effect, ToneMap
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import Bounds, SceneSource
from torchrender_service.streams.directory import SessionDirectory
from torchrender_service.streams.ledger import IDS, Beat, SessionRecord

LOG = logging.getLogger("torchrender_service.streams.sessions")
ALIKE = (
    *("id", "camera", "extra_layers", "overscan", "bounds", "client", "density", "asymmetry", "exposure", "tone_map"),
    *("off", "settings", "next_id", "latency_s"),
)
"""Of a session and its record."""


class Connection(Protocol):
    """What a session knows of the stream that is connected."""

    def end(self, code: int, reason: str) -> None:
        """Close with a code."""

    def refresh(self) -> None:
        """The scene has changed: a new keyframe is wanted."""

    def look(self, camera: CameraHeader) -> None:
        """Ask the client to look from there."""

    @property
    def camera(self) -> CameraHeader | None:
        """Where the client looks from; None: it has not said yet."""


@dataclass
class SceneClock:
    """Seconds into a scene's animation, counted while it plays."""

    playing: bool = False
    _passed: float | None = None  # until the last start or stop; None: never started
    _since: float = 0.0

    def play(self, playing: bool, now: float) -> None:
        """Go on, or stop."""
        if playing != self.playing:
            self._passed, self._since, self.playing = self.at(now) or 0.0, now, playing

    def at(self, now: float) -> float | None:
        """Seconds; None where it never started."""
        if self._passed is None or not self.playing:
            return self._passed
        return self._passed + now - self._since


@dataclass(eq=False, kw_only=True)
class Session:
    """What a client asked for, and what the server learned about it; outlives a connection for a while."""

    id: str
    scene: SceneSource
    facts: dict[str, object]  # about the scene
    camera: CameraHeader
    extra_layers: int
    overscan: float
    bounds: Bounds
    renderer: RendererHandle
    client: str = "unknown"  # the address that it counts for
    density: float = 1.0  # of all media, as a multiple of their own
    asymmetry: float | None = None  # of all media; None: each its own
    exposure: float | Literal["auto", "as_lit"] = "as_lit"  # EV
    tone_map: ToneMap = "none"
    off: tuple[Effect, ...] = ()  # effects that are left out
    settings: int = 0  # seq of the newest SETTINGS
    clock: SceneClock = field(default_factory=SceneClock)  # of the scene's animation
    next_id: int = 0  # of the next keyframe
    latency_s: float = 0.0  # from a pose's arrival to its keyframe's acknowledgement; 0: not known yet
    ticket: str = ""  # for the next connection; empty: the client has none
    connection: Connection | None = field(default=None, repr=False)  # set and cleared by the store alone

    @staticmethod
    def of(record: SessionRecord, scene: SceneSource, facts: dict[str, object], renderer: RendererHandle) -> Session:
        """The session of a record, here."""
        given: dict[str, Any] = {name: getattr(record, name) for name in ALIKE}
        session = Session(scene=scene, facts=facts, renderer=renderer, **given)
        if record.scene_s is not None:
            session.clock = SceneClock(_passed=record.scene_s)
            session.clock.play(record.playing, time.monotonic())
        return session

    def record(self) -> SessionRecord:
        """As plain values."""
        given: dict[str, Any] = {name: getattr(self, name) for name in ALIKE}
        clock = self.clock
        return SessionRecord(scene=self.scene.id, scene_s=clock.at(time.monotonic()), playing=clock.playing, **given)


class SessionStore:
    """The sessions whose streams run here, or did last.

    Args:
        on_end: called with each session that is no longer here.
        directory: of the sessions of all replicas.
        replica: name of this one.
    """

    def __init__(self, on_end: Callable[[Session], None], directory: SessionDirectory, replica: str = "") -> None:
        self.directory = directory
        self._replica = replica
        self._on_end = on_end
        self._sessions: dict[str, Session] = {}
        self._noted: dict[str, tuple[object, ...]] = {}  # what the directory knows of them
        self._epoch: str | None = None
        self._news = 0

    def __len__(self) -> int:
        return len(self._sessions)

    @property
    def connections(self) -> list[Connection]:
        """The streams that are connected."""
        return [s.connection for s in self._sessions.values() if s.connection is not None]

    async def redeem(self, ticket: str) -> SessionRecord:
        """The record of the session of a ticket, which is used up.

        Raises:
            ServiceError: 403, unknown, used or expired; 503, the directory is out of reach.
        """
        return await self.directory.redeem(ticket, self._replica)

    def find(self, record: SessionRecord) -> Session | None:
        """The session of a record, if it was here last."""
        session = self._sessions.get(record.id)
        if session is not None and record.next_id // IDS > session.next_id // IDS:  # it was elsewhere meanwhile
            self._drop(session)
            return None
        return session

    def put(self, session: Session) -> None:
        """A session comes here."""
        self._sessions[session.id] = session
        self._noted[session.id] = _lasting(session)

    async def renew(self, session: Session) -> str:
        """A new one-use ticket; the session's earlier ones no longer work."""
        session.ticket = await self.directory.renew(session.id, self._replica)
        return session.ticket

    def connect(self, session: Session, connection: Connection) -> None:
        """A stream begins. An older one ends: the client opened this one before that was found dead."""
        if session.connection is not None:
            session.connection.end(1008, "the session goes on in another connection")
        session.connection = connection

    def release(self, session: Session, connection: Connection | None) -> bool:
        """A stream has ended: wait a while for the next one; False where that is there already."""
        if session.connection is not connection:
            return False
        session.connection = None
        if self._sessions.get(session.id) is session:
            self.directory.release(session.record(), self._replica)
        return True

    def end(self, session: Session) -> None:
        """Forget a session and its tickets."""
        if self._sessions.get(session.id) is session:
            self.directory.end(session.id)
            self._drop(session)

    async def beat(self) -> tuple[str, ...]:
        """Tell the directory how it is here, and end what is over; returns scenes that were deleted elsewhere.

        Raises:
            ServiceError: 503, the directory is out of reach.
        """
        sessions = list(self._sessions.values())
        changed = [session for session in sessions if self._noted[session.id] != _lasting(session)]
        told = await self.directory.beat(
            Beat(
                replica=self._replica,
                connected=tuple(s.id for s in sessions if s.connection is not None),
                waiting=tuple(s.id for s in sessions if s.connection is None),
                changed=tuple(session.record() for session in changed),
                news=self._news,
            )
        )
        self._noted |= {session.id: _lasting(session) for session in changed if session.id in self._sessions}
        known, self._epoch, self._news = self._epoch in (None, told.epoch), told.epoch, told.news
        if not known:
            LOG.warning("the directory of sessions has lost what it knew", extra={"sessions": len(sessions)})
            for session in sessions:
                self.directory.restore(session.record(), session.ticket, self._replica, session.connection is not None)
            return ()
        for session in sessions:
            if session.id not in told.gone or self._sessions.get(session.id) is not session:
                continue
            if session.connection is not None:
                session.connection.end(1008, "the session goes on in another connection")
            self._drop(session)
        return told.deleted

    def of_scene(self, scene: str) -> list[Session]:
        """Sessions that show a scene."""
        return [s for s in self._sessions.values() if s.scene.id == scene]

    def _drop(self, session: Session) -> None:
        del self._sessions[session.id], self._noted[session.id]
        self._on_end(session)


def _lasting(session: Session) -> tuple[object, ...]:
    """What a client has set: it is told at once where it changes, the rest when the stream ends."""
    names = ("extra_layers", "bounds", "density", "asymmetry", "exposure", "tone_map", "off", "settings")
    return (*(getattr(session, name) for name in names), session.clock.playing)
