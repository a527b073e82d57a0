"""Photos to be marked: kept, divided by strokes; and marks, checked and written."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, ConfigDict, Field, model_validator

from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problems
from torchrender_service.renderers.jobs import CheckMarks, DescribePhoto, DividePhoto, StrokeLine
from torchrender_service.web.negotiation import negotiate
from torchrender_service.web.state import state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["photos"], route_class=StrictRoute)

PHOTOS = ("image/jpeg", "image/png")
MARKS = {"application/json": ".json", "application/toml": ".toml"}
MAX_STROKES = 256
MAX_POINTS = 4096
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_WRITTEN: dict[int | str, dict[str, Any]] = {
    200: {"description": "The marks, as Accept asks.", "content": {kind: {} for kind in MARKS}}
}
Pixel = Annotated[float, Field(ge=-1e5, le=1e5, allow_inf_nan=False)]
Place = Annotated[list[Pixel], Field(min_length=2, max_length=2)]
PhotoId = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$", description="of a photo that was sent")]


class PhotoFacts(BaseModel):
    """A photo that is kept."""

    id: str
    width: int
    height: int


class PartOfPhoto(BaseModel):
    """What strokes of one number are drawn on."""

    model_config = ConfigDict(extra="forbid")

    label: Literal["ground", "vertical", "sky"]
    depth: Annotated[
        float | None, Field(ge=0.1, le=1e5, allow_inf_nan=False, description="metres, of vertical ones")
    ] = None


class StrokeOnPhoto(BaseModel):
    """A line over a part."""

    model_config = ConfigDict(extra="forbid")

    part: Annotated[int, Field(ge=0, le=15, description="number of the part in the list")]
    points: Annotated[list[Place], Field(min_length=1, max_length=MAX_POINTS, description="x, y in pixels")]
    width: Annotated[float, Field(ge=1.0, le=1000.0, allow_inf_nan=False, description="pixels")] = 9.0


class DivideRequest(BaseModel):
    """Strokes on at least two parts of a photo."""

    model_config = ConfigDict(extra="forbid")

    parts: Annotated[list[PartOfPhoto], Field(min_length=2, max_length=16)]
    strokes: Annotated[list[StrokeOnPhoto], Field(min_length=2, max_length=MAX_STROKES)]

    @model_validator(mode="after")
    def _parts_exist(self) -> DivideRequest:
        if any(stroke.part >= len(self.parts) for stroke in self.strokes):
            raise ValueError("strokes must lie on parts that are listed")
        return self


class Regions(BaseModel):
    """Regions as they stand in a file of marks."""

    region: list[dict[str, Any]]


@router.post(
    "/photos",
    status_code=201,
    response_model=PhotoFacts,
    responses=problems(400, 403, 413, 415, 422, 429, 503),
    openapi_extra={"requestBody": {"required": True, "content": dict.fromkeys(PHOTOS, _BINARY)}},
)
async def keep(request: Request) -> PhotoFacts:
    """Keep the photo in the body for a while, so that fog and regions need not get it again."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in PHOTOS:
        raise ServiceError(415, "media-type", f"Content-Type must be one of {', '.join(PHOTOS)}")
    state = state_of(request)
    async with state.bodies.read(request) as data:
        photo = await state.photos.put(data)
    name = photo.name
    job = DescribePhoto(photo=photo.data, max_pixels=state.settings.max_texture_pixels)
    try:
        found = await work(request, job, renderer=photo.renderer)
    except ServiceError as error:
        if error.status == 422:  # it is none, and would only take room
            await state.photos.drop(name)
        raise
    return PhotoFacts(id=name, **found)


@router.post("/photos/{photo}/regions", response_model=Regions, responses=problems(400, 403, 404, 413, 422, 429, 503))
async def regions(request: Request, photo: PhotoId, body: DivideRequest) -> Regions:
    """Divide a photo by a few strokes on each part (GrabCut and watershed), into regions of a file of marks."""
    state = state_of(request)
    kept = await state.photos.get(photo)
    job = DividePhoto(
        photo=kept.data,
        max_pixels=state.settings.max_texture_pixels,
        strokes=tuple(
            StrokeLine(part=s.part, points=tuple((p[0], p[1]) for p in s.points), width=s.width) for s in body.strokes
        ),
        labels=tuple(p.label for p in body.parts),
        depths=tuple(p.depth for p in body.parts),
    )
    return Regions(**await work(request, job, renderer=kept.renderer))


@router.post(
    "/marks",
    response_class=Response,
    responses=_WRITTEN | problems(400, 403, 406, 413, 415, 422, 429, 503),
    openapi_extra={"requestBody": {"required": True, "content": dict.fromkeys(MARKS, _BINARY)}},
)
async def marks(request: Request) -> Response:
    """Check a file of marks, JSON or TOML, and give it back as either."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in MARKS:
        raise ServiceError(415, "media-type", f"Content-Type must be one of {', '.join(MARKS)}")
    media_type = negotiate(request.headers.get("accept"), list(MARKS))
    job = CheckMarks(marks=await request.body(), name=f"marks{MARKS[kind]}")
    made = await work(request, job)
    text = json.dumps(made["table"]) if media_type == "application/json" else made["toml"]
    return Response(text, media_type=media_type)
