"""What a session of a stream leaves for its next keyframe."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from torch import Tensor

from torchrender.image import Image
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender_service.renderers.jobs import Bounds, MakeKeyframe
from torchrender_service.renderers.keyframes import Stamp, displayed
from torchrender_service.renderers.streaming.carrying import LitViews
from torchrender_service.renderers.streaming.glass import Base, lit_picture, veiled
from torchrender_service.renderers.streaming.haze import Haze, is_hazy
from torchrender_service.renderers.streaming.lattice import window_of
from torchrender_service.renderers.streaming.layers import Layer
from torchrender_service.renderers.streaming.samples import busiest
from torchrender_service.renderers.viewing.appearance import Exposure, Wish, as_wished

ASIDE = ((-0.375, -0.125), (0.125, -0.375), (0.375, 0.125), (-0.125, 0.375))
"""Pixels by which the further pictures of a refinement are moved: with the first, five places in every pixel."""


@dataclass(frozen=True, eq=False)
class Begun:
    """A keyframe whose extra layers are still to be made."""

    stamp: Stamp
    image: Image
    options: RenderOptions  # that it was made with
    past: RenderHistory
    around: list[Cameras]
    mirrors: Layer | None = None


@dataclass(frozen=True, eq=False)
class Made:
    """A picture with what a keyframe needs of it."""

    image: Image
    plan: dict[str, Any]
    options: RenderOptions  # that it was made with
    history: RenderHistory
    mirrors: Layer | None  # what they show
    carried: bool = False  # most of its light is that of other pictures


@dataclass(eq=False)
class Refinement:
    """A view at rest, and the light of all pictures that were made of it so far."""

    job: MakeKeyframe
    begun: Begun
    scene: Scene
    camera: Cameras
    bounds: Bounds
    brightest: float  # radiance that can be displayed at most
    plan: dict[str, Any]  # of the last picture that was made anew
    render_ms: float
    light: Tensor | None = None  # (H,W,3) sum over the pictures; None: what was sent is made of others' light
    count: int = 0
    base: Base | None = None  # the further pictures take their light from this; None: they are made anew
    carried: Made | None = None  # what was sent first, where its margin serves the picture that is made anew

    def begin(self, made: Made) -> None:
        """With what was sent first: a picture that was made anew, or the margin of a carried one."""
        if not made.carried:
            self.take(made, whole=not veiled(self.scene, self.camera, made.options))
        elif not is_hazy(self.scene, self.camera, made.options):
            self.carried = made

    def take(self, made: Made, *, whole: bool) -> None:
        """A picture that was made anew. The extra layers and mirrors of the last message are those of the first.

        Args:
            whole: its light belongs to surfaces, so that others may take it.
        """
        image, first = made.image, self.light is None
        light = image.radiance[0].clamp(max=self.brightest)
        self.add(light)
        self.plan, self.carried = made.plan, None
        if not first:
            return
        mirrors = made.mirrors if self.begun.mirrors is not None and made.mirrors is not None else self.begun.mirrors
        self.begun = replace(self.begun, image=image, options=made.options, past=made.history, mirrors=mirrors)
        if whole and self.bounds.budget_ms is None and made.options.supersample >= 1.0:
            rows, columns = self.shown
            picture, haze = lit_picture(image, light, None), Haze.of_image(image)
            self.base = Base(
                picture=picture,
                seen=window_of(picture.seen, rows, columns),
                haze=None if haze is None else haze.part(rows, columns),
                busy=busiest(displayed(self.begun.stamp, light)[rows, columns]),
            )

    @property
    def next_cameras(self) -> list[Cameras]:
        """Of the pictures to come, a part of a pixel aside: the margin that only a moving view needs is left out where
        it is known."""
        if self.light is None and self.carried is None:
            return [self.camera]
        rows, columns = self.shown
        size = columns.stop - columns.start, rows.stop - rows.start
        places = ((0.0, 0.0),) if self.light is None else ASIDE[self.count - 1 :]
        return [self.camera.sub_camera(columns.start + right, rows.start + down, *size) for right, down in places]

    @property
    def shown(self) -> tuple[slice, slice]:
        """Rows and columns of the view without the margin."""
        left, top = self.job.margin
        return slice(top, self.camera.height - top), slice(left, self.camera.width - left)

    def add(self, light: Tensor) -> None:
        """The light of one more picture (H,W,3), or of what is shown of it: around that it is as in those so far."""
        light = light.clamp(max=self.brightest)
        if self.light is None:
            self.light = light
        else:
            whole = self.light / self.count
            whole[self.shown] = light
            self.light = self.light + whole
        self.count += 1


@dataclass
class SessionState:
    """What the renderer remembers of a session."""

    history: RenderHistory
    packing_ms: float = 0.0  # from the last picture to its message
    begun: Begun | None = None
    wished: tuple[Scene, Wish, Scene] | None = None  # a scene, what was wished for, and what it is then
    exposure: Exposure = field(default_factory=Exposure)
    lit: LitViews = field(default_factory=LitViews)
    bytes: int = 0  # of what is this session's own
    unweighed: int = 0  # keyframes since these were counted

    def as_wished(self, scene: Scene, wish: Wish) -> Scene:
        """The scene with the media and lights that the session wishes for: the same one while the wish is."""
        if self.wished is None or self.wished[0] is not scene or self.wished[1] != wish:
            self.wished = (scene, wish, as_wished(scene, wish))
        return self.wished[2]
