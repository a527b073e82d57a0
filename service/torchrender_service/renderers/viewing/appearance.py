"""How a session wishes to see a scene: exposure, lights, media, and effects that are left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import torch

from torchrender.image import Image
from torchrender.numerics.tonemap import auto_exposure
from torchrender.pipeline.options import AS_LIT, RenderOptions
from torchrender.scene.model import Scene
from torchrender.scene.procedural.fog import changed_media
from torchrender.wire.viewing import Effect
from torchrender_service.renderers.jobs import MakeKeyframe
from torchrender_service.renderers.keyframes import Stamp

PACE = 0.35
"""Share of the way to the exposure that a picture asks for, in each picture of a moving view."""
MOST_EV = 24.0
SHOULDER = 16.0
"""Times the radiance that would be white without a tone curve: what is brighter, no curve shows."""
OFF: dict[Effect, dict[str, Any]] = {
    "shadows": {"shadows": False},
    "ambient": {"ambient_visibility": "off"},
    "reflections": {"reflections": "off"},
    "transparency": {"transparency": "off"},
    "media": {"media": False},
}
"""Changes to the options that leave an effect out; lights are left out of the scene."""


class Wish(NamedTuple):
    """What changes the scene itself."""

    density: float = 1.0
    asymmetry: float | None = None
    dark: bool = False  # without its lights


def wish_of(job: MakeKeyframe) -> Wish:
    """Of a keyframe."""
    return Wish(job.density, job.asymmetry, "lights" in job.off)


def as_wished(scene: Scene, wish: Wish) -> Scene:
    """The scene with other media, and without its lights where that is wished for; ambient light stays.

    A scene that nothing else lights gets a little ambient light, for a picture that is not black.
    """
    made = changed_media(scene, wish.density, wish.asymmetry)
    if not wish.dark or not scene.lights:
        return made
    dark = replace(made, lights=())
    if not dark.is_lit:
        dark = replace(dark, ambient=torch.full((3,), 0.5))
    if "geometry" in made.__dict__:  # the same triangles: nothing to build again
        dark.__dict__["geometry"] = made.geometry
    return dark


def options_of(usual: RenderOptions, off: Sequence[Effect]) -> RenderOptions:
    """The usual options without the effects that are left out."""
    changes: dict[str, Any] = {}
    for effect in off:
        changes |= OFF.get(effect, {})
    return replace(usual, **changes) if changes else usual


def brightest(stamp: Stamp) -> float:
    """Radiance beyond which a picture with this exposure is as bright as can be."""
    return 2.0**-stamp.exposure * (1.0 if stamp.tone_map == "none" else SHOULDER)


@dataclass(eq=False)
class Exposure:
    """The exposure of a session's pictures: an automatic one follows the light without jumps."""

    ev: float | None = None  # of the last picture; None: there was none

    def of(self, image: Image, wished: float | str, *, still: bool) -> float:
        """EV for a picture.

        Args:
            wished: a number, "auto", or "as_lit": 0, and automatic where the lights are photometric.
            still: the view is at rest: all the way to what the picture asks for.
        """
        if wished == AS_LIT:
            wished = "auto" if image.exposure is None else image.exposure
        if not isinstance(wished, str):
            self.ev = None
            return wished
        covered = image.visibility.covered
        asked = auto_exposure(image.radiance, mask=covered if bool(covered.any()) else None)
        asked = max(-MOST_EV, min(MOST_EV, asked))
        if self.ev is None or still:
            self.ev = asked
        else:
            self.ev += PACE * (asked - self.ev)
        return self.ev
