"""Why a pass runs or does not, from what is known before the picture: scene, cameras and options."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from torchrender.arrays import view as numpy_view
from torchrender.kernels.raster.project import visible_clusters
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene


class Verdict(NamedTuple):
    """Whether a pass runs, and why."""

    runs: bool
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Outlook:
    """What is known before a picture is made."""

    scene: Scene
    cameras: Cameras
    options: RenderOptions
    reflectors_in_view: int  # meshes that mirror whose bounding box meets the frustum of a camera
    sequence: bool = False  # a history was handed in
    mirrored: float | None = None  # share of the pixels that mirror, once the G-buffer is known

    @property
    def has_reflectors(self) -> bool:
        """Some material of a mesh mirrors."""
        return len(self.scene.reflector_bounds) > 0

    @property
    def area_lights(self) -> int:
        """Rectangular lights."""
        return sum(isinstance(light, RectLight) for light in self.scene.lights)

    @property
    def point_lights(self) -> int:
        """Lights without area."""
        return len(self.scene.lights) - self.area_lights

    @property
    def reflects(self) -> bool:
        """Reflections are wanted and some reflector may be seen."""
        return self.options.reflections != "off" and self.reflectors_in_view > 0 and self.mirrored != 0


def reflectors_in_view(scene: Scene, cameras: Cameras) -> int:
    """Meshes that mirror whose bounding box meets the frustum of a camera."""
    if not len(scene.reflector_bounds):
        return 0
    bounds = numpy_view(scene.reflector_bounds, np.float64)
    seen: set[int] = set()
    for planes in cameras.frustum_planes():
        seen.update(visible_clusters(bounds, numpy_view(planes, np.float64))[0].tolist())
    return len(seen)


def counted(number: int, thing: str) -> str:
    """``1 light``, ``2 lights``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def always(reason: str) -> Verdict:
    """A pass that every picture needs."""
    return Verdict(True, reason)


def gbuffer(outlook: Outlook) -> Verdict:
    """Everything else asks the G-buffer."""
    del outlook
    return always("every other pass asks it")


def shadows(outlook: Outlook) -> Verdict | None:
    """Why no light casts a shadow; None if some may."""
    if not outlook.options.shadows:
        return Verdict(False, "shadows are turned off")
    if not outlook.scene.lights:
        return Verdict(False, "the scene has no light that could cast shadows")
    if not outlook.scene.geometry.triangle_count:
        return Verdict(False, "the scene has no triangles")
    return None


def shadow_map(outlook: Outlook) -> Verdict:
    """Maps serve look-ups of the picture, and of what it mirrors."""
    options, users = outlook.options, []
    nothing = shadows(outlook)
    if nothing is not None:
        return nothing
    if outlook.point_lights and options.point_shadows == "maps":
        users.append(counted(outlook.point_lights, "light") + " without area")
    if outlook.area_lights and options.area_shadows != "sampled":
        users.append(counted(outlook.area_lights, "area light"))
    if outlook.reflects:
        users.append("what mirrors show")
    if not users:
        return Verdict(False, "all lights are sampled or traced, and nothing mirrors")
    return Verdict(True, "for " + ", ".join(users))


def point_shadow(outlook: Outlook) -> Verdict:
    """Lights without area cast hard shadows."""
    nothing = shadows(outlook)
    if nothing is not None:
        return nothing
    if not outlook.point_lights:
        return Verdict(False, "every light has an area")
    return Verdict(True, counted(outlook.point_lights, "light") + " without area: hard shadows")


def soft_shadow(outlook: Outlook) -> Verdict:
    """Lights with an area have penumbrae."""
    nothing = shadows(outlook)
    if nothing is not None:
        return nothing
    if not outlook.area_lights:
        return Verdict(False, "no light has an area: hard shadows by shadow map instead")
    return Verdict(True, counted(outlook.area_lights, "light") + " with an area")


def direct_light(outlook: Outlook) -> Verdict:
    """Light that arrives without detour, emission, background."""
    return always("light of " + counted(len(outlook.scene.lights), "light") + ", ambient light, background")


def reflections(outlook: Outlook) -> Verdict:
    """Something mirrors."""
    if outlook.options.reflections == "off":
        return Verdict(False, "reflections are turned off")
    if not outlook.has_reflectors:
        return Verdict(False, "no material mirrors")
    if not outlook.reflectors_in_view:
        return Verdict(False, "no reflector meets the view frustum")
    if outlook.mirrored is None:
        return Verdict(True, counted(outlook.reflectors_in_view, "reflector") + " may be in view")
    if outlook.mirrored == 0:
        return Verdict(False, "reflectors meet the view frustum, but no pixel shows one")
    return Verdict(True, f"{100 * outlook.mirrored:.1f} % of the pixels mirror")


def reflection_reuse(outlook: Outlook) -> Verdict:
    """A sequence of pictures of mirrors."""
    verdict = reflections(outlook)
    if not verdict.runs:
        return verdict
    if outlook.options.reuse is None:
        return Verdict(False, "reuse is turned off")
    if not outlook.sequence:
        return Verdict(False, "the picture is not part of a sequence: no history was given")
    if outlook.options.reflections == "environment":
        return Verdict(False, "one cube map costs less than reuse")
    if outlook.cameras.orthographic:
        return Verdict(False, "orthographic views have no moving eye")
    return Verdict(True, "a sequence: what was mirrored is used again, the rest traced")


def resolve(outlook: Outlook) -> Verdict:
    """The picture at its own size."""
    factor = outlook.options.supersample
    if factor == 1:
        return always("reflections are blended in" if outlook.reflects else "one sample per pixel: handed on as it is")
    how = f"mean of {factor:g} x {factor:g} samples" if factor > 1 else f"scaled up by {1 / factor:g}"
    return always(how)
