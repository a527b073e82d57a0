"""Pictures of a view at rest out of what is there: maps of everything serve where they are fine enough."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import ShadowMap, VisibilityBuffer
from torchrender.effects.shadows.light_reach import shines
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP, looked_up
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender_service.renderers.streaming.layers import Layer
from torchrender_service.renderers.streaming.session import Made

COARSEST = 4.0
"""Pixels that a texel of a map of everything may be as wide as, where exact edges settle what it leaves open."""
COARSEST_OF_SUN = 1.5
"""The same of parallel light: leaves and blades out of doors are thinner than its texels."""
MOST_FINER = 0.95
"""Share of the pixels whose texels must be that fine."""
STEP = 8
"""Pixels along a side for each that is looked at."""


def with_maps_at_hand(scene: Scene, camera: Cameras, options: RenderOptions, past: RenderHistory) -> RenderOptions:
    """Shadows by the maps of everything that other pictures left, where none would have to be drawn for that and what
    one camera sees needs no finer ones."""
    past = past.of_scene(scene)
    lit, maps = past.scene, past.get(SCENE_SHADOW_MAP, options)
    if lit is None or maps is None or not options.shadows or options.shadow.edges != "exact":
        return options
    wanted = [made for light, made in zip(lit.lights, maps, strict=True) if shines(light) and looked_up(light, options)]
    if not all(made is not None for made in wanted):
        return options
    few = rasterize_visibility(scene.geometry, camera.scaled(1 / STEP))
    for made in wanted:
        assert made is not None
        if coarseness(made, camera, few) > (COARSEST_OF_SUN if made.cameras.orthographic else COARSEST):
            return options
    return replace(options, shadow=replace(options.shadow, coverage="scene"))


def coarseness(made: ShadowMap, camera: Cameras, few: VisibilityBuffer) -> float:
    """Width of a map's texels in pixels of a camera, where it sees them: all but a few of the pixels have finer ones.

    Args:
        few: what some of its pixels see.
    """
    near = few.covered
    if not bool(near.any()):
        return 0.0
    depth = few.depth[near].double()[None]
    points = few.cameras.unproject(few.cameras.pixel_centres().expand(*near.shape, 2)[near][None], depth)[0]
    first, away = made.cameras[0], torch.ones_like(depth)
    if not first.orthographic:  # from the face that looks there it is at most this far
        away = (points - first.eye[0].double()).norm(dim=-1)[None]
    return float((first.footprint(away) / camera.footprint(depth)).quantile(MOST_FINER))


def framed(made: Made, around: Made, rows: slice, columns: slice) -> Made:
    """A picture of what is shown of a view, within what is known of the margin."""

    def within(part: Tensor, outer: Tensor) -> Tensor:
        whole = outer.clone()
        whole[rows, columns] = part
        return whole

    outer, inner = around.mirrors, made.mirrors
    mirrors = outer
    if outer is not None and inner is not None:
        depth, radiance = within(inner.depth, outer.depth), within(inner.radiance, outer.radiance)
        mirrors = Layer(outer.camera, depth, radiance, within(inner.known, outer.known))
    radiance = within(made.image.radiance[0], around.image.radiance[0])
    image = replace(around.image, radiance=radiance[None], history=made.image.history, plan=made.image.plan)
    return replace(made, image=image, mirrors=mirrors)
