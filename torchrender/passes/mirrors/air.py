"""What media put before places that rays reach, whatever these left: panes, and mirrors seen in mirrors."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import RayHits, ShadowMap
from torchrender.effects.media.eye_rays import rays_along
from torchrender.effects.media.in_view import boxes_of
from torchrender.effects.media.scatter import Illumination, scatter_along
from torchrender.effects.media.surroundings import Surroundings
from torchrender.effects.media.tables import MediaTable
from torchrender.effects.reflections.reflectors import MirroredPoints, Onward, RayShader, ReflectedRays
from torchrender.passes.contract import Buffers
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP
from torchrender.passes.outlook import Outlook, no_shadows
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene


def shadows_in_air(outlook: Outlook) -> Buffers:
    """What tells where lights reach the media: their depth images, or rays."""
    if no_shadows(outlook) is not None:
        return ()
    shadows = outlook.options.scattering.shadows
    if shadows == "rays":
        return (RAY_CASTER,)
    return (SCENE_SHADOW_MAP,) if shadows == "maps" else ()


def illumination_of(frame: Frame) -> Illumination:
    """What lights the media of a picture.

    Maps of the picture follow the eye along surfaces; what floats before it may lie beside them.
    """
    caster = frame.get(RAY_CASTER) if frame.options.scattering.shadows == "rays" else None
    return lit_by(frame.scene, frame.get(SCENE_SHADOW_MAP), caster)


def lit_by(scene: Scene, maps: tuple[ShadowMap | None, ...] | None, caster: RayCaster | None = None) -> Illumination:
    """The lights of a scene and what comes from everywhere."""
    return Illumination(
        lights=scene.lights,
        shadow_maps=tuple(maps or (None,) * len(scene.lights)),
        caster=caster,
        surroundings=Surroundings.of(scene.ambient, scene.environment),
        size=scene.diagonal,
    )


def air_along(
    frame: Frame, illumination: Illumination, origin: Tensor, direction: Tensor, length: Tensor
) -> tuple[Tensor, Tensor] | None:
    """Transmittance and scattered light, each (N,3), along any N rays of one picture; None: they meet no medium."""
    if not len(origin):
        return None
    table = MediaTable.of(frame.scene.media, origin.mean(dim=0))
    rays = rays_along(origin, direction, length, table)
    if not bool((rays.length > 0).any()):
        return None
    passed, added, _ = scatter_along(rays, table, illumination, replace(frame.options.scattering, block=1))
    return passed[0], added[0]


def before_mirrors(scene: Scene, options: RenderOptions) -> bool:
    """Media may lie between mirrors and what they show, and are to be seen there."""
    return options.media and options.scattering.air and len(boxes_of(scene.media)) > 0


class InAir:
    """A :class:`torchrender.effects.reflections.reflectors.RayShader` with the media on the way of each ray.

    For rays that leave mirrors seen in mirrors: what stands before a mirror that the eye sees is reckoned with where
    the picture is put together, once for all rays of a pixel.
    """

    def __init__(self, frame: Frame, shader: RayShader) -> None:
        self._frame, self._shader, self._illumination = frame, shader, illumination_of(frame)

    def __call__(self, rays: ReflectedRays, hits: RayHits, onward: Onward | None = None) -> Tensor:
        """Radiance (N,3) towards the rays' origins; without ``onward`` further mirrors show the guess."""
        seen = self._shader(rays, hits, self.guess if onward is None else onward)
        return self._through(rays.origin, rays.direction, hits.t, seen)

    def guess(self, points: MirroredPoints) -> Tensor:
        """Radiance (N,3) that mirrors show where nobody follows light any further."""
        return self.surroundings(points.rays.origin, points.rays.direction)

    def environment(
        self,
        direction: Tensor,
        eyes: Tensor | None = None,
        spread: Tensor | None = None,
        leaving: tuple[Tensor, Tensor] | None = None,
    ) -> Tensor:
        """As of the shader: such rays start nowhere."""
        return self._shader.environment(direction, eyes, spread, leaving)

    def surroundings(self, position: Tensor, direction: Tensor, eyes: Tensor | None = None) -> Tensor:
        """Radiance (N,3) as of the shader, beyond all media on the way."""
        seen = self._shader.surroundings(position, direction, eyes)
        return self._through(position, direction, torch.full((len(position),), torch.inf), seen)

    def _through(self, origin: Tensor, direction: Tensor, length: Tensor, seen: Tensor) -> Tensor:
        found = air_along(self._frame, self._illumination, origin, direction, length)
        return seen if found is None else torch.addcmul(found[1], found[0], seen)
