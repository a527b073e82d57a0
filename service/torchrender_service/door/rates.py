"""How many requests one address may make, a second and at a time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from limits import RateLimitItemPerSecond
from limits.storage import MemoryStorage
from limits.strategies import FixedWindowRateLimiter

from torchrender_service.errors import ServiceError
from torchrender_service.settings import Settings

RETRY_S = 1.0


class Quota:
    """So many at a time: in all, and of one address."""

    def __init__(self, what: str, most: int, most_of_one: int) -> None:
        self._what = what
        self._most = most
        self._most_of_one = most_of_one
        self._under_way: Counter[str] = Counter()

    def __len__(self) -> int:
        return self._under_way.total()

    @contextmanager
    def take(self, client: str) -> Iterator[None]:
        """One more, until it is done.

        Raises:
            ServiceError: 429 this address has too many, 503 all together have.
        """
        if self._under_way[client] >= self._most_of_one:
            detail = f"{self._most_of_one} {self._what} of this address are under way already"
            raise ServiceError(429, "busy", detail, retry_after_s=RETRY_S)
        if len(self) >= self._most:
            raise ServiceError(503, "busy", f"{self._most} {self._what} are under way", retry_after_s=RETRY_S)
        self._under_way[client] += 1
        try:
            yield
        finally:
            self._under_way[client] -= 1
            if not self._under_way[client]:
                del self._under_way[client]


class Rates:
    """Requests a second of each address."""

    def __init__(self, settings: Settings) -> None:
        self._item = RateLimitItemPerSecond(settings.requests_per_s)
        self._limiter = FixedWindowRateLimiter(MemoryStorage())

    def check(self, client: str) -> None:
        """Count a request.

        Raises:
            ServiceError: 429, too many in this second.
        """
        if not self._limiter.hit(self._item, client):
            detail = f"at most {self._item.amount} requests a second of one address"
            raise ServiceError(429, "too-many-requests", detail, retry_after_s=RETRY_S)
