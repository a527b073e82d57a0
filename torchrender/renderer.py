"""Scene and camera in, picture out: rasterise, find shadows, shade, add reflections where something mirrors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ShadowMap
from torchrender.checks import ArrayLike, as_vector, check_choice, check_range
from torchrender.clock import StepClock
from torchrender.effects.clustered_reflection import ClusterOptions, clustered_reflections
from torchrender.effects.reflection_reuse import reuse_reflections
from torchrender.effects.shadow_map import ShadowOptions, lights_visibility, render_shadow_map
from torchrender.effects.traced_reflection import TraceOptions, environment_reflections, trace_reflections
from torchrender.errors import InputError, OptionError
from torchrender.history import RenderHistory
from torchrender.hit_shader import HitShader
from torchrender.image import Image
from torchrender.numerics.tonemap import OPERATORS
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.reflection.reflectors import (
    ReflectivePixels,
    blend_reflections,
    mirrored_share,
    reflective_pixels,
)
from torchrender.reflection.reuse_options import ReuseOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene, resized
from torchrender.shade import shade

DEFAULT_SIZE = (1024, 768)
REFLECTIONS = ("clustered", "traced", "environment", "off")


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """How a picture is made.

    Raises:
        OptionError: a value outside its range; names it.
    """

    shadows: bool = True
    shadow: ShadowOptions = field(default_factory=ShadowOptions)
    reflections: str = "clustered"  # how reflectors mirror: "clustered", "traced", "environment" (one cube map), "off"
    reflection: ClusterOptions = field(default_factory=ClusterOptions)
    tracing: TraceOptions = field(default_factory=TraceOptions)
    reuse: ReuseOptions = field(default_factory=ReuseOptions)  # of reflections, in pictures with a history
    supersample: int = 1  # 2: two by two samples per pixel
    background: ArrayLike | None = None  # linear colour of empty pixels; None: environment, else ambient light
    exposure: float | None = 0.0  # EV for display; None: automatic
    tone_map: str = "none"  # operator for display: none, reinhard or aces

    def __post_init__(self) -> None:
        check_choice("reflections", self.reflections, REFLECTIONS)
        if self.supersample not in (1, 2):
            raise OptionError(f"supersample must be 1 or 2, got {self.supersample}")
        if self.background is not None:
            as_vector("background", self.background)
        if self.exposure is not None:
            check_range("exposure", self.exposure, -64.0, 64.0)
        check_choice("tone_map", self.tone_map, OPERATORS)


def render(
    scene: Scene | str | Path,
    camera: Cameras | str | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
) -> Image:
    """Pictures of a scene, one per camera.

    Args:
        scene: a scene, or the name or file of one.
        camera: cameras, the name of one of the scene's cameras, or None for its first, or where it has none one that
            frames the scene.
        width, height: size of the picture in pixels; the default is the size of ``camera`` where cameras are given,
            else 1024 x 768. Cameras of another shape keep their vertical opening angle.
        history: ``RenderHistory()`` starts a sequence of pictures, ``image.history`` of one picture is for the next.
            Shadow maps, ray caster and reflections are then used again as far as the scene has stood still; reused
            reflections are close to traced ones, not the same. See :class:`torchrender.history.RenderHistory`.

    A scene without any light gets :meth:`Scene.with_default_light`. A scene without triangles gives its background.

    Raises:
        SceneFileError: the scene cannot be loaded.
        InputError: no camera of that name; a size or an option out of range.
    """
    options = options or RenderOptions()
    clock = StepClock()
    with clock.measure("total"):
        if not isinstance(scene, Scene):
            with clock.measure("load"):
                scene = load(scene)
        past = _carried(history, scene, options)
        scene = past.scene or scene
        cameras = _cameras(scene, camera, width, height)
        fine = cameras if options.supersample == 1 else cameras.scaled(options.supersample)
        with clock.measure("raster"):
            gbuffer = rasterize(scene, fine)
        with clock.measure("shadows"):
            maps = past.shadow_maps or _shadow_maps(scene, gbuffer, options)
            visibility = None if maps is None else lights_visibility(scene, gbuffer, options.shadow, maps)
        with clock.measure("shade"):
            radiance = shade(scene, gbuffer, visibility, background=options.background)
        if options.reflections != "off":
            with clock.measure("reflections"):
                layer, past = _reflections(scene, gbuffer, radiance, maps, options, past)
                radiance = radiance if layer is None else blend_reflections(scene, gbuffer, radiance, layer)
        if fine is not cameras:
            with clock.measure("resolve"):
                radiance = _average(radiance, options.supersample)
                gbuffer = rasterize(scene, cameras)
    return Image(
        radiance=radiance,
        gbuffer=gbuffer,
        timings_ms=clock.elapsed_ms,
        exposure=options.exposure,
        tone_map=options.tone_map,
        history=None if history is None else replace(past, shadow_maps=_lasting(maps, options)),
    )


def _carried(history: RenderHistory | None, scene: Scene, options: RenderOptions) -> RenderHistory:
    """What an earlier picture left for one of this scene with these options; next to nothing without a history."""
    background = None if options.background is None else tuple(as_vector("background", options.background).tolist())
    settings = (
        options.reflections,
        options.reflection,
        options.tracing,
        options.reuse,
        options.supersample,
        background,
    )
    if history is None:
        return RenderHistory(scene=scene.with_default_light(), wanted=False)
    return history.carried(scene, (options.shadows, options.shadow), settings)


def _lasting(maps: Sequence[ShadowMap] | None, options: RenderOptions) -> Sequence[ShadowMap] | None:
    """Shadow maps that the next picture can use: cascades follow the eye."""
    return maps if options.shadow.cascades == 1 else None


def _cameras(scene: Scene, camera: Cameras | str | None, width: int | None, height: int | None) -> Cameras:
    if isinstance(camera, Cameras):
        return resized(camera, width or camera.width, height or camera.height)
    if camera is not None and not isinstance(camera, str):
        raise InputError(f"camera must be Cameras, a name or None, got {type(camera).__name__}")
    return scene.camera(camera, width=width or DEFAULT_SIZE[0], height=height or DEFAULT_SIZE[1])


def _shadow_maps(scene: Scene, gbuffer: GBuffer, options: RenderOptions) -> list[ShadowMap] | None:
    """A map per light; None if shadows are off or there is nothing to shadow."""
    if not options.shadows or not scene.lights or not bool(gbuffer.covered.any()):
        return None
    view = gbuffer.cameras if options.shadow.cascades > 1 else None
    return [render_shadow_map(scene, light, options.shadow, camera=view) for light in scene.lights]


def _reflections(
    scene: Scene,
    gbuffer: GBuffer,
    direct: Tensor,
    maps: Sequence[ShadowMap] | None,
    options: RenderOptions,
    past: RenderHistory,
) -> tuple[ReflectionLayer | None, RenderHistory]:
    """What the reflectors in view mirror, None if there are none; and the history with it."""
    pixels = reflective_pixels(scene, gbuffer)
    if not len(pixels):
        return None, past
    shader = past.shader or HitShader(scene, None if maps is None else options.shadow, maps, options.background)
    past = replace(past, shader=shader)
    if options.reflections == "environment":
        return environment_reflections(pixels, shader), past
    caster = past.caster

    def rays() -> RayCaster:
        nonlocal caster
        caster = caster or RayCaster(scene.geometry)
        return caster

    def trace(chosen: ReflectivePixels) -> ReflectionLayer:
        """All pixels by the way that was asked for; the scattered few that cannot be reused by rays."""
        if options.reflections == "clustered" and len(chosen) == len(pixels):
            return clustered_reflections(scene, chosen, shader, options.reflection, direct=direct, caster=rays).layer
        return trace_reflections(rays(), chosen, shader, options.tracing)

    if not past.wanted or gbuffer.cameras.orthographic:
        return trace(pixels), replace(past, caster=caster)
    made = reuse_reflections(pixels, gbuffer, trace, past.reuse, options.reuse, mirrored_share(scene, gbuffer, pixels))
    return made.layer, replace(past, caster=caster, reuse=made.state, report=made.report)


def _average(radiance: Tensor, factor: int) -> Tensor:
    """Mean over cells of ``factor`` x ``factor`` pixels, in linear light."""
    count, height, width, _ = radiance.shape
    cells = radiance.reshape(count, height // factor, factor, width // factor, factor, 3)
    return cells.mean(dim=(2, 4))
