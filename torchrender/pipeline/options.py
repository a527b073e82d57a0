"""How a picture is made: every choice that ``render`` leaves to its caller, or to a budget."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.checks import ArrayLike, as_vector, check_choice, check_range
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions
from torchrender.numerics.tonemap import OPERATORS
from torchrender.shade import AREA_LIGHTS

REFLECTIONS = ("clustered", "traced", "environment", "off")
POINT_SHADOWS = ("maps", "traced")
AREA_SHADOWS = ("pcss", "hard", "sampled")
AS_LIT = "as lit"
UPSCALING = ("joint", "bilinear", "nearest")


@dataclass(frozen=True, kw_only=True)
class RenderOptions:
    """How a picture is made.

    Raises:
        OptionError: a value outside its range; names it.
    """

    shadows: bool = True
    shadow: ShadowOptions = field(default_factory=ShadowOptions)
    point_shadows: str = "maps"  # of lights without area: shadow "maps", or "traced" by a ray per pixel and light
    area_shadows: str = "pcss"  # of rectangles: "pcss" (one map, penumbrae guessed), "hard" (one map), or "sampled"
    soft_shadow: SoftShadowOptions = field(default_factory=SoftShadowOptions)  # of area_shadows="sampled"
    area_light: str = "polygon"  # light of rectangles without shadows: exact, or "centre": all from their centre
    reflections: str = "clustered"  # how reflectors mirror: "clustered", "traced", "environment" (one cube map), "off"
    reflection: ClusterOptions = field(default_factory=ClusterOptions)
    tracing: TraceOptions = field(default_factory=TraceOptions)
    reuse: ReuseOptions | None = field(default_factory=ReuseOptions)  # in pictures with a history; None: never
    supersample: float = 1.0  # rendered pixels per picture pixel and side; 2: two by two; 0.5: a quarter of them
    upscaling: str = "joint"  # of fewer rendered pixels: "joint": along the surfaces seen, "bilinear", or "nearest"
    buffers: tuple[str, ...] = ()  # what passes make that the picture shall carry, by name; rendered size
    passes: tuple[Any, ...] | None = None  # the table of passes; None: the built-in one
    effects: Mapping[str, Any] = field(default_factory=dict)  # options of further passes, by name of the pass
    fixed: tuple[str, ...] = ()  # passes whose settings a budget or an error bound must leave as they are
    background: ArrayLike | None = None  # linear colour of empty pixels; None: environment, else ambient light
    exposure: float | str | None = AS_LIT  # EV for display; None: automatic; "as lit": 0, photometric lights: automatic
    tone_map: str = "none"  # operator for display: none, reinhard or aces

    def __post_init__(self) -> None:
        check_choice("reflections", self.reflections, REFLECTIONS)
        check_choice("point_shadows", self.point_shadows, POINT_SHADOWS)
        check_choice("area_shadows", self.area_shadows, AREA_SHADOWS)
        check_choice("area_light", self.area_light, AREA_LIGHTS)
        check_choice("upscaling", self.upscaling, UPSCALING)
        check_range("supersample", self.supersample, 1 / 16, 4.0)
        if self.background is not None:
            as_vector("background", self.background)
        if isinstance(self.exposure, str):
            check_choice("exposure", self.exposure, (AS_LIT,))
        elif self.exposure is not None:
            check_range("exposure", self.exposure, -64.0, 64.0)
        check_choice("tone_map", self.tone_map, OPERATORS)


def lasting_shadows(options: RenderOptions) -> ShadowOptions:
    """Options that shadow maps are drawn with, and looked up with where mirrors show them.

    The look-up of the picture itself may be the quickest one; neither maps nor mirrors are made anew for that.
    """
    shadow = options.shadow
    return replace(shadow, filter="bilinear") if shadow.filter == "none" and shadow.soft is None else shadow


def plain_background(options: RenderOptions) -> tuple[float, ...] | None:
    """The background as plain numbers, to be compared."""
    return None if options.background is None else tuple(as_vector("background", options.background).tolist())
