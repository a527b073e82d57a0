"""What rays from mirrors show where see-through surfaces lie before what they hit."""

from __future__ import annotations

from functools import cached_property

import torch
from torch import Tensor

from torchrender.buffers import RayHits
from torchrender.effects.reflections.reflectors import Onward, RayShader, ReflectedRays
from torchrender.effects.transparency.layers import Rays, layers_along
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene


class BehindPanes:
    """A :class:`torchrender.effects.reflections.reflectors.RayShader` for rays that leave surfaces.

    Light of what they hit, or of what surrounds the scene, as far as see-through surfaces before it let it pass, and
    their own. Media are weighed by the whole way of a ray.

    Args:
        shader: shades what rays hit, solid or not.
        layers: see-through surfaces before each other that are looked at, at most.
    """

    def __init__(self, scene: Scene, shader: RayShader, *, layers: int = 64) -> None:
        self._scene, self._shader, self._layers = scene, shader, layers

    @cached_property
    def _panes(self) -> RayCaster:
        """Sorted for the first ray: surroundings alone need none."""
        return RayCaster(self._scene.geometry.panes)

    def __call__(self, rays: ReflectedRays, hits: RayHits, onward: Onward | None = None) -> Tensor:
        """Radiance (N,3) towards the rays' origins."""
        behind = self._shader(rays, hits, onward)

        def light(origins: Tensor, directions: Tensor, width: Tensor, hits: RayHits) -> Tensor:
            return self._shader(ReflectedRays(origins, directions, width, torch.zeros_like(width), rays.many), hits)

        through = Rays(rays.origin, rays.direction, rays.width, rays.spread, max(len(behind), 1))
        own, passing = layers_along(self._scene, self._panes, through, hits.t, light, layers=self._layers)
        return torch.addcmul(own, behind, passing)

    def environment(
        self,
        direction: Tensor,
        eyes: Tensor | None = None,
        spread: Tensor | None = None,
        leaving: tuple[Tensor, Tensor] | None = None,
    ) -> Tensor:
        """As of the shader: no ray is cast there."""
        return self._shader.environment(direction, eyes, spread, leaving)

    def surroundings(self, position: Tensor, direction: Tensor, eyes: Tensor | None = None) -> Tensor:
        """As of the shader: no ray is cast there."""
        return self._shader.surroundings(position, direction, eyes)
