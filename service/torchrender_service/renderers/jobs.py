"""What the service asks its renderers to do. Plain records: the process that serves never loads the renderer itself."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from torchrender.wire.messages import Bits, CameraHeader, ColorCodec
from torchrender.wire.viewing import Effect, ToneMap

QUALITY_MOVING = 90
QUALITY_STILL = 95  # where the client cannot read WebP
LOSSLESS = 100  # with WebP
BITS_STILL: Bits = 16

Buffer = Literal[
    "radiance",
    "depth",
    "triangle",
    "object_id",
    "material",
    "barycentric",
    "position",
    "normal",
    "geometric_normal",
    "uv",
    "color",
]
"""Arrays of an NPZ file; the cameras come with them."""


class SceneSource(msgspec.Struct, frozen=True, kw_only=True):
    """Where a renderer finds a scene: a file, or None for the built-in scene of that name."""

    id: str
    path: str | None = None


class View(msgspec.Struct, frozen=True, kw_only=True):
    """A camera in one of three forms, and the size of its picture."""

    width: int
    height: int
    name: str | None = None  # of one of the scene's cameras; None with all others None: its first
    pose: CameraHeader | None = None
    look_at: dict[str, Any] | None = None  # eye, target, up, fov_deg, near


class Bounds(msgspec.Struct, frozen=True, kw_only=True):
    """What a picture may cost, or how far it may be off."""

    budget_ms: float | None = None
    max_error: float | None = None


class Describe(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Facts about a scene."""

    scene: SceneSource


class Locate(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The camera that a view means, as messages carry it."""

    scene: SceneSource
    view: View


class Validate(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Facts about a file that was uploaded, after checks of what it declares."""

    path: str
    kind: str  # "glb", "toml" or "zip": unpacked beside it
    max_triangles: int
    max_texture_pixels: int
    max_bytes: int = 2**30  # that an archive may unpack to


class Render(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A picture as a file."""

    scene: SceneSource
    view: View
    bounds: Bounds
    options: dict[str, Any]
    format: str  # "png", "exr" or "npz"
    buffers: tuple[Buffer, ...] = ()  # of an NPZ file; none named: all
    time: float | None = None  # seconds into the scene's animation; None: as the file stands


class Plan(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """What a picture would need."""

    scene: SceneSource
    view: View
    bounds: Bounds
    time: float | None = None


class Tradeoff(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Time against error of one pass."""

    name: str


class DepthImages(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Depth images of a scene as a container of keyframe messages."""

    scene: SceneSource
    views: tuple[View, ...]
    method: str
    bits: Bits
    color: ColorCodec
    quality: int
    around: int = 1  # viewpoints around the only view
    spread: float = 0.2
    options: dict[str, Any] = {}
    time: float | None = None


class Reproject(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A picture from a container of keyframes."""

    container: bytes
    view: View
    method: str
    format: str  # "png" or "npz"
    max_pixels: int
    max_images: int


class CheckKeyframes(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Whether a container of keyframes is whole."""

    container: bytes
    max_pixels: int
    max_images: int


class StylePhoto(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """A scene with materials in the colours of a photo."""

    scene: SceneSource
    photo: bytes
    format: str  # "glb", "png" or "json"
    max_pixels: int  # of the photo
    seed: int = 0
    views: int = 10
    by: str = "object"
    prior: float = 1.0
    keep_textures: bool = False
    lock: tuple[str, ...] = ()
    pick: dict[str, tuple[float, ...]] = {}


class FogInPhoto(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Fog in a photo with its marks; no scene."""

    photo: bytes
    marks: bytes  # JSON
    format: str  # "png" or "json"
    max_pixels: int  # of the photo
    visibility: float | None = None
    scattering: float | None = None
    absorption: float = 0.0
    asymmetry: float = 0.0
    transmittance: str = "ratio"
    loss: str = "absorbed"
    top: float = 100.0
    light_gain: float = 1.0
    shaft_gain: float = 1.0
    show: str = "composite"
    side: int | None = None  # pixels that the longer side has at most; None: as many as the photo


class DescribePhoto(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Size of a photo, upright."""

    photo: bytes
    max_pixels: int


class StrokeLine(msgspec.Struct, frozen=True, kw_only=True):
    """A stroke over a part of a photo."""

    part: int
    points: tuple[tuple[float, float], ...]
    width: float = 9.0


class DividePhoto(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Regions of a photo by a few strokes."""

    photo: bytes
    max_pixels: int
    strokes: tuple[StrokeLine, ...]
    labels: tuple[str, ...]  # of each part
    depths: tuple[float | None, ...]  # metres, of each part


class CheckMarks(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Marks of a file, checked, as a table and as TOML."""

    marks: bytes
    name: str  # its suffix tells the kind


class MakeKeyframe(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Layer 0 of one keyframe of a stream."""

    session: str
    scene: SceneSource
    id: int
    pose: int
    time_ms: float
    camera: CameraHeader
    still: bool
    preview: bool = False  # the scene has changed: as soon as can be, no light of it is kept
    margin: tuple[int, int] = (0, 0)  # pixels of the camera beyond the view, on the left and above as on the other side
    extra_layers: int  # made by :class:`MakeLayers` afterwards
    direction: tuple[float, ...]  # the camera is expected to go there, world axes; zero: anywhere
    baseline: float  # distance of the extra cameras; 0: from the depth of what is seen
    color: ColorCodec
    quality: int
    bounds: Bounds
    mirrors: bool = False  # send what mirrors show as a layer of its own
    density: float = 1.0  # of all media, as a multiple of their own
    asymmetry: float | None = None  # of all media; None: each its own
    scene_s: float | None = None  # since the scene's animation was started; None: it never was
    settings: int = 0  # seq of the message that asked for all this
    exposure: float | Literal["auto", "as_lit"] = "as_lit"  # EV
    tone_map: ToneMap = "none"
    off: tuple[Effect, ...] = ()  # effects to leave out


class MakeLayers(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """The extra layers of the keyframe that was made last for a session: so layer 0 need not wait for them."""

    session: str
    id: int


class SmoothKeyframe(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """One more picture of the refinement that was made last for a session, a part of a pixel aside; with the last of
    them comes their mean, as layer 0 of the keyframe ``id``."""

    session: str
    id: int


class Survey(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """What a viewer needs to move about in a scene: its cameras, and where there is something in the way."""

    scene: SceneSource


class FindPixel(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """What the pixel of a camera shows, as a PICKED message has it."""

    scene: SceneSource
    camera: CameraHeader
    x: float  # pixels
    y: float
    scene_s: float | None = None


class Forget(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Drop what is kept for a session or a scene."""

    session: str | None = None
    scene: str | None = None


class WarmUp(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Load what pictures need, so that the first one takes no longer than the others.

    Args:
        views: those that move, those at rest, and those that move out of these.
    """

    views: tuple[Literal["moving", "still", "carried"], ...] = ("moving", "still", "carried")


SceneJob = Describe | Locate | Render | Plan | DepthImages | StylePhoto | MakeKeyframe | Survey | FindPixel
PhotoJob = FogInPhoto | DescribePhoto | DividePhoto | CheckMarks
ContainerJob = Reproject | CheckKeyframes
Job = SceneJob | PhotoJob | ContainerJob | Validate | Tradeoff | MakeLayers | SmoothKeyframe | Forget | WarmUp
