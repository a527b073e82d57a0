"""How a picture is made: every choice that ``render`` leaves to its caller, or to a budget."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from torchrender.checks import ArrayLike, as_vector, check_choice, check_not_negative, check_range, checked_fields
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.effects.shadows.soft_shadow import SoftShadowOptions
from torchrender.effects.sky_shadows.options import SkyShadowOptions
from torchrender.errors import OptionError
from torchrender.numerics.tonemap import OPERATORS
from torchrender.shade import AREA_LIGHTS

REFLECTIONS = ("auto", "clustered", "traced", "environment", "off")
POINT_SHADOWS = ("maps", "traced")
AREA_SHADOWS = ("pcss", "hard", "sampled")
AMBIENT_VISIBILITY = ("auto", "off", "horizon", "traced")
TRANSPARENCY = ("peeled", "traced", "off")
AS_LIT = "as_lit"
AUTOMATIC = "auto"
UPSCALING = ("joint", "bilinear", "nearest")


@dataclass(frozen=True, kw_only=True)
@checked_fields
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
    sky_shadow: SkyShadowOptions = field(default_factory=SkyShadowOptions)  # of objects before an environment
    area_light: str = "polygon"  # light of rectangles without shadows: exact, or "centre": all from their centre
    ambient_visibility: str = "auto"  # what hides light from everywhere: "horizon" search, "traced", "off": nothing
    ambient: AmbientOptions = field(default_factory=AmbientOptions)
    reflections: str = "auto"  # how reflectors mirror: "clustered", "traced", "environment" (one cube map), "off", or
    # "auto": the most accurate of the quick ways
    reflection: ClusterOptions = field(default_factory=ClusterOptions)
    tracing: TraceOptions = field(default_factory=TraceOptions)
    reuse: ReuseOptions | None = field(default_factory=ReuseOptions)  # in pictures with a history; None: never
    transparency: str = "peeled"  # surfaces that show what lies behind: "peeled" layers, "traced", or "off": none
    transparent_layers: int = 64  # before each other, at most
    media: bool = True  # media scatter and absorb light; False: the air is clear
    scattering: ScatterOptions = field(default_factory=ScatterOptions)
    supersample: float = 1.0  # rendered pixels per picture pixel and side; 2: two by two; 0.5: a quarter of them
    upscaling: str = "joint"  # of fewer rendered pixels: "joint": along the surfaces seen, "bilinear", or "nearest"
    enhance: EnhanceOptions | None = None  # shape made easier to read; None: the picture as it is
    buffers: tuple[str, ...] = ()  # what passes make that the picture shall carry, by name; rendered size
    passes: tuple[Any, ...] | None = None  # the table of passes; None: the built-in one
    effects: Mapping[str, Any] = field(default_factory=dict)  # options of further passes, by name of the pass
    fixed: tuple[str, ...] = ()  # passes whose settings a budget or an error bound must leave as they are
    background: ArrayLike | None = None  # linear colour of empty pixels; None: environment, else ambient light
    exposure: float | str | None = AS_LIT  # EV for display; "auto", kept as None: automatic; "as_lit": 0, of
    # photometric lights automatic. Automatic is one exposure for all pictures of a batch
    tone_map: str = "none"  # operator for display: none, reinhard or aces

    def __post_init__(self) -> None:
        check_choice("reflections", self.reflections, REFLECTIONS)
        check_choice("point_shadows", self.point_shadows, POINT_SHADOWS)
        check_choice("area_shadows", self.area_shadows, AREA_SHADOWS)
        check_choice("ambient_visibility", self.ambient_visibility, AMBIENT_VISIBILITY)
        check_choice("transparency", self.transparency, TRANSPARENCY)
        check_range("transparent_layers", self.transparent_layers, 1, 4096)
        check_choice("area_light", self.area_light, AREA_LIGHTS)
        check_choice("upscaling", self.upscaling, UPSCALING)
        check_range("supersample", self.supersample, 1 / 16, 4.0)
        if self.background is not None:
            check_not_negative("background", as_vector("background", self.background), OptionError)
        self._check_exposure()
        if self.passes is not None and not (self.passes and all(hasattr(one, "makes") for one in self.passes)):
            raise OptionError("passes must be a table of passes, such as torchrender.passes.table.PASSES, or None")
        check_choice("tone_map", self.tone_map, OPERATORS)

    def _check_exposure(self) -> None:
        if self.exposure == AUTOMATIC:
            object.__setattr__(self, "exposure", None)
        elif isinstance(self.exposure, str):
            if self.exposure != AS_LIT:
                raise OptionError(f'exposure must be a number (EV), "auto" or "as_lit", got {self.exposure!r}')
        elif self.exposure is not None:
            check_range("exposure", self.exposure, -64.0, 64.0)


SHADOWS: Mapping[str, Mapping[str, Any]] = {
    "off": {"shadows": False},
    "hard": {"area_shadows": "hard"},
    "maps": {},
    "sampled": {"area_shadows": "sampled"},
    "traced": {"area_shadows": "sampled", "point_shadows": "traced"},
}
"""Ways to make shadows, by name, as changes to the options: none; hard ones; penumbrae guessed from one map (the usual
way); rectangles sampled; and rays for lights without area, too."""


def shadow_choices(shadows: str | None = None, size: int | None = None, cascades: int | None = None) -> dict[str, Any]:
    """Arguments of :class:`RenderOptions` for a way to make shadows, the side of maps and the number along the view.

    What is None stays as usual.

    Raises:
        OptionError: another name or a number out of range; names it.
    """
    made: dict[str, Any] = {}
    if shadows is not None:
        check_choice("shadows", shadows, tuple(SHADOWS))
        made |= SHADOWS[shadows]
    usual = ShadowOptions()
    shadow = replace(usual, size=usual.size if size is None else size, cascades=cascades)
    return made | ({} if shadow == usual else {"shadow": shadow})


def lasting_shadows(options: RenderOptions) -> ShadowOptions:
    """Options that shadow maps are drawn with, and looked up with where mirrors show them.

    The look-up of the picture itself may be the quickest one; neither maps nor mirrors are made anew for that.
    """
    return _looked_up(options.shadow)


def everywhere(options: RenderOptions) -> ShadowOptions:
    """The same of maps of everything, whatever the picture sees."""
    return _everywhere(options.shadow)


# A plan asks for these a few hundred times, of a few dozen settings.
@lru_cache(maxsize=256)
def _looked_up(options: ShadowOptions) -> ShadowOptions:
    shadow = replace(options, edges="exact")
    return replace(shadow, filter="bilinear") if shadow.filter == "none" and shadow.soft is None else shadow


@lru_cache(maxsize=256)
def _everywhere(options: ShadowOptions) -> ShadowOptions:
    return replace(_looked_up(options), coverage="scene", cascades=None)


def plain_background(options: RenderOptions) -> tuple[float, ...] | None:
    """The background as plain numbers, to be compared."""
    return None if options.background is None else tuple(as_vector("background", options.background).tolist())
