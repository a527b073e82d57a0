"""Problem documents (RFC 9457): the one place where errors become responses."""

from __future__ import annotations

import json
import logging
from http import HTTPStatus
from typing import Any

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from torchrender.errors import SceneFileError, TorchRenderError
from torchrender_service.errors import ServiceError

LOG = logging.getLogger("torchrender_service.problems")
MEDIA_TYPE = "application/problem+json"
PREFIX = "urn:torchrender:problem:"
TITLES = {
    400: "Bad request",
    401: "An API key or ticket is needed",
    403: "Not allowed",
    404: "Not found",
    405: "Method not allowed",
    406: "No such representation",
    408: "Too late",
    409: "Conflict",
    413: "Too large",
    414: "The address is too long",
    415: "Unsupported media type",
    421: "Not a name of this service",
    422: "A value cannot be used",
    429: "Too many requests",
    431: "The headers are too large",
    500: "Internal error",
    499: "The client has left",
    503: "Not available now",
    507: "No room on the disk",
}
_KINDS = {404: "not-found", 405: "method-not-allowed", 400: "bad-request", 422: "invalid-value"}
_SHOWN_ERRORS = 16


class Problem(BaseModel):
    """What is wrong, as in RFC 9457."""

    type: str
    title: str
    status: int
    detail: str


PROBLEMS: dict[int | str, dict[str, Any]] = {
    code: {"description": text, "content": {"application/problem+json": {"schema": Problem.model_json_schema()}}}
    for code, text in {
        400: "The body cannot be parsed.",
        401: "The API key is missing or wrong.",
        403: "Not allowed.",
        404: "There is nothing of that name.",
        406: "None of the accepted media types can be made.",
        409: "The store is full.",
        413: "The body is too large.",
        415: "The body is of another media type.",
        421: "The Host header names another service.",
        422: "A value is out of range or does not fit the scene.",
        429: "Too many sessions or requests; Retry-After says when to try again.",
        503: "The server is starting or stopping, too much is under way, or a renderer was lost.",
        507: "The disk is full.",
    }.items()
}


def problems(*codes: int) -> dict[int | str, dict[str, Any]]:
    """Responses of a route besides its own."""
    return {code: PROBLEMS[code] for code in sorted({401, 403, 421, 429, 503, *codes})}


def problem_of(error: ServiceError) -> dict[str, Any]:
    """The document of an error."""
    return {
        "type": PREFIX + error.kind,
        "title": TITLES.get(error.status, "Error"),
        "status": error.status,
        "detail": error.detail.encode("utf-8", "backslashreplace").decode(),
    }


def problem_response(error: ServiceError, **extra: Any) -> Response:
    """The response of an error."""
    headers = {}
    if error.retry_after_s is not None:
        headers["Retry-After"] = str(max(1, round(error.retry_after_s)))
    if error.status == 401:
        headers["WWW-Authenticate"] = "Bearer"
    content = json.dumps(problem_of(error) | extra)
    return Response(content, status_code=error.status, media_type=MEDIA_TYPE, headers=headers)


def last_answer(error: ServiceError) -> bytes:
    """The response of an error as it goes over the wire, from where there is no application: it ends a connection."""
    body = json.dumps(problem_of(error)).encode()
    lines = [
        f"HTTP/1.1 {error.status} {HTTPStatus(error.status).phrase}",
        f"content-type: {MEDIA_TYPE}",
        f"content-length: {len(body)}",
        *([] if error.retry_after_s is None else [f"retry-after: {max(1, round(error.retry_after_s))}"]),
        "connection: close",
    ]
    return "\r\n".join(lines).encode() + b"\r\n\r\n" + body


def service_error(error: Exception) -> ServiceError:
    """Any error of the package as one of the service."""
    if isinstance(error, ServiceError):
        return error
    if isinstance(error, SceneFileError):
        where = f"{error.key}: " if error.key else ""
        return ServiceError(422, "scene-file", where + error.reason)
    if isinstance(error, TorchRenderError):
        return ServiceError(422, "invalid-value", str(error))
    return ServiceError(500, "internal", "the server met an error of its own; it is in the log")


def add_error_handlers(app: FastAPI) -> None:
    """Turn every error into a problem document."""

    @app.exception_handler(TorchRenderError)
    async def known(request: Request, error: TorchRenderError) -> Response:
        del request
        return problem_response(service_error(error))

    @app.exception_handler(RequestValidationError)
    async def invalid(request: Request, error: RequestValidationError) -> Response:
        kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
        if not kind.endswith("json") and any(e["loc"] == ("body",) for e in error.errors()):
            detail = f"Content-Type must be application/json, got {kind[:80] or 'none'}"
            return problem_response(ServiceError(415, "media-type", detail))
        # The values themselves are left out: they may be NaN, huge, or not even text.
        found = [{"at": _place(e["loc"]), "reason": str(e["msg"])} for e in error.errors()[:_SHOWN_ERRORS]]
        detail = "; ".join(f"{e['at']}: {e['reason']}" for e in found)
        return problem_response(ServiceError(422, "invalid-value", detail[:2000]), errors=found)

    @app.exception_handler(ClientDisconnect)
    async def left(request: Request, error: ClientDisconnect) -> Response:
        del request, error
        return Response(status_code=499)  # nobody reads it

    @app.exception_handler(HTTPException)
    async def http(request: Request, error: HTTPException) -> Response:
        del request
        kind = _KINDS.get(error.status_code, "http")
        response = problem_response(ServiceError(error.status_code, kind, str(error.detail)))
        response.headers.update(error.headers or {})
        return response

    @app.exception_handler(Exception)
    async def unknown(request: Request, error: Exception) -> Response:
        LOG.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return problem_response(service_error(error))


def _place(parts: Any) -> str:
    return ".".join(str(part) for part in parts).encode("utf-8", "backslashreplace").decode()
