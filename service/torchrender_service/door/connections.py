"""All connections of the server: how many there may be, and how long each may keep it waiting.

Nothing that a client leaves undone lasts: headers, bodies, answers that are not read and idle connections each have a
deadline. Where there are too many connections, the one that has waited longest with nothing to do makes room, of the
address that has the most; so a client that only opens connections pushes out its own.
"""

from __future__ import annotations

import asyncio
import logging
import sys
import time
from collections import OrderedDict
from typing import Any, Protocol

from torchrender_service.door.accepting import Arrivals
from torchrender_service.door.gate import Gate
from torchrender_service.metrics import Metrics
from torchrender_service.settings import Settings

LOG = logging.getLogger("torchrender_service.door.connections")
SWEEP_S = 0.5
SPARE_FILES = 192
"""Of the files that a process may open: for scenes, pipes and libraries."""


class Visitor(Protocol):
    """A connection, as whoever counts it sees it."""

    address: str

    def overdue(self, now: float) -> str | None:
        """The deadline that has passed, by its name; None while it keeps to all."""

    def turn_away(self, reason: str) -> None:
        """End it."""


class Connections:
    """Everybody who is connected."""

    def __init__(self, settings: Settings, metrics: Metrics) -> None:
        self._settings = settings
        self._metrics = metrics
        self._most = settings.max_connections
        self._busy: dict[str, set[Visitor]] = {}
        self._idle: dict[str, OrderedDict[Visitor, None]] = {}  # waiting for a request, the longest first
        self._count = 0
        self._turned_away: dict[str, int] = {}
        self._refusals: dict[str, int] = {}
        gate = Gate(self._shut_out)
        self.arrivals = Arrivals(settings, lambda: self._refuse("connections a second of one address"), gate)

    def __len__(self) -> int:
        return self._count

    def open_files(self) -> None:
        """Let the process have as many files as the system allows, and keep below that."""
        if sys.platform == "win32":
            return
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
        except (ValueError, OSError):
            LOG.debug("the limit of open files stays at %d", soft)
        if soft != resource.RLIM_INFINITY:
            self._most = max(16, min(self._most, soft - SPARE_FILES))

    def of(self, address: str) -> int:
        """How many an address has."""
        return len(self._busy.get(address, ())) + len(self._idle.get(address, ()))

    def come(self, visitor: Visitor) -> bool:
        """A connection was made; False: there is no room for it."""
        address = visitor.address
        own = self._settings.max_connections_per_address
        if address not in self._settings.trusted_proxies and self.of(address) >= own and not self._make_room(address):
            return self._refuse("connections of one address")
        if self._count >= self._most and not self._make_room(None):
            return self._refuse("connections")
        self._count += 1
        self.waits(visitor)
        return True

    def waits(self, visitor: Visitor) -> None:
        """It has no request under way."""
        self._leave_groups(visitor)
        self._idle.setdefault(visitor.address, OrderedDict())[visitor] = None

    def works(self, visitor: Visitor) -> None:
        """A request of it is under way."""
        self._leave_groups(visitor)
        self._busy.setdefault(visitor.address, set()).add(visitor)

    def gone(self, visitor: Visitor) -> None:
        """It is closed; a second time does nothing."""
        if self._leave_groups(visitor):
            self._count -= 1

    def _leave_groups(self, visitor: Visitor) -> bool:
        address, found = visitor.address, False
        for groups in (self._busy, self._idle):
            group: Any = groups.get(address)
            if group is None or visitor not in group:
                continue
            found = True
            group.remove(visitor) if isinstance(group, set) else group.pop(visitor)
            if not group:
                del groups[address]
        return found

    def _make_room(self, address: str | None) -> bool:
        """End the connection that has waited longest, of this address or of the one that has the most."""
        if address is None:
            if not self._idle:
                return False
            address = max(self._idle, key=self.of)
        waiting = self._idle.get(address)
        if not waiting:
            return False
        visitor = next(iter(waiting))
        self.gone(visitor)
        self._end(visitor, "room")
        return True

    def _end(self, visitor: Visitor, reason: str) -> None:
        self._turned_away[reason] = self._turned_away.get(reason, 0) + 1
        self._metrics.count("connections_ended", reason=reason)
        visitor.turn_away(reason)

    def _refuse(self, what: str) -> bool:
        self._refusals[what] = self._refusals.get(what, 0) + 1
        self._metrics.count("rejected", kind=what.replace(" ", "-"))
        return False

    def _shut_out(self, address: str, seconds: float) -> None:
        self._metrics.count("addresses_shut_out")
        LOG.warning("new connections of an address wait", extra={"client": address, "seconds": seconds})

    async def sweep(self) -> None:
        """End whoever is late, for ever; what was done is a line of the log at most once a second."""
        told = time.monotonic()
        while True:
            await asyncio.sleep(SWEEP_S)
            now = time.monotonic()
            self.arrivals.gate.open(now)
            self.end_overdue(now)
            if now - told >= 1.0 and (self._turned_away or self._refusals):
                facts = {"ended": dict(self._turned_away), "refused": dict(self._refusals), "open": self._count}
                LOG.warning("connections were closed", extra=facts)
                self._turned_away.clear()
                self._refusals.clear()
                told = now

    def end_overdue(self, now: float) -> None:
        """End whoever is late."""
        groups: list[Any] = [*self._idle.values(), *self._busy.values()]
        for visitor in [one for group in groups for one in group]:
            reason = visitor.overdue(now)
            if reason is not None:
                self._end(visitor, reason)
