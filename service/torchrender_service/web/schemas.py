"""Bodies of requests and responses; the OpenAPI description is made from them."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from torchrender.wire.messages import MAX_LAYERS, CameraHeader
from torchrender_service.renderers.jobs import Bounds, Buffer, View

Number = Annotated[float, Field(ge=-1e15, le=1e15, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, le=1e15, allow_inf_nan=False)]
Side = Annotated[int, Field(ge=1, le=16384, description="pixels")]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
SceneId = Annotated[str, Field(pattern=r"^[a-z0-9_]{1,64}$", description="of a built-in or an uploaded scene")]
Budget = Annotated[
    float, Field(ge=1.0, le=1e5, allow_inf_nan=False, description="milliseconds that the picture may take")
]
MaxError = Annotated[
    float, Field(ge=0.0, le=1.0, allow_inf_nan=False, description="mean FLIP that the picture may be off")
]
Time = Annotated[
    float,
    Field(
        ge=0.0,
        le=1e6,
        allow_inf_nan=False,
        description="seconds into the scene's animation, which it must have; default: "
        "as its file stands. After its end it stands still",
    ),
]

Light = Annotated[float, Field(ge=0.0, le=1e6, allow_inf_nan=False)]

IDENTITY = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]


class Strict(BaseModel):
    """No unknown fields, no silent conversions."""

    model_config = ConfigDict(extra="forbid", strict=True)


class NamedCamera(Strict):
    """One of the scene's cameras."""

    name: Annotated[str, Field(min_length=1, max_length=200)]


class LookAt(Strict):
    """A camera by where it stands and what it looks at."""

    eye: Vector
    target: Vector | None = Field(None, description="default: the scene's centre")
    up: Vector = [0.0, 1.0, 0.0]
    fov_deg: Annotated[float, Field(gt=0.0, lt=179.0, allow_inf_nan=False)] = 50.0
    near: Positive | None = Field(None, description="default: 1/10000 of the scene's diagonal")


class PinholeCamera(Strict):
    """A pinhole camera: x right, y down, z forward; pixel centres at halves."""

    world_from_camera: Annotated[
        list[Number], Field(min_length=16, max_length=16, description="rigid, row by row", examples=[IDENTITY])
    ]
    fx: Positive
    fy: Positive
    cx: Number
    cy: Number
    width: Side
    height: Side
    near: Positive

    def header(self) -> CameraHeader:
        """As messages carry it."""
        return CameraHeader(**{**self.model_dump(), "world_from_camera": tuple(self.world_from_camera)})

    @classmethod
    def of(cls, header: CameraHeader) -> PinholeCamera:
        """From a message."""
        names = ("fx", "fy", "cx", "cy", "width", "height", "near")
        matrix = list(header.world_from_camera)
        return cls(world_from_camera=matrix, **{name: getattr(header, name) for name in names})


def _camera_form(value: Any) -> str | None:
    """Which of its forms a camera has, so that errors are about that one alone; None: it is no camera."""
    if isinstance(value, NamedCamera | LookAt | PinholeCamera):
        return type(value).__name__
    if not isinstance(value, dict):
        return None
    if "name" in value:
        return NamedCamera.__name__
    poses = {"world_from_camera", "fx", "fy", "cx", "cy"} & value.keys()
    return PinholeCamera.__name__ if poses else LookAt.__name__


def _by_form(told: str) -> Discriminator:
    return Discriminator(_camera_form, custom_error_type="camera", custom_error_message=f"Input should be {told}")


_PLACED = "an object with eye (and target, up, fov_deg), or with world_from_camera and fx, fy, cx, cy"
_Named = Annotated[NamedCamera, Tag("NamedCamera")]
_Look = Annotated[LookAt, Tag("LookAt")]
_Pinhole = Annotated[PinholeCamera, Tag("PinholeCamera")]
Camera = Annotated[_Named | _Look | _Pinhole, _by_form(f"an object with the name of a camera, {_PLACED}")]
PlacedCamera = Annotated[_Look | _Pinhole, _by_form(_PLACED)]


class LoadReport(BaseModel):
    """What was read of a file, what was repaired, and what is not used, with counts."""

    read: list[str] = []
    repaired: list[str] = []
    not_used: list[str] = []


class SceneFacts(BaseModel):
    """A scene."""

    id: str
    name: str
    built_in: bool
    kind: Literal["procedural", "glb", "toml", "zip", "live"]
    bytes: int
    triangles: int
    lights: int
    cameras: list[str]
    bounds: list[list[float]]
    diagonal: float
    animations: dict[str, float] = Field(default={}, description="durations in seconds, by name")
    controls: Literal["walk", "orbit"] = Field(default="walk", description="how to move about in it")
    report: LoadReport = Field(default=LoadReport(), description="what the file was read as")


class Obstacles(BaseModel):
    """Cubic cells of a grid that a surface meets."""

    origin: list[float] = Field(description="lowest corner, scene units")
    cell: float = Field(description="edge of a cell, scene units")
    dims: list[int] = Field(description="cells along x, y and z")
    bits: str = Field(description="base64; x fastest, then y, then z, the first cell in the lowest bit; 1: a surface")


class SceneSurvey(BaseModel):
    """How to move about in a scene."""

    cameras: dict[str, PinholeCamera]
    obstacles: Obstacles


class SceneList(BaseModel):
    """Scenes, so many at a time."""

    scenes: list[SceneFacts]
    next: str | None = Field(None, description="relative address of the next ones; null: these were the last")


class KeptKeyframes(BaseModel):
    """Depth images that are kept."""

    id: str
    images: int


class Enhance(Strict):
    """Shape made easier to read; see EnhanceOptions of the Python API."""

    plain_weight: Annotated[float, Field(ge=0.0, le=1.5, allow_inf_nan=False)] = 0.8
    gradient_weight: Annotated[float, Field(ge=-1.0, le=2.0, allow_inf_nan=False)] = 0.4
    exponent: Annotated[float, Field(ge=0.1, le=5.0, allow_inf_nan=False)] = 1.0
    limit: Annotated[float, Field(ge=0.0, le=1e12, allow_inf_nan=False)] | None = None
    magnitude: Literal["signed_l2", "sum", "l1", "l2"] = "signed_l2"
    source: Literal["auto", "mesh", "picture"] = "auto"
    overshoot_limit: Annotated[float, Field(ge=0.0, le=1.0, allow_inf_nan=False)] | None = None
    range_limit: Annotated[float, Field(ge=0.0, le=100.0, allow_inf_nan=False)] | None = None


class RenderSettings(Strict):
    """Settings of a picture that a budget or error bound may change."""

    shadows: Annotated[
        bool | Literal["off", "hard", "maps", "sampled", "traced"],
        Field(description="true: maps, with guessed penumbrae; false: off"),
    ] = True
    shadow_size: Annotated[int, Field(ge=64, le=4096, description="texels of a shadow map's side")] | None = None
    cascades: Annotated[int, Field(ge=1, le=8, description="shadow maps along the view; none: as needed")] | None = None
    reflections: Literal["auto", "clustered", "traced", "environment", "off"] = "auto"
    supersample: Annotated[float, Field(ge=0.25, le=2.0, allow_inf_nan=False)] = 1.0
    background: Annotated[list[Light], Field(min_length=3, max_length=3)] | None = None
    exposure: Annotated[
        Annotated[float, Field(ge=-64.0, le=64.0, allow_inf_nan=False)] | Literal["auto", "as_lit"] | None,
        Field(description="EV; auto or none: automatic; as_lit: 0, and automatic where lights are photometric"),
    ] = "as_lit"
    tone_map: Literal["none", "reinhard", "aces"] = "none"
    enhance: Enhance | None = None


class RenderRequest(Strict):
    """A picture."""

    scene: SceneId
    camera: Camera | None = Field(None, description="default: the scene's first camera")
    width: Side = 640
    height: Side = 360
    options: RenderSettings = RenderSettings()
    budget_ms: Budget | None = None
    max_error: MaxError | None = None
    time: Time | None = None
    buffers: Annotated[list[Buffer], Field(max_length=16, description="of an NPZ file; none: all")] = []

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"scene": "cornell_box", "width": 160, "height": 120}]},
    )


class DepthImagesRequest(Strict):
    """Depth images of a scene: of several cameras, or of viewpoints around one."""

    scene: SceneId
    cameras: Annotated[list[Camera], Field(max_length=64, description="none: the scene's first camera")] = []
    around: Annotated[int, Field(ge=1, le=64, description="viewpoints around the only camera")] = 1
    spread: Annotated[
        float, Field(ge=0.0, le=2.0, allow_inf_nan=False, description="their distance, scene diagonals")
    ] = 0.1
    width: Side = 640
    height: Side = 360
    method: Literal["nonredundant", "conventional", "depth_peeling"] = "nonredundant"
    bits: Literal[12, 14, 16] = 16
    color: Literal["jpeg", "webp"] = "webp"
    quality: Annotated[int, Field(ge=1, le=100, description="100 with webp: without loss")] = 100
    options: RenderSettings = RenderSettings()
    time: Time | None = None

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"scene": "cornell_box", "around": 3, "width": 160, "height": 120}]},
    )


class ReprojectRequest(Strict):
    """A picture from depth images made before, or sent along."""

    keyframes: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$", description="id of a container")] | None = None
    container: Annotated[str, Field(min_length=4, description="a container as base64")] | None = None
    camera: PlacedCamera
    width: Side = 640
    height: Side = 360
    method: Literal["hybrid", "grid", "splat"] = "hybrid"

    @model_validator(mode="after")
    def one_source(self) -> ReprojectRequest:
        """Exactly one of both, and a target to look at."""
        if (self.keyframes is None) == (self.container is None):
            raise ValueError("give either keyframes or container")
        if isinstance(self.camera, LookAt) and self.camera.target is None:
            raise ValueError("camera.target is needed: a container has no centre")
        return self


class SessionRequest(Strict):
    """What a stream should show."""

    scene: SceneId
    width: Side = 640
    height: Side = 360
    camera: Camera | None = Field(None, description="where to start; default: the scene's first camera")
    layers: Annotated[int, Field(ge=0, le=MAX_LAYERS, description="extra layers of each keyframe")] = 1
    overscan: Annotated[float, Field(ge=1.0, le=1.5, allow_inf_nan=False)] = 1.2
    budget_ms: Budget | None = None
    max_error: MaxError | None = None

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"scene": "cornell_box", "width": 320, "height": 180, "layers": 1}]},
    )


class SessionMade(BaseModel):
    """A session and the ticket that opens its stream once."""

    session: str
    ticket: str
    expires_s: float
    stream: str
    camera: PinholeCamera
    scene_diagonal: float
    up: list[float]


def view_of(camera: Camera | None, width: int, height: int) -> View:
    """The camera of a request as renderers take it. A pinhole camera brings its own size."""
    if isinstance(camera, PinholeCamera):
        return View(width=camera.width, height=camera.height, pose=camera.header())
    if isinstance(camera, LookAt):
        return View(width=width, height=height, look_at=camera.model_dump())
    return View(width=width, height=height, name=None if camera is None else camera.name)


def bounds_of(budget_ms: float | None, max_error: float | None) -> Bounds:
    """What a picture may cost or be off."""
    return Bounds(budget_ms=budget_ms, max_error=max_error)
