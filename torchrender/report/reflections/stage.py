"""One view of one scene, ready for its reflections to be made in several ways and compared."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import GBuffer, RayHits, ReflectionLayer, ShadowMap
from torchrender.clock import StepClock
from torchrender.effects.reflections.bounces import traced_onward
from torchrender.effects.reflections.clustered import (
    ClusteredReflections,
    ClusterOptions,
    clustered_onward,
    clustered_reflections,
)
from torchrender.effects.reflections.reflectors import (
    START,
    ReflectivePixels,
    blend_reflections,
    reflected_rays,
    reflective,
    reflective_pixels,
)
from torchrender.effects.reflections.traced import TraceOptions, environment_reflections, trace_reflections
from torchrender.effects.shadows.shadow_map import ShadowOptions, lights_visibility, render_shadow_map
from torchrender.kernels.rays.embree_library import embree
from torchrender.kernels.rays.plain_embree import PlainEmbree
from torchrender.kernels.rays.watertight import Rays
from torchrender.numerics.color import srgb_from_linear
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene
from torchrender.shade import shade


@dataclass(frozen=True, eq=False)
class Stage:
    """A view before reflections, one sample a pixel."""

    scene: Scene
    gbuffer: GBuffer
    direct: Tensor  # (1,H,W,3)
    shader: HitShader
    pixels: ReflectivePixels

    maps: list[ShadowMap]  # of the whole scene, one per light

    @classmethod
    def of(cls, scene: Scene, cameras: Cameras) -> Stage:
        """Draw, shadow and shade the view."""
        shadow = ShadowOptions()
        maps = [render_shadow_map(scene, light, shadow) for light in scene.lights]
        shader = hit_shader(scene, RenderOptions(shadow=shadow), maps)
        shader.environment(torch.tensor([[0.0, 1.0, 0.0]]))  # the cube map is drawn once, outside all times
        return cls._seen(scene, cameras, shader, maps)

    def seen_from(self, cameras: Cameras) -> Stage:
        """The same scene from elsewhere."""
        return self._seen(self.scene, cameras, self.shader, self.maps)

    @classmethod
    def _seen(cls, scene: Scene, cameras: Cameras, shader: HitShader, maps: list[ShadowMap]) -> Stage:
        gbuffer = rasterize(scene, cameras)
        direct = shade(scene, gbuffer, lights_visibility(scene, gbuffer, ShadowOptions(), maps))
        return cls(scene, gbuffer, direct, shader, reflective_pixels(scene, gbuffer), maps)

    def only(self, share: float) -> Stage:
        """The view with a share of its reflective pixels: the nearest to the picture's left border."""
        order = (self.pixels.pixel % self.pixels.shape[2]).argsort(stable=True)
        return replace(self, pixels=self.pixels.select(order[: round(share * len(order))].sort().values))

    @property
    def share(self) -> float:
        """Reflective pixels of all pixels."""
        return len(self.pixels) / self.gbuffer.triangle.numel()

    def clustered(self, options: ClusterOptions | None = None, bounces: int = 2) -> ClusteredReflections:
        """By clustered depth images; with ``missing="trace"`` a ray caster is built for the rest."""
        options = options or ClusterOptions()
        caster, scene, shader = None, self.scene, self.shader
        if options.missing == "trace":
            caster = RayCaster(scene.geometry)
            onward = traced_onward(caster, shader, bounces, options.lobe)
        else:
            onward = clustered_onward(scene, self.pixels.cameras, shader, options, bounces)
        made = None if caster is None else lambda: caster
        return clustered_reflections(
            scene, self.pixels, shader, options, direct=self.direct, caster=made, onward=onward
        )

    def traced(self, caster: RayCaster | None = None, rays: int = 8, bounces: int = 2) -> ReflectionLayer:
        """By rays; without a caster one is built, as for a scene that has just changed."""
        caster = caster or RayCaster(self.scene.geometry)
        return trace_reflections(caster, self.pixels, self.shader, TraceOptions(glossy_rays=rays, bounces=bounces))

    def preparations(self) -> dict[str, float]:
        """Milliseconds of what a changed scene needs beside trees: shadow maps, and the cube map of the guesses."""
        shadow, clock = ShadowOptions(), StepClock()
        with clock.measure("shadow maps"):
            maps = [render_shadow_map(self.scene, light, shadow) for light in self.scene.lights]
        shader = hit_shader(self.scene, RenderOptions(shadow=shadow), maps)
        with clock.measure("cube map"):
            shader.environment(torch.tensor([[0.0, 1.0, 0.0]]))
        return dict(clock.elapsed_ms)

    def environment(self) -> ReflectionLayer:
        """By the cube map alone."""
        return environment_reflections(self.pixels, self.shader)

    def traced_hits(self, caster: RayCaster) -> RayHits:
        """First hits of the mirrored rays."""
        return caster.first_hit(self.pixels.position, self.pixels.direction, t_min=START * self.scene.diagonal)

    @cached_property
    def true_hits(self) -> RayHits:
        """The same, found once."""
        return self.traced_hits(RayCaster(self.scene.geometry))

    @cached_property
    def reference_layer(self) -> ReflectionLayer:
        """Traced reflections."""
        return self.traced()

    @cached_property
    def reference(self) -> Tensor:
        """The picture with traced reflections."""
        return self.picture(self.reference_layer)

    def plain_embree(self) -> Callable[[], object] | None:
        """Build Embree's tree, trace in float32 through its C interface and shade; None where there is no Embree."""
        if embree() is None:
            return None
        geometry, rays = self.scene.geometry, reflected_rays(self.pixels)
        vertices, faces = view(geometry.vertices, np.float64), view(geometry.faces, np.int32)
        count = len(rays.origin)
        span = np.stack([np.full(count, START * self.scene.diagonal), np.full(count, np.inf)], axis=1)
        origin, direction = view(rays.origin, np.float64), view(rays.direction, np.float64)
        sent = Rays(origin, direction, span, np.full(count, -1, np.int32), False, False)

        def work() -> Tensor:
            t, triangle = (torch.from_numpy(a) for a in PlainEmbree(vertices, faces).cast(sent))
            hits = RayHits(torch.where(triangle >= 0, t.double(), torch.inf), triangle, torch.zeros(count, 2))
            return self.shader(rays, replace(hits, barycentric=_weights(geometry, rays.origin, rays.direction, hits)))

        return work

    def picture(self, layer: ReflectionLayer | None) -> Tensor:
        """(1,h,w,3) display values of the view with a layer."""
        radiance = self.direct if layer is None else blend_reflections(self.scene, self.gbuffer, self.direct, layer)
        return srgb_from_linear(radiance).clamp(0.0, 1.0)

    def mask(self) -> Tensor:
        """(1,h,w) bool: reflective pixels."""
        return reflective(self.scene, self.gbuffer)


def _weights(geometry: Geometry, origin: Tensor, direction: Tensor, hits: RayHits) -> Tensor:
    """Weights (N,2) of the second and third corner where rays hit; of a miss 0."""
    hit = (hits.triangle >= 0).nonzero().reshape(-1)
    a, b, c = geometry.vertices[geometry.faces[hits.triangle[hit]].long()].unbind(1)
    at = origin[hit] + hits.t[hit, None] * direction[hit] - a
    normal = torch.linalg.cross(b - a, c - a)
    size = normal.square().sum(-1).clamp_min(1e-300)
    second = (torch.linalg.cross(at, c - a) * normal).sum(-1) / size
    third = (torch.linalg.cross(b - a, at) * normal).sum(-1) / size
    return hits.barycentric.index_copy(0, hit, torch.stack([second, third], dim=-1).float())
