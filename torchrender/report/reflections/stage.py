"""One view of one scene, ready for its reflections to be made in several ways and compared."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import GBuffer, RayHits, ReflectionLayer
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
from torchrender.kernels.compile import thread_count
from torchrender.numerics.color import srgb_from_linear
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import shade


@dataclass(frozen=True, eq=False)
class Stage:
    """A view before reflections. ``supersample`` samples along each pixel side are averaged in pictures."""

    scene: Scene
    gbuffer: GBuffer
    direct: Tensor  # (1,H,W,3)
    shader: HitShader
    pixels: ReflectivePixels
    supersample: int

    @classmethod
    def of(cls, scene: Scene, cameras: Cameras, supersample: int = 1) -> Stage:
        """Draw, shadow and shade the view."""
        gbuffer = rasterize(scene, cameras.scaled(supersample) if supersample > 1 else cameras)
        shadow = ShadowOptions()
        maps = [render_shadow_map(scene, light, shadow) for light in scene.lights]
        direct = shade(scene, gbuffer, lights_visibility(scene, gbuffer, shadow, maps))
        shader = hit_shader(scene, RenderOptions(shadow=shadow), maps)
        shader.environment(torch.tensor([[0.0, 1.0, 0.0]]))  # the cube map is drawn once, outside all times
        return cls(scene, gbuffer, direct, shader, reflective_pixels(scene, gbuffer), supersample)

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
        """Build Embree's tree, trace in float32 and shade, without the float64 test; None without embreex."""
        try:
            from embreex import mesh_construction, rtcore_scene
        except ImportError:
            return None
        geometry, rays = self.scene.geometry, reflected_rays(self.pixels)
        origin = view(rays.origin + START * self.scene.diagonal * rays.direction, np.float32)
        direction = view(rays.direction, np.float32)

        def work() -> Tensor:
            corners = geometry.vertices[geometry.faces.long()].float().numpy()
            scene = rtcore_scene.EmbreeScene()
            mesh = mesh_construction.TriangleMesh(scene, corners)
            scene.run(origin[:1].copy(), direction[:1].copy())
            parts = np.array_split(np.arange(len(origin)), max(1, len(origin) >> 13))
            with ThreadPoolExecutor(thread_count()) as pool:
                found = list(pool.map(lambda p: scene.run(origin[p], direction[p], output=True), parts))
            joined = {name: np.concatenate([f[name] for f in found]) for name in ("primID", "tfar", "u", "v")}
            del mesh
            triangle = torch.from_numpy(joined["primID"].astype(np.int64))
            t = torch.where(triangle >= 0, torch.from_numpy(joined["tfar"].astype(np.float64)), torch.inf)
            weights = torch.from_numpy(np.stack([joined["u"], joined["v"]], axis=1).astype(np.float32))
            return self.shader(rays, RayHits(t, triangle, weights))

        return work

    def picture(self, layer: ReflectionLayer | None) -> Tensor:
        """(1,h,w,3) display values of the view with a layer."""
        radiance = self.direct if layer is None else blend_reflections(self.scene, self.gbuffer, self.direct, layer)
        return srgb_from_linear(self._mean(radiance)).clamp(0.0, 1.0)

    def mask(self) -> Tensor:
        """(1,h,w) bool: a pixel with a reflective sample."""
        return self._mean(reflective(self.scene, self.gbuffer)[..., None].float())[..., 0] > 0

    def _mean(self, image: Tensor) -> Tensor:
        count, height, width, depth = image.shape
        n = self.supersample
        return image.reshape(count, height // n, n, width // n, n, depth).mean(dim=(2, 4))
