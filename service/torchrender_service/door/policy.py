"""Headers that tell browsers what a page of this service may do: nothing but talk to the service that sent it."""

from __future__ import annotations

import re
from collections.abc import Sequence

from starlette.datastructures import Headers
from starlette.types import Scope

_HOST = re.compile(r"[A-Za-z0-9.:\[\]_-]{1,255}")
_COMMON = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
)
# The decoder of zstd comes as data within its script.
_NO_FRAMES = (b"x-frame-options", b"DENY")
_NOTHING = "default-src 'none'; frame-ancestors 'none'"
_PAGE = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' data: blob:; "
    "connect-src 'self' data:{sockets}; worker-src 'self'; form-action 'none'; base-uri 'none'; "
    "frame-ancestors {frames}"
)


def security_headers(scope: Scope, frames: Sequence[str] = ()) -> list[tuple[bytes, bytes]]:
    """For every answer; answers of the API may do nothing at all.

    Args:
        frames: sources of pages that may show the page within theirs; none: no page may.
    """
    if scope["path"].startswith("/v1/"):
        return [*_COMMON, _NO_FRAMES, (b"content-security-policy", _NOTHING.encode())]
    host = Headers(scope=scope).get("host", "")
    sockets = f" ws://{host} wss://{host}" if _HOST.fullmatch(host) else ""
    policy = _PAGE.format(sockets=sockets, frames=" ".join(frames) or "'none'")
    rest = [] if frames else [_NO_FRAMES]
    return [*_COMMON, *rest, (b"content-security-policy", policy.encode())]
