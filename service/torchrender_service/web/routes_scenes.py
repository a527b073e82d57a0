"""Scenes: list, upload, look at, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from torchrender_service.errors import ServiceError
from torchrender_service.web.schemas import SceneFacts, SceneList, problems
from torchrender_service.web.state import state_of

router = APIRouter(prefix="/v1/scenes", tags=["scenes"])

MEDIA_TYPES = {
    "model/gltf-binary": "glb",
    "application/octet-stream": "glb",
    "application/toml": "toml",
    "text/x-toml": "toml",
}
SceneParameter = Annotated[str, Path(pattern=r"^[a-z0-9_]{1,64}$", examples=["cornell_box"])]
_THERE: dict[int | str, dict[str, Any]] = {
    200: {"description": "The same scene is there already.", "model": SceneFacts}
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_TOML = {
    "schema": {"type": "string"},
    "example": 'name = "box"\n\n[[geometry]]\nshape = "box"\nsize = 1.0\n',
}


@router.get("", response_model=SceneList, responses=problems(503))
async def list_scenes(request: Request) -> dict[str, Any]:
    """All scenes: the built-in ones, then the uploaded ones."""
    scenes = state_of(request).scenes
    return {"scenes": [await scenes.facts(name) for name in scenes.names]}


@router.post(
    "",
    status_code=201,
    response_model=SceneFacts,
    responses=_THERE | problems(400, 403, 409, 413, 415, 422, 429, 503),
    openapi_extra={
        "requestBody": {"required": True, "content": {"model/gltf-binary": _BINARY, "application/toml": _TOML}}
    },
)
async def upload_scene(
    request: Request,
    response: Response,
    name: Annotated[str | None, Query(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")] = None,
) -> dict[str, Any]:
    """Keep a scene: a GLB file with everything inside, or a scene file in TOML without other files.

    The id of a scene is the hash of its content: the same scene sent twice is kept once.
    """
    kind = MEDIA_TYPES.get(request.headers.get("content-type", "").partition(";")[0].strip().lower())
    if kind is None:
        raise ServiceError(415, "media-type", f"Content-Type must be one of {', '.join(MEDIA_TYPES)}")
    facts, new = await state_of(request).scenes.keep(_body(request), kind, name)
    if not new:
        response.status_code = 200
    response.headers["Location"] = f"/v1/scenes/{facts['id']}"
    return facts


async def _body(request: Request) -> AsyncIterator[bytes]:
    async for chunk in request.stream():
        yield chunk


@router.get("/{scene}", response_model=SceneFacts, responses=problems(404, 422, 503))
async def get_scene(request: Request, scene: SceneParameter) -> dict[str, Any]:
    """What is known about one scene."""
    return await state_of(request).scenes.facts(scene)


@router.delete("/{scene}", status_code=204, responses=problems(403, 404, 422))
async def delete_scene(request: Request, scene: SceneParameter) -> Response:
    """Delete an uploaded scene. Streams that show it end."""
    state = state_of(request)
    await state.scenes.delete(scene)
    state.scene_deleted(scene)
    return Response(status_code=204)
