"""One picture in the making: what its passes ask for and hand on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.buffers import VisibilityBuffer
from torchrender.checks import as_vector
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflective_pixels
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.effects.shadows.soft_shadow import Occluders, occluders
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


@dataclass(eq=False, kw_only=True)
class Frame:
    """A picture in the making. Passes read ``buffers`` by name and return what they make; nothing outlives the frame
    but what is written to ``past``, which becomes the history of the next picture."""

    scene: Scene
    cameras: Cameras  # of the picture
    options: RenderOptions
    past: RenderHistory
    buffers: dict[str, Any] = field(default_factory=dict)
    mirrors: ReflectivePixels | None = None  # found once, whoever asks first
    seen: VisibilityBuffer | None = None  # by all pixels of the picture, where fewer are rendered

    @property
    def view(self) -> Cameras:
        """The cameras at the size that is rendered."""
        factor = self.options.supersample
        return self.cameras if factor == 1 else self.cameras.scaled(factor)

    def choose(self, options: RenderOptions) -> None:
        """Go on with other options; what the history holds for others is dropped."""
        background = None if options.background is None else tuple(as_vector("background", options.background).tolist())
        shadow = (options.shadows, lasting_shadows(options))
        reflections = (options.reflections, options.reflection, options.tracing, options.reuse, options.supersample)
        self.options, self.past = options, self.past.with_options(shadow, background, reflections)

    def visibility(self) -> VisibilityBuffer:
        """What every pixel of the picture sees, drawn on first use."""
        if self.seen is None:
            self.seen = rasterize_visibility(self.scene.geometry, self.cameras)
        return self.seen

    def reflectors(self) -> ReflectivePixels:
        """The reflective pixels of the G-buffer."""
        if self.mirrors is None:
            self.mirrors = reflective_pixels(self.scene, self.buffers["gbuffer"])
        return self.mirrors

    def caster(self) -> RayCaster:
        """The scene's ray caster, built on first use."""
        if self.past.caster is None:
            self.past = replace(self.past, caster=RayCaster(self.scene.geometry))
        assert self.past.caster is not None
        return self.past.caster

    def occluders(self) -> Occluders:
        """The scene's triangles, sorted for soft shadows on first use."""
        if self.past.occluders is None:
            self.past = replace(self.past, occluders=occluders(self.scene.geometry))
        assert self.past.occluders is not None
        return self.past.occluders

    def shader(self) -> HitShader:
        """The shading of what rays hit, in the light of this picture."""
        if self.past.shader is None:
            maps = self.buffers.get("shadow_maps")
            shadow = lasting_shadows(self.options) if self.options.shadows and maps is not None else None
            shader = HitShader(self.scene, shadow, maps, self.options.background)
            self.past = replace(self.past, shader=shader)
        assert self.past.shader is not None
        return self.past.shader


def lasting_shadows(options: RenderOptions) -> ShadowOptions:
    """Options that shadow maps are drawn with, and looked up with where mirrors show them.

    The look-up of the picture itself may be the quickest one; neither maps nor mirrors are made anew for that.
    """
    shadow = options.shadow
    return replace(shadow, filter="bilinear") if shadow.filter == "none" and shadow.soft is None else shadow
