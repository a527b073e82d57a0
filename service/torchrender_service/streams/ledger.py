"""Which sessions there are, who may open their streams, and where each of them runs: the rules, without any waiting.

One ledger counts for all replicas of a service. It compares times of its own clock alone, so that those of other
machines may be wrong; what a replica is not heard from for so long counts as lost, whatever it does.
"""

from __future__ import annotations

import secrets
import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import msgspec

from torchrender.wire.messages import CameraHeader
from torchrender.wire.viewing import Effect, ToneMap
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import Bounds

LOST_S = 3.0
"""A stream of which its replica has said nothing for so long counts as ended then."""
IDS = 2**20
"""Keyframe ids that a connection may use before the next replica's begin: those of a lost one are not known."""
LOOK_S = 0.25
"""Between two looks through all sessions: with very many of them that takes time."""
NEWS = 4096
"""Scenes that were deleted, remembered for replicas that have not heard yet."""


class SessionRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A session as plain values: what its next stream needs, on whichever replica."""

    id: str
    scene: str
    camera: CameraHeader
    extra_layers: int
    overscan: float
    bounds: Bounds
    client: str = "unknown"
    density: float = 1.0
    asymmetry: float | None = None
    exposure: float | Literal["auto", "as_lit"] = "as_lit"
    tone_map: ToneMap = "none"
    off: tuple[Effect, ...] = ()
    settings: int = 0
    scene_s: float | None = None  # of its animation, when this was noted
    playing: bool = False
    next_id: int = 0
    latency_s: float = 0.0


class Beat(msgspec.Struct, frozen=True, kw_only=True):
    """What a replica says about itself, every second or so."""

    replica: str
    connected: tuple[str, ...]  # sessions whose streams it serves
    waiting: tuple[str, ...] = ()  # sessions that it keeps for their clients to come back
    changed: tuple[SessionRecord, ...] = ()
    news: int = 0  # the last deletion that it knows of


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """What it is told."""

    epoch: str  # another one: the ledger was lost and knows nothing of before
    gone: tuple[str, ...]  # sessions that are over, or go on elsewhere
    deleted: tuple[str, ...]  # scenes
    news: int


@dataclass(eq=False)
class _Entry:
    record: SessionRecord
    expires: float
    ticket: str = ""
    replica: str | None = None  # that served it last
    connected: bool = False
    seen: float = 0.0


class SessionLedger:
    """All sessions of a service.

    Args:
        now: seconds of any clock that only goes forward.
    """

    def __init__(
        self,
        *,
        max_sessions: int,
        max_per_address: int,
        ticket_s: float,
        resume_s: float,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._max, self._own = max_sessions, max_per_address
        self._ticket_s, self._resume_s = ticket_s, resume_s
        self._now = now
        self._entries: dict[str, _Entry] = {}
        self._tickets: dict[str, str] = {}
        self._of_client: Counter[str] = Counter()
        self._looked = -LOOK_S
        self._deleted: deque[tuple[int, str]] = deque(maxlen=NEWS)
        self._news = 0
        self.epoch = secrets.token_hex(8)

    def __len__(self) -> int:
        return len(self._entries)

    def count(self) -> int:
        """Sessions that there are now."""
        self.expire(at_once=True)
        return len(self._entries)

    def check_room(self, client: str) -> None:
        """Refuse early.

        Raises:
            ServiceError: 429, as many sessions as may be, of this address or in all.
        """
        full = len(self._entries) >= self._max or self._of_client[client] >= self._own
        self.expire(at_once=full)
        if self._of_client[client] >= self._own:
            detail = f"this address has {self._own} sessions already"
            raise ServiceError(429, "too-many-sessions", detail, retry_after_s=self._ticket_s)
        if len(self._entries) >= self._max:
            soonest = min(entry.expires for entry in self._entries.values()) - self._now()
            wait = min(max(soonest, 1.0), self._ticket_s)
            raise ServiceError(429, "too-many-sessions", f"there are {self._max} sessions already", retry_after_s=wait)

    def add(self, record: SessionRecord) -> str:
        """Keep a new session; returns its ticket, which opens a stream once.

        Raises:
            ServiceError: as :meth:`check_room`.
        """
        self.check_room(record.client)
        entry = _Entry(record, self._now() + self._ticket_s)
        self._put(entry)
        return self._ticket(entry, secrets.token_urlsafe(24))

    def redeem(self, ticket: str, replica: str) -> SessionRecord:
        """Use a ticket up: the session's stream is now on that replica, and no other one.

        Raises:
            ServiceError: 403, unknown, used or expired.
        """
        self.expire()
        entry = self._entries.get(self._tickets.pop(ticket, ""))
        if entry is None or self._is_over(entry):
            raise ServiceError(403, "ticket", "the ticket is unknown, used or expired: make a new session")
        if entry.replica not in (None, replica):
            following = (entry.record.next_id // IDS + 1) * IDS
            entry.record = msgspec.structs.replace(entry.record, next_id=following)
        entry.replica, entry.connected, entry.seen = replica, True, self._now()
        return entry.record

    def renew(self, name: str, replica: str) -> str:
        """A ticket for the next connection; earlier ones no longer work.

        Raises:
            ServiceError: 403, the session is over, or goes on elsewhere.
        """
        entry = self._entries.get(name)
        if entry is None or entry.replica != replica:
            raise ServiceError(403, "ticket", "the session is over: make a new one")
        return self._ticket(entry, secrets.token_urlsafe(24))

    def restore(self, record: SessionRecord, ticket: str, replica: str, connected: bool) -> None:
        """A replica tells what it knows to a ledger that was lost."""
        if record.id in self._entries:
            return
        now = self._now()
        entry = _Entry(record, now + self._resume_s, replica=replica, connected=connected, seen=now)
        self._put(entry)
        self._ticket(entry, ticket)

    def release(self, record: SessionRecord, replica: str) -> None:
        """A stream has ended: the session waits a while for the next one."""
        entry = self._entries.get(record.id)
        if entry is not None and entry.replica == replica:
            entry.record, entry.connected, entry.expires = record, False, self._now() + self._resume_s

    def end(self, name: str) -> None:
        """Forget a session and its tickets."""
        entry = self._entries.pop(name, None)
        if entry is None:
            return
        self._tickets.pop(entry.ticket, None)
        client = entry.record.client
        self._of_client[client] -= 1
        if not self._of_client[client]:
            del self._of_client[client]

    def delete_scene(self, scene: str) -> None:
        """No stream of it is begun any more; replicas hear of it with their next beat."""
        self._news += 1
        self._deleted.append((self._news, scene))
        for name in [name for name, e in self._entries.items() if e.record.scene == scene and not e.connected]:
            self.end(name)

    def beat(self, beat: Beat) -> Told:
        """Take what a replica says, and tell it what has changed."""
        self.expire()
        now = self._now()
        for name in beat.connected:
            entry = self._entries.get(name)
            if entry is not None and entry.replica == beat.replica:
                entry.connected, entry.seen = True, now
        for record in beat.changed:
            entry = self._entries.get(record.id)
            if entry is not None and entry.replica == beat.replica:
                entry.record = record
        gone = [name for name in (*beat.connected, *beat.waiting) if not self._is_of(name, beat.replica)]
        deleted = [scene for number, scene in self._deleted if number > beat.news]
        return Told(epoch=self.epoch, gone=tuple(gone), deleted=tuple(deleted), news=self._news)

    def expire(self, *, at_once: bool = False) -> None:
        """Forget the sessions whose time is over, where that was not done just now."""
        now = self._now()
        if now - self._looked < LOOK_S and not at_once:
            return
        self._looked = now
        for name in [name for name, entry in self._entries.items() if self._is_over(entry)]:
            self.end(name)

    def _is_over(self, entry: _Entry) -> bool:
        now = self._now()
        if entry.connected and now - entry.seen > LOST_S:
            entry.connected, entry.expires = False, entry.seen + self._resume_s
        return not entry.connected and entry.expires < now

    def _put(self, entry: _Entry) -> None:
        self._entries[entry.record.id] = entry
        self._of_client[entry.record.client] += 1

    def _is_of(self, name: str, replica: str) -> bool:
        entry = self._entries.get(name)
        return entry is not None and entry.replica == replica

    def _ticket(self, entry: _Entry, ticket: str) -> str:
        self._tickets.pop(entry.ticket, None)
        entry.ticket = ticket
        self._tickets[ticket] = entry.record.id
        return ticket
