"""Materials for a scene from a photo."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problems
from torchrender_service.renderers.jobs import StylePhoto
from torchrender_service.web.negotiation import negotiate, warning_headers
from torchrender_service.web.schemas import SceneId
from torchrender_service.web.state import state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["style"], route_class=StrictRoute)

PHOTOS = ("image/jpeg", "image/png")
RESULTS = {"model/gltf-binary": "glb", "image/png": "png", "application/json": "json"}
MAX_LOCKS = 256
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_NUMBER = r"\d{1,9}(?:\.\d{1,6})?"
_PICK = re.compile(rf"(.{{1,200}})=({_NUMBER}),({_NUMBER}),({_NUMBER}),({_NUMBER})", re.DOTALL)
_HEADERS = {
    "Server-Timing": {"description": "milliseconds of each stage", "schema": {"type": "string"}},
    "Torchrender-Warnings": {"description": "what could not be done, JSON", "schema": {"type": "string"}},
}
_DONE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "As Accept asks: the scene with its new materials (GLB), a contact sheet of all views beside the"
        " photo (PNG), or materials, costs and candidates (JSON).",
        "content": {"model/gltf-binary": _BINARY, "image/png": _BINARY, "application/json": {}},
        "headers": _HEADERS,
    }
}
Words = Annotated[list[Annotated[str, Field(min_length=1, max_length=260)]], Field(max_length=MAX_LOCKS)]


class StyleQuery(BaseModel):
    """Parameters of a style."""

    model_config = ConfigDict(extra="forbid")

    scene: Annotated[SceneId, Field(examples=["cornell_box"])]
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    views: Annotated[int, Field(ge=8, le=15)] = 10
    by: Annotated[Literal["object", "mesh", "material"], Field(description="what gets one material")] = "object"
    prior: Annotated[
        float, Field(ge=0.0, le=100.0, allow_inf_nan=False, description="weight of light walls and darker furniture")
    ] = 1.0
    keep_textures: bool = False
    lock: Words = []
    pick: Words = []


@router.post(
    "/style",
    response_class=Response,
    responses=_DONE | problems(400, 403, 404, 406, 413, 415, 422, 429, 503),
    openapi_extra={"requestBody": {"required": True, "content": dict.fromkeys(PHOTOS, _BINARY)}},
)
async def style(
    request: Request,
    query: Annotated[StyleQuery, Query()],
) -> Response:
    """Give a scene materials in the colours of the photo in the body.

    ``lock`` names objects that keep their material; ``pick``, as ``table=120,80,200,140``, the part of the photo (left,
    top, right, bottom in pixels) that an object takes its material from.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in PHOTOS:
        raise ServiceError(415, "media-type", f"Content-Type must be one of {', '.join(PHOTOS)}")
    media_type = negotiate(request.headers.get("accept"), list(RESULTS))
    state = state_of(request)
    async with state.bodies.read(request) as photo:
        job = StylePhoto(
            scene=await state.scenes.find(query.scene),
            photo=photo,
            format=RESULTS[media_type],
            max_pixels=state.settings.max_texture_pixels,
            seed=query.seed,
            views=query.views,
            by=query.by,
            prior=query.prior,
            keep_textures=query.keep_textures,
            lock=tuple(query.lock),
            pick=_picks(query.pick),
        )
        made = await work(request, job)
    times = ", ".join(f"{stage};dur={ms:.2f}" for stage, ms in made["timings_ms"].items())
    headers = {"Server-Timing": times}
    headers |= warning_headers(made["warnings"])
    if media_type == "application/json":
        facts = {name: made[name] for name in ("objects", "cost", "views", "timings_ms", "warnings")}
        return Response(json.dumps(facts), media_type=media_type, headers=headers)
    return Response(made["file"], media_type=media_type, headers=headers)


def _picks(words: list[str]) -> dict[str, tuple[float, ...]]:
    """Regions by object."""
    out = {}
    for word in words:
        found = _PICK.fullmatch(word)
        if found is None:
            raise ServiceError(422, "invalid-value", "pick must look like table=120,80,200,140")
        out[found[1]] = tuple(float(v) for v in found.groups()[1:])
    return out
