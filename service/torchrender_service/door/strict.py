"""Routes that pass over nothing in silence: unknown and repeated query parameters and doubled JSON keys are refused."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Coroutine
from typing import Any, get_origin

from fastapi import HTTPException, Request, Response
from fastapi.routing import APIRoute
from pydantic import BaseModel

from torchrender_service.errors import ServiceError

SHOWN = 80


class StrictRequest(Request):
    """A request whose JSON says everything once."""

    async def json(self) -> Any:
        """The body; HTTPException 422 names a key that stands twice in one object."""
        if not hasattr(self, "_json"):
            self._json = json.loads(await self.body(), object_pairs_hook=_once)
        return self._json


class StrictRoute(APIRoute):
    """For ``APIRouter(route_class=…)``."""

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """The handler behind the checks."""
        handle = super().get_route_handler()
        known = _names(self)  # and whether each may come more than once

        async def strict(request: Request) -> Response:
            check_query(request, known)
            return await handle(StrictRequest(request.scope, request.receive))

        return strict


def check_query(request: Request, known: dict[str, bool]) -> None:
    """Every parameter of the query is known, and there once.

    Raises:
        ServiceError: 422, names the one that is not.
    """
    for name, count in Counter(name for name, _ in request.query_params.multi_items()).items():
        if name not in known:
            told = f"known ones are {', '.join(sorted(known))}" if known else "there are none here"
            raise ServiceError(422, "invalid-value", f"query.{name[:SHOWN]}: unknown parameter; {told}")
        if count > 1 and not known[name]:
            raise ServiceError(422, "invalid-value", f"query.{name}: may be given once, is there {count} times")


def _names(route: APIRoute) -> dict[str, bool]:
    names: dict[str, bool] = {}
    for parameter in route.dependant.query_params:
        kind = parameter.field_info.annotation
        if isinstance(kind, type) and issubclass(kind, BaseModel):  # parameters as fields of a model
            names |= {field.alias or name: _is_list(field.annotation) for name, field in kind.model_fields.items()}
        else:
            names[parameter.alias] = _is_list(kind)
    return names


def _is_list(kind: Any) -> bool:
    return get_origin(kind) is list


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        name, count = Counter(name for name, _ in pairs).most_common(1)[0]
        raise HTTPException(422, f"body.{name[:SHOWN]}: may be given once, is there {count} times")
    return found
