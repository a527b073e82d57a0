"""Making a session, and what can go wrong with it and its stream."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from collections.abc import Mapping
from typing import Any

import msgspec
from websockets.exceptions import ConnectionClosed

from torchrender.errors import TorchRenderError
from torchrender.scene.camera import Cameras
from torchrender.wire.cameras import header_of


class StreamError(TorchRenderError):
    """The service refuses a request or a message; ``problem`` is its problem document where it sent one."""

    def __init__(self, reason: str, problem: Mapping[str, Any] | None = None) -> None:
        self.problem = dict(problem or {})
        super().__init__(reason)


class StreamClosed(StreamError):
    """The stream has ended; ``retry_after_s`` says when to try again, None: no reason to."""

    def __init__(self, reason: str, retry_after_s: float | None = None) -> None:
        self.retry_after_s = retry_after_s
        super().__init__(reason)


def post_session(url: str, body: Mapping[str, Any], api_key: str | None, timeout_s: float) -> dict[str, Any]:
    """What the service answers to a request for a session.

    Raises:
        StreamError: the service refuses, with its problem document, or cannot be reached.
    """
    headers = {"Content-Type": "application/json"}
    if api_key is not None:
        headers["Authorization"] = f"Bearer {api_key}"
    camera = body.get("camera")
    if isinstance(camera, Cameras):
        body = {**body, "camera": msgspec.to_builtins(header_of(camera))}
    request = urllib.request.Request(url, json.dumps(body).encode(), headers, method="POST")
    try:
        with urllib.request.urlopen(request, timeout=timeout_s) as response:
            return dict(json.load(response))
    except urllib.error.HTTPError as error:
        try:
            problem = json.load(error)
        except ValueError:
            problem = {}
        if not isinstance(problem, Mapping):
            problem = {}
        told = str(problem.get("detail", error.reason))
        if error.code == 405 or not problem:  # another page than that which makes sessions
            told = f"{url} answers {error.code} ({told}): no torchrender service has that address"
        raise StreamError(told, problem) from error
    except (OSError, ValueError) as error:
        raise StreamError(f"{url} cannot be reached ({error})") from error


def closed(error: ConnectionClosed) -> StreamClosed:
    """The end of a stream, and whether to come again."""
    code, reason = (1006, "") if error.rcvd is None else (error.rcvd.code, error.rcvd.reason)
    told = f"the stream was closed with {code}" + (f": {reason}" if reason else "")
    return StreamClosed(told, 1.0 if code in (1006, 1012) else None)
