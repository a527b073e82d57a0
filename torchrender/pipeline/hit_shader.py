"""The colour of what rays hit, in the light of the main picture."""

from __future__ import annotations

from functools import cached_property

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.checks import ArrayLike, as_vector
from torchrender.effects.reflections.reflectors import ReflectedRays, blend_colors
from torchrender.numerics.lobe import reflect
from torchrender.pipeline.frame import SampleRenderer
from torchrender.raster import rasterize
from torchrender.ray_surface import ray_surface
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.model import Scene

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
        light: the passes of the picture over other samples, reflections left out.
        background: colour of what surrounds the scene; None: its environment, or its ambient light.
    """

    def __init__(self, scene: Scene, light: SampleRenderer, background: ArrayLike | None = None) -> None:
        self.scene = scene
        self.background = background
        self._light = light

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
        radiance = self._light(surface.image)[0, 0]
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
        return Environment.from_cube(self._light(rasterize(scene, cameras)))
