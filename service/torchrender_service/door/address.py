"""Where a request comes from."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from functools import lru_cache

from starlette.datastructures import Headers
from starlette.types import Scope

UNKNOWN = "unknown"
OWN_BITS = 64
"""Of an IPv6 address: the rest is one customer's to choose."""


@lru_cache(maxsize=4096)
def group_of(address: str) -> str:
    """The address that limits count for: whole for IPv4, the first 64 bits for IPv6."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return UNKNOWN
    if isinstance(found, ipaddress.IPv6Address):
        if found.ipv4_mapped is not None:
            return str(found.ipv4_mapped)
        if not found.is_loopback:
            return str(ipaddress.ip_network((int(found) >> OWN_BITS << OWN_BITS, OWN_BITS)).network_address)
    return str(found)


def peer_of(peer: object) -> str:
    """The address group of a socket's peer name."""
    return group_of(str(peer[0])) if isinstance(peer, tuple) and peer else UNKNOWN


def client_of(scope: Scope, proxies: Sequence[str]) -> str:
    """The address group that a request counts for: that of its connection, or where this is a proxy that is trusted,
    the last one that the proxy names in ``X-Forwarded-For``."""
    direct = peer_of(scope.get("client"))
    if direct not in proxies:
        return direct
    named = [part.strip() for line in Headers(scope=scope).getlist("x-forwarded-for") for part in line.split(",")]
    while named and group_of(named[-1]) in proxies:
        named.pop()
    return group_of(named[-1]) if named else direct
