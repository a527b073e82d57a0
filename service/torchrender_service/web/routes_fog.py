"""Fog, smoke and shafts of light in a photo."""

from __future__ import annotations

import asyncio
import base64
import binascii
import json
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problems
from torchrender_service.renderers.contract import RendererHandle
from torchrender_service.renderers.jobs import FogInPhoto
from torchrender_service.web.negotiation import negotiate, warning_headers
from torchrender_service.web.routes_photos import PhotoId
from torchrender_service.web.state import ServiceState, state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["fog"], route_class=StrictRoute)

RESULTS = {"image/png": "png", "image/jpeg": "jpeg", "application/json": "json"}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_HEADERS = {
    "Server-Timing": {"description": "milliseconds of each stage", "schema": {"type": "string"}},
    "Torchrender-Warnings": {"description": "what is not used as it is, JSON", "schema": {"type": "string"}},
}
_DONE: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "As Accept asks: the picture (PNG, or JPEG for a quick look), or what was found out about the"
        " photo (JSON).",
        "content": {"image/png": _BINARY, "image/jpeg": _BINARY, "application/json": {}},
        "headers": _HEADERS,
    }
}
Coefficient = Annotated[float, Field(ge=0.0, le=20.0, allow_inf_nan=False)]
Gain = Annotated[float, Field(ge=0.1, le=10.0, allow_inf_nan=False)]


class FogRequest(BaseModel):
    """A photo with its marks, and what to put into it."""

    model_config = ConfigDict(extra="forbid")

    photo: Annotated[str | None, Field(description="PNG or JPEG, base64")] = None
    photo_id: Annotated[PhotoId | None, Field(description="of a photo that was sent to /v1/photos, in its place")] = (
        None
    )
    marks: Annotated[dict[str, Any], Field(description="as in a file of marks")]
    visibility: Annotated[float | None, Field(ge=0.2, le=1e6, allow_inf_nan=False, description="metres")] = None
    scattering: Annotated[Coefficient | None, Field(description="1/m, where no visibility is given")] = None
    absorption: Coefficient = 0.0
    asymmetry: Annotated[float, Field(ge=-0.9, le=0.9, allow_inf_nan=False)] = 0.0
    transmittance: Literal["ratio", "patches", "centroid"] = "ratio"
    loss: Literal["absorbed", "single", "none"] = "absorbed"
    top: Annotated[float, Field(ge=2.0, le=2000.0, allow_inf_nan=False, description="metres")] = 100.0
    light_gain: Gain = 1.0
    shaft_gain: Gain = 1.0
    show: Literal["composite", "transmittance", "scattered"] = "composite"
    side: Annotated[
        int | None, Field(ge=16, le=16384, description="pixels of the longer side at most; none: as the photo")
    ] = None

    @model_validator(mode="after")
    def _one_photo(self) -> FogRequest:
        if (self.photo is None) == (self.photo_id is None):
            raise ValueError("fog needs either photo or photo_id")
        return self


@router.post(
    "/fog", response_class=Response, responses=_DONE | problems(400, 403, 404, 406, 413, 415, 422, 429, 503)
)  # fmt: skip
async def fog(request: Request, body: FogRequest) -> Response:
    """Put fog into a photo. Another medium for the photo that was sent last takes little time."""
    media_type = negotiate(request.headers.get("accept"), list(RESULTS))
    state = state_of(request)
    photo, renderer = await _photo(state, body)
    settings = body.model_dump(exclude={"photo", "photo_id", "marks"})
    job = FogInPhoto(photo=photo, marks=json.dumps(body.marks).encode(), format=RESULTS[media_type],
                     max_pixels=state.settings.max_texture_pixels, **settings)  # fmt: skip
    made = await work(request, job, renderer=renderer)
    headers = {"Server-Timing": ", ".join(f"{stage};dur={ms:.2f}" for stage, ms in made["timings_ms"].items())}
    headers |= warning_headers(made["warnings"])
    if media_type == "application/json":
        return Response(json.dumps({k: made[k] for k in ("facts", "timings_ms", "warnings")}), media_type=media_type,
                        headers=headers)  # fmt: skip
    return Response(made["file"], media_type=media_type, headers=headers)


async def _photo(state: ServiceState, body: FogRequest) -> tuple[bytes, RendererHandle | None]:
    """The photo, and the renderer that has it ready."""
    if body.photo_id is not None:
        kept = await state.photos.get(body.photo_id)
        return kept.data, kept.renderer
    try:
        return await asyncio.to_thread(base64.b64decode, body.photo or "", validate=True), None
    except (binascii.Error, ValueError) as error:
        raise ServiceError(422, "invalid-value", "photo must be base64") from error
