"""The guard around an application that answers anything: who may come in, and how much may be brought along."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import PlainTextResponse

from torchrender_service.door.bodies import Bodies
from torchrender_service.door.guard import Guard
from torchrender_service.metrics import Metrics
from torchrender_service.settings import Settings

KEY = "a-key-of-some-letters"


async def _application(scope: Any, receive: Any, send: Any) -> None:
    body = await Request(scope, receive).body()
    await PlainTextResponse(f"{scope['path']} {len(body)}")(scope, receive, send)


def ask(
    path: str,
    *,
    method: str = "GET",
    pieces: tuple[bytes, ...] = (b"",),
    settings: Mapping[str, Any] | None = None,
    **headers: str,
) -> tuple[int, str]:
    """Status and body of a request whose body comes in pieces, of no length that is told before."""
    given = Settings(**(settings or {}))
    guard = Guard(_application, given, Metrics(), Bodies(given))
    named = {"host": "127.0.0.1:8000", **{name.replace("_", "-"): value for name, value in headers.items()}}
    scope = {
        "type": "http", "method": method, "path": path, "raw_path": path.encode(), "query_string": b"",
        "scheme": "http",
        "headers": [(name.encode(), value.encode()) for name, value in named.items()],
        "client": ("127.0.0.1", 1), "server": ("127.0.0.1", 8000), "http_version": "1.1", "root_path": "",
    }  # fmt: skip
    left, sent = list(pieces), []

    async def receive() -> dict[str, Any]:
        return {"type": "http.request", "body": left.pop(0), "more_body": bool(left)}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(guard(scope, receive, send))
    return sent[0]["status"], b"".join(message.get("body", b"") for message in sent[1:]).decode()


@pytest.mark.parametrize("path", ["/v1/plan", "/metrics"])
@pytest.mark.parametrize(
    ("given", "status"),
    [(None, 401), (f"Bearer {KEY}", 200), (f"bearer  {KEY}", 200), (f"Basic {KEY}", 401), (f"Bearer {KEY}x", 401),
     ("Bearer ", 401), (KEY, 401)],
)  # fmt: skip
def test_only_the_key_opens(path: str, given: str | None, status: int) -> None:
    headers = {} if given is None else {"authorization": given}
    assert ask(path, settings={"api_key": KEY}, **headers)[0] == status
    assert ask("/health", settings={"api_key": KEY}, **headers)[0] == 200, "whether it lives is no secret"
    assert ask(path, **headers)[0] == 200, "where no key is set"


@pytest.mark.parametrize(
    ("site", "status"),
    [("cross-site", 403), ("same-site", 403), ("Same-Site", 403), ("same-origin", 200), ("none", 200)],
)
def test_pictures_and_scripts_of_other_pages_get_nothing(site: str, status: int) -> None:
    assert ask("/v1/plan", sec_fetch_site=site)[0] == status


def test_a_body_may_have_as_many_bytes_as_are_allowed_and_no_more() -> None:
    """Whether it says so before or not."""
    limit = Bodies(Settings()).of({"path": "/v1/render"})
    half = bytes(limit // 2)
    whole = (half, bytes(limit - len(half)))
    assert ask("/v1/render", method="POST", pieces=whole) == (200, f"/v1/render {limit}")
    assert ask("/v1/render", method="POST", pieces=whole, content_length=str(limit))[0] == 200
    assert ask("/v1/render", method="POST", content_length=str(limit + 1))[0] == 413
    with pytest.raises(Exception, match=f"at most {limit} bytes"):
        ask("/v1/render", method="POST", pieces=(*whole, b"x"))


@pytest.mark.parametrize(
    ("path", "seen"),
    [("/maps", "/"), ("/maps/v1/plan", "/v1/plan"), ("/mapserver/v1/plan", "/mapserver/v1/plan"), ("/v1", "/v1")],
)
def test_a_proxys_prefix_is_taken_off_and_nothing_that_only_begins_like_it(path: str, seen: str) -> None:
    assert ask(path, settings={"root_path": "/maps"}) == (200, f"{seen} 0")
