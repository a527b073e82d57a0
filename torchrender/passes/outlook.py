"""What is known about a picture while it is planned: scene, cameras, options, what is kept, what was seen so far."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.shadows.light_reach import shines
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene

T = TypeVar("T")

UNKNOWN_SHARE = 0.3
"""Share of the pixels that is taken for a quantity before a picture of the scene was made."""


class Verdict(NamedTuple):
    """Whether a pass runs, and why."""

    runs: bool
    reason: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Outlook:
    """What is known before, and in the middle of, a picture."""

    scene: Scene  # with its lights
    cameras: Cameras
    options: RenderOptions
    history: RenderHistory
    known: Mapping[str, float] = field(default_factory=dict)  # quantities that passes of this picture found out
    samples: GBuffer | RaySurface | None = None  # given ones instead of what the cameras see
    facts: dict[Any, Any] = field(default_factory=dict, repr=False)  # found once a picture

    def fact(self, find: Callable[[Scene, Cameras], T]) -> T:
        """Something about scene and cameras, found once a picture."""
        if find not in self.facts:
            self.facts[find] = find(self.scene, self.cameras)
        return self.facts[find]

    def at(self, options: RenderOptions) -> Outlook:
        """The same with other options."""
        other = object.__new__(Outlook)
        other.__dict__.update(self.__dict__)
        other.__dict__["options"] = options
        return other

    def kept(self, buffer: Buffer[T]) -> T | None:
        """What an earlier picture left of a buffer, if it holds for this scene and these options."""
        return self.history.get(buffer, self.options)

    def knows(self, quantity: str) -> bool:
        """The quantity was found out, in this picture or the last one."""
        pace = self.history.pace
        return quantity in self.known or (pace is not None and quantity in pace.known)

    def share(self, quantity: str) -> float:
        """A share of the rendered pixels: as found out, as in the last picture, or a guess."""
        found = self.known.get(quantity)
        if found is None and self.history.pace is not None:
            found = self.history.pace.known.get(quantity)
        return UNKNOWN_SHARE if found is None else found

    @property
    def area_lights(self) -> int:
        """Rectangular lights."""
        return sum(isinstance(light, RectLight) for light in self.scene.lights)

    @property
    def point_lights(self) -> int:
        """Lights without area."""
        return len(self.scene.lights) - self.area_lights

    @property
    def picture_pixels(self) -> float:
        """Of all pictures, in millions."""
        return 1e-6 * len(self.cameras) * self.cameras.width * self.cameras.height

    @property
    def pixels(self) -> float:
        """Rendered ones, in millions; those of given samples."""
        if self.samples is not None:
            return 1e-6 * self.samples.covered.numel()
        factor = self.options.supersample
        if factor not in self.facts:
            view = self.cameras if factor == 1 else self.cameras.scaled(factor)
            self.facts[factor] = 1e-6 * len(view) * view.width * view.height
        return float(self.facts[factor])

    @property
    def triangles(self) -> float:
        """In millions."""
        return 1e-6 * self.scene.geometry.triangle_count


def counted(number: int, thing: str) -> str:
    """``1 light``, ``2 lights``."""
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"


def no_shadows(outlook: Outlook) -> Verdict | None:
    """Why no light casts a shadow; None if some may."""
    if not outlook.options.shadows:
        return Verdict(False, "shadows are turned off")
    if not outlook.scene.lights:
        return Verdict(False, "the scene has no light that could cast shadows")
    if not outlook.scene.geometry.triangle_count:
        return Verdict(False, "the scene has no triangles")
    if not outlook.fact(_some_shine):
        return Verdict(False, "every light is off")
    return None


def _some_shine(scene: Scene, _: Cameras) -> bool:
    return any(shines(light) for light in scene.lights)
