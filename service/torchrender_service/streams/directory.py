"""Where sessions are looked up: within the process, or for all replicas of a service in one place."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Any

from torchrender_service.settings import Settings
from torchrender_service.streams.ledger import Beat, SessionLedger, SessionRecord, Told

Ask = Callable[..., Awaitable[Any]]
"""Calls a method of a ledger by its name and hands its result, or its error, back."""
Tell = Callable[..., None]
"""The same without waiting; calls arrive in their order."""


class SessionDirectory:
    """A :class:`SessionLedger`, wherever it is; what the methods do is said there.

    Raises, of all that is awaited:
        ServiceError: what the ledger says, or 503 where it cannot be reached.
    """

    def __init__(self, ask: Ask, tell: Tell) -> None:
        self._ask, self._tell = ask, tell

    async def count(self) -> int:
        """Sessions of all replicas."""
        found: int = await self._ask("count")
        return found

    async def check_room(self, client: str) -> None:
        """Refuse early."""
        await self._ask("check_room", client)

    async def add(self, record: SessionRecord) -> str:
        """Keep a new session; returns its ticket."""
        ticket: str = await self._ask("add", record)
        return ticket

    async def redeem(self, ticket: str, replica: str) -> SessionRecord:
        """Use a ticket up."""
        record: SessionRecord = await self._ask("redeem", ticket, replica)
        return record

    async def renew(self, name: str, replica: str) -> str:
        """A ticket for the next connection."""
        ticket: str = await self._ask("renew", name, replica)
        return ticket

    async def beat(self, beat: Beat) -> Told:
        """Tell and be told what has changed."""
        told: Told = await self._ask("beat", beat)
        return told

    def restore(self, record: SessionRecord, ticket: str, replica: str, connected: bool) -> None:
        """Tell a ledger that was lost."""
        self._tell("restore", record, ticket, replica, connected)

    def release(self, record: SessionRecord, replica: str) -> None:
        """A stream has ended."""
        self._tell("release", record, replica)

    def end(self, name: str) -> None:
        """Forget a session."""
        self._tell("end", name)

    def delete_scene(self, scene: str) -> None:
        """No stream of it is begun any more."""
        self._tell("delete_scene", scene)


def make_ledger(settings: Settings) -> SessionLedger:
    """A ledger with the limits of a service."""
    return SessionLedger(
        max_sessions=settings.max_sessions,
        max_per_address=settings.max_sessions_per_address,
        ticket_s=settings.ticket_s,
        resume_s=settings.resume_s,
    )


def local_directory(ledger: SessionLedger) -> SessionDirectory:
    """Of a service that is one process."""

    async def ask(name: str, *given: Any) -> Any:
        return getattr(ledger, name)(*given)

    def tell(name: str, *given: Any) -> None:
        getattr(ledger, name)(*given)

    return SessionDirectory(ask, tell)
