"""Pictures of a moving view out of those at rest: light that is known is carried, the rest is shaded."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.clock import StepClock
from torchrender.effects.transparency.before import told_apart
from torchrender.effects.upsampling.carried import CarriedLight, LitPicture, carried_light
from torchrender.effects.upsampling.gathered import GatheredLight
from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.image import Image
from torchrender.pipeline.doubts import exposure_of
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.wire.viewing import Effect
from torchrender_service.renderers.streaming.glass import Base, View, lit_picture, through_panes, veiled
from torchrender_service.renderers.streaming.haze import PANELS, SLICES, Haze
from torchrender_service.renderers.streaming.lattice import (
    extent,
    middles,
    part_of,
    scattered,
    spacing_of,
    widen,
    widened,
    window_of,
)
from torchrender_service.renderers.streaming.layers import Layer
from torchrender_service.renderers.streaming.samples import ShadedPixels, background_of, joined, shade_pixels

MOST_PICTURES = 4
MOST_OF_STILL = 0.8
"""Share of the pixels that must be known for a view at rest to be made out of others."""
MOST_OF_MOVING = 0.3
"""The same for one that moves."""
FEWEST, MOST = 2048, 1 << 15
"""Pixels that one moving picture shades at least, also before it is known how long they take, and at most: a thousand
take nearly as long, and leave surfaces that come into view without their shadows."""
LEAST_MS = 30.0
"""Time that these have whatever else took."""
FEW_RAYS = 4
"""Of a pixel of a view at rest, for the light from everywhere: those around it share theirs. That takes longer than
more rays where there are few pixels."""


@dataclass(frozen=True, eq=False)
class CarriedPicture:
    """A picture with what a keyframe needs of it."""

    image: Image
    options: RenderOptions
    plan: dict[str, Any]
    history: RenderHistory
    mirrors: Layer


@dataclass(eq=False)
class LitViews:
    """Pictures at rest of one session whose light is carried, the newest last, and how many pixels it can shade."""

    pictures: list[LitPicture] = field(default_factory=list)
    quick: LitPicture | None = None  # the last one of a moving view that was made anew, until there is one at rest
    room: int = FEWEST  # pixels that a moving picture shades
    gathered: GatheredLight = field(default_factory=GatheredLight.none)  # that moving pictures shaded
    _scene: Scene | None = None
    _off: tuple[Effect, ...] = ()

    def newest(self) -> LitViews:
        """Another session of the same scene may begin with this."""
        return LitViews(self.pictures[-1:], self.quick, gathered=self.gathered, _scene=self._scene, _off=self._off)

    def with_gathered(self, other: LitViews) -> LitViews:
        """This with the single pixels of another session, where that shows the same scene without the same effects."""
        if other.gathered is self.gathered or other._scene is not self._scene or other._off != self._off:
            return self
        return replace(self, gathered=other.gathered)

    def of(self, scene: Scene, off: Sequence[Effect]) -> list[LitPicture]:
        """Those that show this scene without these effects; others are dropped."""
        if self._scene is not scene or self._off != tuple(off):
            self.pictures, self.quick, self._scene, self._off = [], None, scene, tuple(off)
            self.gathered = GatheredLight.none()
        return self.pictures

    def for_moving(self, scene: Scene, off: Sequence[Effect]) -> list[LitPicture]:
        """The same, and the last one that was made within a budget since."""
        pictures = self.of(scene, off)
        return pictures if self.quick is None else [*pictures[1 - MOST_PICTURES :], self.quick]

    def keep(
        self, scene: Scene, off: Sequence[Effect], image: Image, mirrors: Layer | None, *, quick: bool = False
    ) -> None:
        """One more, with what its mirrors show.

        Args:
            quick: made within a moving picture's budget: only until there is one at rest.
        """
        made = lit_picture(image, image.radiance[0].detach(), mirrors)
        pictures = self.of(scene, off)
        if quick:
            self.quick = made
        else:
            self.pictures, self.quick = [*pictures, made][-MOST_PICTURES:], None

    def improve(self, scene: Scene, off: Sequence[Effect], image: Image, light: Tensor) -> None:
        """The mean light (H,W,3) of several pictures in place of a kept one's own.

        Pixels beside an outline keep their own, in which no two surfaces mingle.
        """
        kept, haze = self.of(scene, off), Haze.of_image(image)
        for k, p in enumerate(kept):
            if p.seen.depth is image.visibility.depth:
                own = torch.where(_outlines(p.seen)[..., None], image.radiance[0], light).detach()
                kept[k] = replace(p, light=own if haze is None else haze.behind(own))

    def learn(self, shaded: int, took_ms: float, allowed_ms: float) -> None:
        """Of a moving picture that shaded so many pixels."""
        wanted = int(shaded * allowed_ms / max(took_ms, 1e-3))
        if wanted < self.room or shaded > self.room // 2:
            self.room = max(FEWEST, min(MOST, wanted, 2 * self.room))


def carried_picture(
    scene: Scene,
    camera: Cameras,
    views: LitViews,
    pictures: Sequence[LitPicture],
    past: RenderHistory,
    options: RenderOptions,
    *,
    budget_ms: float | None,
) -> CarriedPicture | None:
    """A view of one camera out of pictures of others; None where these show too little of it, or it is veiled.

    Pixels that none of them shows are shaded; where these are too many for the time, some of them in a lattice, and
    those between are filled in along the surfaces.

    Args:
        budget_ms: None: however long it takes.
    """
    if not pictures or veiled(scene, camera, options):
        return None
    begin = time.perf_counter()
    view = View.of(scene, camera, options, past, moving=budget_ms is not None)
    if view is None:
        return None
    carried = carried_light(view.apart, pictures, scene.geometry.material)
    if carried.share < (MOST_OF_STILL if budget_ms is None else MOST_OF_MOVING):
        return None
    rest = (~carried.known & view.filled) | carried.stale
    carried.mirrors.known[carried.stale] = False
    if budget_ms is not None:
        views.gathered.place(scene, view.apart, rest, carried.light)
    carried_ms = 1e3 * (time.perf_counter() - begin)
    room = None if budget_ms is None else views.room
    alone = _in_a_hurry(options)
    if budget_ms is None:
        few = replace(options.ambient, rays=FEW_RAYS, share=True)
        alone = replace(alone, ambient=few, scattering=options.scattering)
    chosen, radiance, shaded = _completed(scene, view, carried, rest, room, alone, past)
    took_ms = 1e3 * (time.perf_counter() - begin)
    if budget_ms is not None and bool(chosen.any()):
        views.learn(int(chosen.sum()), took_ms - carried_ms, max(LEAST_MS, budget_ms - carried_ms))
        bare = view.bare(radiance[chosen], chosen)
        views.gathered = views.gathered.with_samples(scene, view.apart, chosen, bare)
    lit = past.of_scene(scene).scene or scene
    kept = replace(past.of_scene(scene), kept={**past.kept, **shaded.history.kept})
    image = Image(
        radiance=radiance[None],
        cameras=camera,
        scene=lit,
        seen=view.seen,
        history=kept,
        exposure=exposure_of(lit, options),
        tone_map=options.tone_map,
    )
    mirrors = Layer(camera, carried.mirrors.depth, carried.mirrors.light, carried.mirrors.known)
    used = alone if shaded.plan is None else shaded.plan.options
    used = replace(used, scattering=replace(used.scattering, air=options.scattering.air))  # for further layers
    return CarriedPicture(image, used, _plan(shaded, carried, carried_ms, took_ms), kept, mirrors)


def _in_a_hurry(options: RenderOptions) -> RenderOptions:
    """For the few pixels that nothing shows of a view that another picture follows soon.

    Mirrors in mirrors, and slices of media, take about as long for a thousand of them as for all.
    """
    scattering = replace(options.scattering, slices=SLICES, panels=PANELS)
    return replace(options, tracing=replace(options.tracing, bounces=1), scattering=scattering)


def smooth_edges(image: Image, light: Tensor, aside: Sequence[tuple[float, float]]) -> Tensor:
    """The light (H,W,3) of a picture as the mean over views moved by parts of a pixel, which see the same light.

    Outlines become smooth, as by several samples of coverage for each that is shaded.
    """
    camera, geometry = image.cameras, image.scene.geometry
    picture = LitPicture(told_apart(image.scene, image.visibility), light.detach())
    total, count = light.clone(), torch.ones(*light.shape[:2], 1)
    clock = StepClock()  # whoever asked may have gone on: that is looked at between its steps
    for right, down in aside:
        with clock.measure("seen"):
            seen = rasterize_visibility(geometry, camera.sub_camera(right, down, camera.width, camera.height))
        with clock.measure("carried"):
            found = carried_light(told_apart(image.scene, seen), [picture], geometry.material)
        total += found.light
        count += found.known[..., None]
    return total / count


def moved_aside(
    scene: Scene, cameras: Sequence[Cameras], base: Base, options: RenderOptions, past: RenderHistory
) -> list[Tensor] | None:
    """The light (H,W,3) of views a part of a pixel beside another's, whose light they take where the picture is calm;
    busy pixels, and what is seen between those of the other, are shaded, those of all views together. None where the
    history lacks what their panes or media need."""
    clock = StepClock()
    views, lights, chosen = [], [], []
    for camera in cameras:
        with clock.measure("seen"):
            view = View.of(scene, camera, options, past, base)
        if view is None:
            return None
        with clock.measure("carried"):
            carried = carried_light(view.apart, [base.picture], scene.geometry.material)
        _fill_sky(scene, view, carried, options, past)
        views.append(view)
        lights.append(carried.light)
        chosen.append(view.filled & (base.busy | ~carried.known))
    _shade(scene, views, chosen, lights, options, past)
    return [view.hazed(light) for view, light in zip(views, lights, strict=True)]


def _shade(
    scene: Scene,
    views: Sequence[View],
    chosen: Sequence[Tensor],
    lights: Sequence[Tensor],
    options: RenderOptions,
    past: RenderHistory,
) -> tuple[Tensor, ShadedPixels]:
    """Put into the lights (H,W,3) of one eye's views what their chosen pixels (H,W) show, through panes but not media;
    which of these are covered, and how they were shaded."""
    bare = replace(options, scattering=replace(options.scattering, air=False))
    seen = joined([view.seen for view in views])
    solid = torch.stack(list(chosen)) & seen.covered
    shaded = shade_pixels(scene, seen, solid, bare, past)
    for light, own, part in zip(lights, solid, shaded.radiance.split([int(own.sum()) for own in solid]), strict=True):
        light[own] = part
    through_panes(scene, views, chosen, lights)
    return solid, shaded


def _fill_sky(scene: Scene, view: View, carried: CarriedLight, options: RenderOptions, past: RenderHistory) -> None:
    """Put what surrounds the scene into the light, where it is seen and not known."""
    sky = ~carried.known & ~view.seen.covered[0]
    if bool(sky.any()):
        window = tuple(extent(sky.any(dim=axis)) for axis in (1, 0))
        shown = background_of(scene, window_of(view.seen, *window), replace(options, media=False), past)
        carried.light[sky] = shown[sky[window]]


def _completed(
    scene: Scene,
    view: View,
    carried: CarriedLight,
    rest: Tensor,
    room: int | None,
    options: RenderOptions,
    past: RenderHistory,
) -> tuple[Tensor, Tensor, ShadedPixels]:
    """Which covered pixels (H,W) were shaded, and radiance (H,W,3) with the rest (H,W) of the pixels, and the sky."""
    radiance, count = carried.light, int(rest.sum())
    room = count if room is None else room
    spacing = spacing_of(count, room)
    rows, columns = (middles(side, spacing) for side in rest.shape)
    lattice = torch.zeros_like(rest).index_put_((rows[:, None], columns), torch.tensor(True))
    chosen = rest & lattice
    chosen |= scattered(rest & ~lattice, room - int(chosen.sum()))
    _fill_sky(scene, view, carried, options, past)
    solid, shaded = _shade(scene, [view], [chosen], [radiance], options, past)
    between = rest & ~chosen
    if bool(between.any()):
        few = part_of(view.apart, rows[:, None], columns)
        size = spacing * len(rows), spacing * len(columns)
        many, wanted = widened(view.apart, size), widen(between[None], size, False)
        filled = joint_upsampled(radiance[rows[:, None], columns][None], few, many, scene.geometry.material, wanted)[0]
        radiance[between] = filled[wanted[0]]
    return solid[0], view.hazed(radiance), shaded


def _outlines(seen: VisibilityBuffer) -> Tensor:
    """(H,W) bool of one camera: another object, or nothing, stands beside the pixel."""
    owner = seen.object_id[0]
    found = torch.zeros_like(owner, dtype=torch.bool)
    for axis in (0, 1):
        differs = owner.diff(dim=axis) != 0
        size = owner.shape[axis] - 1
        for start in (0, 1):
            found.narrow(axis, start, size).logical_or_(differs)
    return found


def _plan(shaded: ShadedPixels, carried: CarriedLight, carried_ms: float, took_ms: float) -> dict[str, Any]:
    """What was done, as the plan of a picture tells it."""
    row = {
        "pass": "carried_light",
        "runs": True,
        "reason": f"{100 * carried.share:.1f} % of the pixels: as pictures at rest show them",
        "settings": "-",
        "predicted_ms": None,
        "predicted_error": None,
        "measured_ms": round(carried_ms, 2),
    }
    made: dict[str, Any] = {} if shaded.plan is None else shaded.plan.to_dict()
    rows = [] if shaded.plan is None else made["rows"]
    usual: dict[str, Any] = {"budget_ms": None, "max_error": None, "possible": True, "statement": "", "changes": []}
    unknown = {"predicted_ms": None, "following_ms": None, "predicted_error": None}
    return {**usual, **made, **unknown, "rows": [row, *rows], "measured_ms": round(took_ms, 2)}
