"""Scenes: list, upload, look at, delete."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from torchrender_service.door.strict import StrictRoute
from torchrender_service.errors import ServiceError
from torchrender_service.problems import problems
from torchrender_service.renderers.jobs import Survey
from torchrender_service.web.schemas import SceneFacts, SceneId, SceneList, SceneSurvey
from torchrender_service.web.state import state_of
from torchrender_service.web.work import work

router = APIRouter(prefix="/v1/scenes", tags=["scenes"], route_class=StrictRoute)

MEDIA_TYPES = {
    "model/gltf-binary": "glb",
    "application/octet-stream": "glb",
    "application/toml": "toml",
    "text/x-toml": "toml",
    "application/zip": "zip",
    "application/x-zip-compressed": "zip",
}
MAX_LISTED = 256
SceneParameter = Annotated[str, Path(pattern=r"^[a-z0-9_]{1,64}$", examples=["cornell_box"])]
_THERE: dict[int | str, dict[str, Any]] = {
    200: {"description": "The same scene is there already.", "model": SceneFacts}
}
_BINARIES = ("model/gltf-binary", "application/zip")
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_TOML = {
    "schema": {"type": "string"},
    "example": 'name = "box"\n\n[[geometry]]\nshape = "box"\nsize = 1.0\n',
}


_SAME: dict[int | str, dict[str, Any]] = {304: {"description": "Nothing has changed since the ETag that came."}}


@router.get("", response_model=SceneList, responses=_SAME | problems(404, 422, 503))
async def list_scenes(
    request: Request,
    response: Response,
    limit: Annotated[int, Query(ge=1, le=MAX_LISTED, description="scenes at most")] = MAX_LISTED,
    after: Annotated[SceneId | None, Query(description="the last one that is known already")] = None,
) -> Any:
    """Scenes: the built-in ones, then the uploaded ones; ``next`` leads to more of them."""
    scenes = state_of(request).scenes
    await scenes.refresh()
    tag = f'"{scenes.version}-{limit}-{after or ""}"'
    if same_tag(request, tag):
        return Response(status_code=304, headers={"ETag": tag})
    names = scenes.names
    if after is not None and after not in names:
        raise ServiceError(404, "no-such-scene", f"there is no scene {after[:80]!r}")
    begin = 0 if after is None else names.index(after) + 1
    listed = names[begin : begin + limit]
    more = begin + limit < len(names)
    response.headers["ETag"] = tag
    response.headers["Cache-Control"] = "no-cache"  # to be asked for each time, but not sent again
    found = []
    for name in listed:
        try:
            found.append(await scenes.facts(name))
        except ServiceError as error:
            if error.status != 404:  # deleted meanwhile
                raise
    return {"scenes": found, "next": f"v1/scenes?limit={limit}&after={listed[-1]}" if more else None}


def same_tag(request: Request, tag: str) -> bool:
    """Whether the client has what the tag stands for (RFC 9110, section 13.1.2)."""
    known = [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]
    return tag in known or "*" in known


@router.post(
    "",
    status_code=201,
    response_model=SceneFacts,
    responses=_THERE | problems(400, 403, 409, 413, 415, 422, 429, 503, 507),
    openapi_extra={
        "requestBody": {"required": True, "content": dict.fromkeys(_BINARIES, _BINARY) | {"application/toml": _TOML}}
    },
)
async def upload_scene(
    request: Request,
    response: Response,
    name: Annotated[str | None, Query(min_length=1, max_length=80, pattern=r"^[^\x00-\x1f\x7f]*$")] = None,
) -> dict[str, Any]:
    """Keep a scene: a GLB file with everything inside, a scene file in TOML without other files, or a ZIP archive.

    An archive holds one scene with the files that it names: glTF, OBJ with MTL, PLY (also points) or STL.

    The id of a scene is the hash of its content: the same scene sent twice is kept once.
    """
    kind = MEDIA_TYPES.get(request.headers.get("content-type", "").partition(";")[0].strip().lower())
    if kind is None:
        raise ServiceError(415, "media-type", f"Content-Type must be one of {', '.join(MEDIA_TYPES)}")
    facts, new = await state_of(request).scenes.keep(_body(request), kind, name)
    if not new:
        response.status_code = 200
    response.headers["Location"] = f"{state_of(request).settings.root_path}/v1/scenes/{facts['id']}"
    return facts


async def _body(request: Request) -> AsyncIterator[bytes]:
    async for chunk in request.stream():
        yield chunk


@router.get("/{scene}/survey", response_model=SceneSurvey, responses=_SAME | problems(404, 422, 503))
async def survey_scene(request: Request, response: Response, scene: SceneParameter) -> Any:
    """What a viewer needs to move about: the scene's cameras, and the cells of a grid that hold a surface."""
    state = state_of(request)
    tag = f'"{scene}-{state.scenes.revision(scene)}"'
    if same_tag(request, tag):
        return Response(status_code=304, headers={"ETag": tag})
    found = await work(request, Survey(scene=await state.scenes.find(scene)))
    response.headers["ETag"] = tag
    response.headers["Cache-Control"] = "no-cache"
    return found


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
