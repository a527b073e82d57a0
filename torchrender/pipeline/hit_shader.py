"""The colour of what rays hit, in the light of the main picture: its materials, textures, lights and shadows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import torch
from torch import Tensor

from torchrender.buffers import RayHits, RaySurface, ShadowMap
from torchrender.checks import ArrayLike, as_vector
from torchrender.effects.reflections.reflectors import ReflectedRays, blend_colors
from torchrender.effects.shadows.shadow_map import (
    ShadowOptions,
    lights_visibility,
    options_for,
    render_shadow_map,
    shadow_factor,
)
from torchrender.numerics.lobe import reflect
from torchrender.raster import rasterize
from torchrender.ray_surface import ray_surface
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.shade import shade, shade_hits

CUBE_SIZE = 128
"""Pixels along the edge of the cube map of the scene (specification 03, section 3)."""

# Right and down axis of each face in the order and orientation of OpenGL's cube maps.
_FACES = (
    ((0, 0, -1), (0, -1, 0)),
    ((0, 0, 1), (0, -1, 0)),
    ((1, 0, 0), (0, 0, 1)),
    ((1, 0, 0), (0, 0, -1)),
    ((1, 0, 0), (0, -1, 0)),
    ((-1, 0, 0), (0, -1, 0)),
)


class HitShader:
    """Shades the hits of rays into a scene; a :class:`torchrender.effects.reflections.reflectors.RayShader`.

    Args:
        shadow: None: every light reaches everything.
        shadow_maps: those that the main picture used, one per light; drawn here where missing.
        background: colour of what surrounds the scene; None: its environment, or its ambient light.
    """

    def __init__(
        self,
        scene: Scene,
        shadow: ShadowOptions | None = None,
        shadow_maps: Sequence[ShadowMap | None] | None = None,
        background: ArrayLike | None = None,
    ) -> None:
        self.scene = scene
        self.background = background
        # Cascades follow the eye's frustum, and reflected rays leave it: they get one map of everything.
        self._shadow = None if shadow is None else replace(shadow, cascades=1)
        maps = shadow_maps or [None] * len(scene.lights)
        cascaded = shadow is not None and shadow.cascades > 1
        self._maps = [
            None if cascaded and isinstance(light, DirectionalLight) else made
            for light, made in zip(scene.lights, maps, strict=True)
        ]

    def __call__(self, rays: ReflectedRays, hits: RayHits) -> Tensor:
        """Radiance (N,3) towards the rays' origins."""
        radiance = torch.zeros(len(hits.t), 3)
        rows = hits.hit.nonzero().reshape(-1)
        if len(rows):
            radiance[rows] = self._surfaces(rays, hits, rows)
        missed = (~hits.hit).nonzero().reshape(-1)
        if len(missed):
            radiance[missed] = self.surrounding(rays.direction[missed])
        return radiance

    def surrounding(self, direction: Tensor) -> Tensor:
        """Radiance (N,3) of what lies outside the scene, along unit directions (N,3)."""
        environment = self.scene.environment
        if self.background is None and environment is not None:
            return environment.lookup(direction.float())
        color = self.scene.ambient.float() if self.background is None else as_vector("background", self.background)
        return color.expand(len(direction), 3)

    def environment(self, direction: Tensor) -> Tensor:
        """Radiance (N,3) along unit directions (N,3) from the scene's centre, whatever stands there."""
        return self._cube.lookup(direction.float())

    def surroundings(self, position: Tensor, direction: Tensor) -> Tensor:
        """Radiance (N,3): what the centre sees of the place where each ray leaves the scene's bounding box.

        A look-up by direction alone would show a whole floor one place of a wall.
        """
        low, high = self.scene.bounds
        toward = torch.copysign(direction.double().abs().clamp_min(1e-9), direction.double())
        exit_length = torch.where(toward > 0, high - position, low - position) / toward
        reach = exit_length.amin(dim=-1).clamp_min(0.0)
        seen = position + reach[:, None] * toward - (low + high) / 2
        return self.environment(torch.nn.functional.normalize(seen, dim=-1, eps=1e-30))

    def _surfaces(self, rays: ReflectedRays, hits: RayHits, rows: Tensor) -> Tensor:
        found = RayHits(hits.t[rows], hits.triangle[rows], hits.barycentric[rows])
        direction = rays.direction[rows]
        width = rays.width[rows] + rays.spread[rows] * found.t
        surface = ray_surface(self.scene, rays.origin[rows], direction, found, width)
        radiance = shade_hits(self.scene, surface, self._visibility(surface))
        mirrors = self.scene.material_table.is_reflector[surface.material].nonzero().reshape(-1)
        if len(mirrors):
            normal = surface.normal[mirrors]
            onward = reflect(-surface.to_eye[mirrors], normal)
            # Without the growth towards grazing angles: a cube map is too coarse an answer to give it full weight.
            cosine = torch.ones(len(mirrors))
            mirrored = self.surroundings(surface.position[mirrors], onward)
            own, material = radiance[mirrors], surface.material[mirrors]
            radiance[mirrors] = blend_colors(self.scene, material, cosine, own, mirrored)
        return radiance

    def _visibility(self, surface: RaySurface) -> Tensor | None:
        """Shadow factors (L,N)."""
        if self._shadow is None or not self.scene.lights:
            return None
        points, normals = surface.position[None, None], surface.geometric_normal[None, None]
        self._draw_maps()
        factors = [
            shadow_factor(points, normals, light, made, options_for(light, self.scene, self._shadow))[0, 0]
            for light, made in zip(self.scene.lights, self._maps, strict=True)
            if made is not None
        ]
        return torch.stack(factors)

    def _draw_maps(self) -> None:
        for number, light in enumerate(self.scene.lights):
            if self._maps[number] is None:
                self._maps[number] = render_shadow_map(self.scene, light, self._shadow)

    @cached_property
    def _cube(self) -> Environment:
        """The scene as its centre sees it."""
        scene = self.scene
        centre = scene.bounds.mean(dim=0)
        matrices = torch.eye(4, dtype=torch.float64).repeat(6, 1, 1)
        for number, (right, down) in enumerate(_FACES):
            axes = torch.tensor([right, down], dtype=torch.float64)
            matrices[number, :3, :3] = torch.cat([axes, torch.linalg.cross(axes[:1], axes[1:])])
            matrices[number, :3, 3] = -matrices[number, :3, :3] @ centre
        half = CUBE_SIZE / 2
        intrinsics = torch.tensor([[half, 0, half], [0, half, half], [0, 0, 1]], dtype=torch.float64)
        near = torch.tensor(1e-3 * (scene.diagonal or 1.0), dtype=torch.float64)
        far = torch.tensor(torch.inf, dtype=torch.float64)
        cameras = Cameras(matrices, intrinsics.expand(6, 3, 3), CUBE_SIZE, CUBE_SIZE, near, far)
        gbuffer = rasterize(scene, cameras)
        visibility = None
        if self._shadow is not None and scene.lights:
            self._draw_maps()
            visibility = lights_visibility(scene, gbuffer, self._shadow, self._maps)
        return Environment.from_cube(shade(scene, gbuffer, visibility, background=self.background))
