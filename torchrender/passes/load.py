"""How much work each pass has: amounts that its time is a weighted sum of. The weights are measured (``curves``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from torchrender.passes.knobs import Setting
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight


@dataclass(frozen=True, kw_only=True)
class Load:
    """What a picture brings its passes. Pixels and triangles in millions."""

    picture: float  # pixels of the picture
    pixels: float  # rendered ones
    triangles: float
    views: int  # of all lights' shadow maps
    map_size: int | None  # texels of a side of the maps that are there already; None: none are
    point_lights: int
    area_lights: int
    reflective: float  # rendered pixels that mirror
    caster: bool  # there already
    occluders: bool  # there already
    shader: bool  # of reflected hits, there already

    @property
    def tree(self) -> float:
        """Triangles that a ray caster would have to sort first."""
        return 0.0 if self.caster else self.triangles


Work = Callable[[Load, Setting], tuple[float, ...]]


def map_views(light: Light) -> int:
    """Pictures that a shadow map of the light takes."""
    if isinstance(light, DirectionalLight):
        return 1
    if isinstance(light, PointLight):
        return 6
    if isinstance(light, RectLight):
        return 5
    return 1 if light.outer_deg <= 65.0 else 5


def gbuffer(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; pixels; triangles."""
    del setting
    return (1.0, load.pixels, load.triangles)


def shadow_map(load: Load, setting: Setting) -> tuple[float, ...]:
    """Views; their texels; their triangles: nothing if the maps are there already."""
    size = setting.changes.get("shadow.size", 1024)
    if size == load.map_size:
        return (0.0, 0.0, 0.0)
    views = float(load.views)
    return (views, views * size * size * 1e-6, views * load.triangles)


def point_shadow(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; look-ups; triangles to sort."""
    traced = setting.changes.get("point_shadows") == "traced"
    return (1.0, load.point_lights * load.pixels, load.tree if traced else 0.0)


def soft_shadow(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; look-ups; triangles to sort."""
    sampled = setting.changes.get("area_shadows") == "sampled"
    return (1.0, load.area_lights * load.pixels, load.triangles if sampled and not load.occluders else 0.0)


def direct_light(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; pixels; pixels times lights, without and with area."""
    del setting
    return (1.0, load.pixels, load.pixels * load.point_lights, load.pixels * load.area_lights)


def reflection_reuse(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; reflective pixels; triangles to sort for the rest that is traced."""
    del setting
    return (1.0, load.reflective, load.tree)


def reflections(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; reflective pixels; triangles in the clusters' pictures; triangles to sort; the cube map around."""
    way = setting.changes.get("reflections")
    drawn = load.triangles if way == "clustered" else 0.0
    sorts = way == "traced" or setting.changes.get("reflection.missing") == "trace"
    return (1.0, load.reflective, drawn, load.tree if sorts else 0.0, 0.0 if load.shader else 1.0)


def resolve(load: Load, setting: Setting) -> tuple[float, ...]:
    """Once; rendered pixels; reflective ones; where these are fewer than the picture's: its pixels, and its triangles
    if they guide the scaling."""
    fewer = load.pixels < load.picture
    guided = fewer and setting.changes.get("upscaling") == "joint"
    picture, triangles = load.picture if fewer else 0.0, load.triangles if guided else 0.0
    return (1.0, load.pixels, load.reflective, picture, triangles)
