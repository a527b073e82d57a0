"""Sessions and their one-use tickets."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, Protocol

from torchrender.wire.messages import CameraHeader
from torchrender.wire.viewing import Effect, ToneMap
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import Bounds, SceneSource
from torchrender_service.settings import Settings


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
    expires: float  # monotonic time after which it is gone, unless a stream is connected
    density: float = 1.0  # of all media, as a multiple of their own
    asymmetry: float | None = None  # of all media; None: each its own
    exposure: float | Literal["auto", "as_lit"] = "as_lit"  # EV
    tone_map: ToneMap = "none"
    off: tuple[Effect, ...] = ()  # effects that are left out
    settings: int = 0  # seq of the newest SETTINGS
    clock: SceneClock = field(default_factory=SceneClock)  # of the scene's animation
    next_id: int = 0  # of the next keyframe
    latency_s: float = 0.0  # from a pose's arrival to its keyframe's acknowledgement; 0: not known yet
    connection: Connection | None = field(default=None, repr=False)  # set and cleared by the store alone


class SessionStore:
    """All sessions of the process.

    Args:
        on_end: called with each session that is gone.
    """

    def __init__(self, settings: Settings, on_end: Callable[[Session], None]) -> None:
        self._settings = settings
        self._on_end = on_end
        self._sessions: dict[str, Session] = {}
        self._tickets: dict[str, str] = {}

    def __len__(self) -> int:
        return len(self._sessions)

    @property
    def connections(self) -> list[Connection]:
        """The streams that are connected."""
        return [s.connection for s in self._sessions.values() if s.connection is not None]

    def check_room(self, client: str = "unknown") -> None:
        """Refuse early.

        Raises:
            ServiceError: 429, as many sessions as may be, of this address or in all.
        """
        self.expire()
        own = [s for s in self._sessions.values() if s.client == client]
        if len(own) >= self._settings.max_sessions_per_address:
            limit = self._settings.max_sessions_per_address
            detail = f"this address has {limit} sessions already"
            raise ServiceError(429, "too-many-sessions", detail, retry_after_s=self._settings.ticket_s)
        if len(self._sessions) >= self._settings.max_sessions:
            soonest = min(s.expires for s in self._sessions.values()) - time.monotonic()
            wait = min(max(soonest, 1.0), self._settings.ticket_s)
            limit = self._settings.max_sessions
            raise ServiceError(429, "too-many-sessions", f"there are {limit} sessions already", retry_after_s=wait)

    def add(self, session: Session) -> str:
        """Keep a session; returns its ticket."""
        self.check_room(session.client)
        self._sessions[session.id] = session
        return self.ticket(session)

    def ticket(self, session: Session) -> str:
        """A new one-use ticket; the session's earlier ones no longer work."""
        self._tickets = {t: s for t, s in self._tickets.items() if s != session.id}
        ticket = secrets.token_urlsafe(24)
        self._tickets[ticket] = session.id
        return ticket

    def redeem(self, ticket: str) -> Session:
        """The session of a ticket, which is used up.

        Raises:
            ServiceError: 403, unknown, used or expired.
        """
        self.expire()
        session = self._sessions.get(self._tickets.pop(ticket, ""))
        if session is None:
            raise ServiceError(403, "ticket", "the ticket is unknown, used or expired: make a new session")
        return session

    def connect(self, session: Session, connection: Connection) -> None:
        """A stream begins. An older one ends: the client opened this one before that was found dead."""
        if session.connection is not None:
            session.connection.end(1008, "the session goes on in another connection")
        session.connection = connection

    def release(self, session: Session, connection: Connection) -> bool:
        """A stream has ended: wait a while for the next one; False where that is there already."""
        if session.connection is not connection:
            return False
        session.connection = None
        session.expires = time.monotonic() + self._settings.resume_s
        return True

    def end(self, session: Session) -> None:
        """Forget a session and its tickets."""
        if self._sessions.pop(session.id, None) is not None:
            self._tickets = {t: s for t, s in self._tickets.items() if s != session.id}
            self._on_end(session)

    def expire(self) -> None:
        """Forget the sessions whose time is over."""
        now = time.monotonic()
        for session in [s for s in self._sessions.values() if s.connection is None and s.expires < now]:
            self.end(session)

    def of_scene(self, scene: str) -> list[Session]:
        """Sessions that show a scene."""
        return [s for s in self._sessions.values() if s.scene.id == scene]
