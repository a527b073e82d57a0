"""Pictures, depth images, reprojections, plans and curves."""

from __future__ import annotations

import asyncio
import base64
import binascii
import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from torchrender.wire.messages import CONTENT_TYPE
from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problems
from torchrender_service.renderers.jobs import (
    Bounds,
    CheckKeyframes,
    DepthImages,
    Plan,
    Render,
    Reproject,
    Tradeoff,
    View,
)
from torchrender_service.web.kept import count_keyframes, id_of
from torchrender_service.web.negotiation import negotiate, warning_headers
from torchrender_service.web.schemas import (
    Budget,
    DepthImagesRequest,
    KeptKeyframes,
    MaxError,
    RenderRequest,
    ReprojectRequest,
    SceneId,
    Side,
    Time,
    bounds_of,
    view_of,
)
from torchrender_service.web.state import ServiceState, state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1", tags=["pictures"], route_class=StrictRoute)

PICTURES = {"image/png": "png", "image/x-exr": "exr", "application/x-npz": "npz"}
REPROJECTIONS = {"image/png": "png", "application/x-npz": "npz"}
MAX_PLAN_BYTES = 6000  # many clients and proxies take 8 KB of headers
_WARNINGS = "what was hardly meant so, a JSON list; left out where there is nothing"
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_KEPT: dict[int | str, dict[str, Any]] = {200: {"description": "They are kept already.", "model": KeptKeyframes}}


def _file(description: str, types: Sequence[str], **headers: str) -> dict[str, Any]:
    """How a route that answers with a file is described."""
    described = {name: {"description": text, "schema": {"type": "string"}} for name, text in headers.items()}
    made = {"description": description, "content": dict.fromkeys(types, _BINARY), "headers": described}
    codes = (400, 403, 404, 413, 422, 429, 503) if len(types) == 1 else (400, 403, 404, 406, 413, 422, 429, 503)
    return {"response_class": Response, "responses": {200: made} | problems(*codes)}


@router.post(
    "/render",
    **_file(
        "The picture, as Accept asks: PNG (sRGB), EXR (radiance, depth, normals, ids) or NPZ (every buffer).",
        [*PICTURES],
        **{
            "Torchrender-Plan": "what ran and why, JSON",
            "Server-Timing": "milliseconds of each pass",
            "Torchrender-Warnings": _WARNINGS,
        },
    ),
)
async def render(request: Request, body: RenderRequest) -> Response:
    """Render a picture."""
    state, media_type = state_of(request), _media_type(request, PICTURES)
    job = Render(
        view=_view(state, body, body.options.supersample),
        scene=await state.scenes.find(body.scene),
        bounds=bounds_of(body.budget_ms, body.max_error),
        options=body.options.model_dump(),
        format=PICTURES[media_type],
        buffers=tuple(body.buffers),
        time=body.time,
    )
    made = await work(request, job)
    headers = {"Torchrender-Plan": _plan_header(made["plan"]), "Server-Timing": _timing(made["timings_ms"])}
    headers |= warning_headers(made["warnings"])
    return Response(made["file"], media_type=media_type, headers=headers)


@router.post(
    "/depth-images",
    **_file(
        "Keyframe messages one after the other, see PROTOCOL.md.",
        [CONTENT_TYPE],
        **{"Torchrender-Keyframes": "id for POST /v1/reproject", "Torchrender-Warnings": _WARNINGS},
    ),
)
async def depth_images(request: Request, body: DepthImagesRequest) -> Response:
    """Sample depth images with colours."""
    state = state_of(request)
    views = [view_of(camera, body.width, body.height) for camera in body.cameras]
    views = views or [view_of(None, body.width, body.height)]
    count = max(len(views), body.around)
    if count > state.settings.max_views:
        raise ServiceError(422, "too-many-views", f"at most {state.settings.max_views} views, got {count}")
    if len(views) > 1 and body.around > 1:
        raise ServiceError(422, "invalid-value", "around needs a single camera")
    for view in views:
        _check_pixels(state, view, count=count)
    job = DepthImages(
        scene=await state.scenes.find(body.scene),
        views=tuple(views),
        method=body.method,
        bits=body.bits,
        color=body.color,
        quality=body.quality,
        around=body.around,
        spread=body.spread,
        options=body.options.model_dump(),
        time=body.time,
    )
    made = await work(request, job)
    name = await asyncio.to_thread(id_of, made["container"])
    await state.kept.put(made["container"], name)
    headers = {"Torchrender-Keyframes": name} | warning_headers(made["warnings"])
    return Response(made["container"], media_type=CONTENT_TYPE, headers=headers)


@router.post(
    "/keyframes",
    status_code=201,
    response_model=KeptKeyframes,
    responses=_KEPT | problems(400, 403, 413, 415, 422, 429, 503),
    openapi_extra={"requestBody": {"required": True, "content": {CONTENT_TYPE: _BINARY}}},
)
async def keep_keyframes(request: Request, response: Response) -> dict[str, Any]:
    """Keep depth images for POST /v1/reproject: keyframe messages one after the other, as they are. Damaged ones are
    refused; the oldest make room for newer ones."""
    if request.headers.get("content-type", "").partition(";")[0].strip().lower() != CONTENT_TYPE:
        raise ServiceError(415, "media-type", f"Content-Type must be {CONTENT_TYPE}")
    state = state_of(request)
    async with state.bodies.read(request) as container:
        limits = {"max_pixels": state.settings.max_pixels // 4, "max_images": state.settings.max_views}
        images = await asyncio.to_thread(count_keyframes, container, **limits)
        name = await asyncio.to_thread(id_of, container)
        there = await state.kept.has(name)
        if not there:
            await work(request, CheckKeyframes(container=container, **limits))
        await state.kept.put(container, name)
    if there:
        response.status_code = 200
    return {"id": name, "images": images}


@router.post(
    "/reproject",
    **_file(
        "PNG whose alpha is the validity mask, or NPZ with color, depth, valid and source.",
        [*REPROJECTIONS],
        **{"Torchrender-Valid-Share": "share of pixels that a sample reaches"},
    ),
)
async def reproject(request: Request, body: ReprojectRequest) -> Response:
    """The view of a new camera out of depth images alone."""
    state, media_type = state_of(request), _media_type(request, REPROJECTIONS)
    job = Reproject(
        view=_view(state, body),
        container=await _container(state, body),
        method=body.method,
        format=REPROJECTIONS[media_type],
        max_pixels=state.settings.max_pixels // 4,
        max_images=state.settings.max_views,
    )
    made = await work(request, job)
    headers = {"Torchrender-Valid-Share": f"{made['valid_share']:.6f}"}
    return Response(made["file"], media_type=media_type, headers=headers)


@router.get("/plan", responses=problems(404, 422, 429, 503))
async def plan(
    request: Request,
    scene: Annotated[SceneId, Query(examples=["cornell_box"])],
    camera: Annotated[str | None, Query(min_length=1, max_length=200)] = None,
    width: Annotated[Side, Query()] = 640,
    height: Annotated[Side, Query()] = 360,
    budget_ms: Annotated[Budget | None, Query()] = None,
    max_error: Annotated[MaxError | None, Query()] = None,
    time: Annotated[Time | None, Query()] = None,
) -> dict[str, Any]:
    """What would run for a picture, and why."""
    state = state_of(request)
    view = View(width=width, height=height, name=camera)
    _check_pixels(state, view)
    bounds = Bounds(budget_ms=budget_ms, max_error=max_error)
    job = Plan(scene=await state.scenes.find(scene), view=view, bounds=bounds, time=time)
    return await work(request, job)


@router.get("/tradeoff/{name}", responses=problems(404, 422, 429, 503))
async def tradeoff(
    request: Request, name: Annotated[str, Path(pattern=r"^[a-z_]{1,40}$", examples=["soft_shadow"])]
) -> dict[str, Any]:
    """Time against error of the settings of one pass."""
    return await work(request, Tradeoff(name=name))


def _media_type(request: Request, formats: Mapping[str, str]) -> str:
    """What Accept asks for."""
    return negotiate(request.headers.get("accept"), list(formats))


def _view(state: ServiceState, body: RenderRequest | ReprojectRequest, supersample: float = 1.0) -> View:
    """The view of a request, which may be so large."""
    view = view_of(body.camera, body.width, body.height)
    _check_pixels(state, view, supersample)
    return view


async def _container(state: ServiceState, body: ReprojectRequest) -> bytes:
    """The depth images of a request: kept ones, or those that came along."""
    if body.keyframes is not None:
        return await state.kept.get(body.keyframes)
    try:
        return await asyncio.to_thread(base64.b64decode, body.container or "", validate=True)
    except (binascii.Error, ValueError) as error:
        raise ServiceError(422, "invalid-value", "container must be base64") from error


def _check_pixels(state: ServiceState, view: View, supersample: float = 1.0, count: int = 1) -> None:
    limit = state.settings.max_pixels
    pixels = view.width * view.height * max(1.0, supersample) ** 2 * count
    if pixels > limit:
        detail = f"width x height, all samples and views counted, must be at most {limit}, got {pixels:.0f}"
        raise ServiceError(422, "too-many-pixels", detail)


def _plan_header(plan: dict[str, Any]) -> str:
    """The plan as one line of ASCII; without reasons where it would be too long."""
    text = json.dumps(plan, separators=(",", ":"))
    if len(text) > MAX_PLAN_BYTES:
        rows = [{k: v for k, v in row.items() if k != "reason"} for row in plan["rows"]]
        text = json.dumps(plan | {"rows": rows}, separators=(",", ":"))
    return text[:MAX_PLAN_BYTES]


def _timing(timings_ms: dict[str, float]) -> str:
    return ", ".join(f"{name};dur={ms:.2f}" for name, ms in timings_ms.items())
