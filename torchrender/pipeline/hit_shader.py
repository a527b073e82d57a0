"""The colour of what rays hit, in the light of the main picture."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.buffers import RayHits, RaySurface
from torchrender.checks import ArrayLike, as_vector
from torchrender.effects.reflections.reflectors import (
    MirroredPoints,
    Onward,
    ReflectedRays,
    mirrored_direction,
)
from torchrender.pipeline.frame import SampleRenderer
from torchrender.pipeline.hit_memory import HitMemory, keys_of
from torchrender.pipeline.scene_cube import OWN_SIZE, SceneCube, Solid, Solids, make_cube
from torchrender.pipeline.sky_pyramid import SkyPyramid
from torchrender.scene.model import Scene
from torchrender.shading.mirrors import mirror_values
from torchrender.shading.ray_surface import ray_surface

OWN_SHARE = 0.25
"""Share of the rays from which on the object that they leave is looked around from: four maps at most. Of many small
reflectors the scene's middle tells nearly as much, and the maps of each would take most of the time."""


class HitShader:
    """Shades the hits of rays into a scene; a :class:`torchrender.effects.reflections.reflectors.RayShader`.

    Args:
        light: the passes of the picture over other samples, reflections left out.
        background: colour of what surrounds the scene; None: its environment, or its ambient light.
        light_of_many: the same for rays of which several count together: noise is no harm. None: ``light``.
        light_around: the same for what the scene's middle sees all around, a guess as it is. None: ``light``.
        memory: light of hits that need not be found anew. None: nothing is remembered.
    """

    def __init__(
        self,
        scene: Scene,
        light: SampleRenderer,
        background: ArrayLike | None = None,
        light_of_many: SampleRenderer | None = None,
        light_around: SampleRenderer | None = None,
        memory: HitMemory | None = None,
    ) -> None:
        self.scene = scene
        self.background = background
        self.memory = memory
        self.look: tuple[Any, ...] = ()  # what else the light comes from, to be compared
        self._light = light
        self._light_of_many = light if light_of_many is None else light_of_many
        self._light_around = light if light_around is None else light_around
        self._cubes: dict[tuple[int, tuple[int, ...]], SceneCube] = {}
        self._reflectors: dict[int, Solid | None] = {}

    def __call__(self, rays: ReflectedRays, hits: RayHits, onward: Onward | None = None) -> Tensor:
        """Radiance (N,3) towards the rays' origins; ``onward`` knows what mirrors among the hits show."""
        radiance = torch.zeros(len(hits.t), 3)
        rows = hits.hit.nonzero().reshape(-1)
        if len(rows):
            radiance[rows] = self._surfaces(rays, hits, rows, onward)
        missed = (~hits.hit).nonzero().reshape(-1)
        if len(missed):
            radiance[missed] = self.surrounding(rays.direction[missed], rays.spread[missed])
        return radiance

    def surrounding(self, direction: Tensor, spread: Tensor | None = None) -> Tensor:
        """Radiance (N,3) of what lies outside the scene, along unit directions (N,3) of rays that ``spread`` (N,)."""
        environment = self.scene.environment
        if self.background is None and environment is not None:
            if spread is None:
                return environment.lookup(direction.float())
            return self._sky.lookup(direction, spread)
        color = self.scene.ambient.float() if self.background is None else as_vector("background", self.background)
        return color.expand(len(direction), 3)

    def environment(
        self,
        direction: Tensor,
        eyes: Tensor | None = None,
        spread: Tensor | None = None,
        leaving: tuple[Tensor, Tensor] | None = None,
    ) -> Tensor:
        """Radiance (N,3) along unit directions (N,3) from the scene's middle, closed objects there left out.

        What holds one of the ``eyes`` (B,3) of the picture is a room, and stays. What lies outside the scene is seen as
        blurred as the rays ``spread`` (N,).

        Args:
            leaving: places (N,3) where the rays start, and objects (N,) that they leave: those that most rays leave are
                looked around from, and see all but themselves. None: as if everything were infinitely far away.
        """
        outside = self.surrounding(direction, spread)
        if leaving is None:
            return self._cube(eyes).lookup(direction, outside)
        place, owner = leaving
        seen, of_middle = outside.clone(), torch.ones(len(owner), dtype=torch.bool)
        for number in self._looked_from(owner, eyes):
            rows = (owner == number).nonzero().reshape(-1)
            of_middle[rows] = False
            cube = self._cube(eyes, self._reflectors[number])
            seen[rows] = cube.lookup(direction[rows], outside[rows], place[rows])
        rows = of_middle.nonzero().reshape(-1)
        if len(rows):
            seen[rows] = self._cube(eyes).lookup(direction[rows], outside[rows], place[rows])
        return seen

    def surroundings(self, position: Tensor, direction: Tensor, eyes: Tensor | None = None) -> Tensor:
        """Radiance (N,3): what the middle sees of the place where each ray leaves the scene's bounding box.

        A look-up by direction alone would show a whole floor one place of a wall.
        """
        low, high = self.scene.bounds
        toward = torch.copysign(direction.double().abs().clamp_min(1e-9), direction.double())
        exit_length = torch.where(toward > 0, high - position, low - position) / toward
        reach = exit_length.amin(dim=-1).clamp_min(0.0)
        seen = position + reach[:, None] * toward - (low + high) / 2
        seen = torch.nn.functional.normalize(seen, dim=-1, eps=1e-30)
        return self._cube(eyes).lookup(seen, self.surrounding(direction))

    def _surfaces(self, rays: ReflectedRays, hits: RayHits, rows: Tensor, onward: Onward | None) -> Tensor:
        memory = self.memory
        if memory is None:
            return self._shaded(rays, hits, rows, onward)[0]
        key = keys_of(rays, hits, rows)
        known, radiance = memory.find(key)
        new = torch.ones(len(rows), dtype=torch.bool)
        new[known] = False
        rest = new.nonzero().reshape(-1)
        found = torch.zeros(len(rows), 3).index_copy(0, known, radiance)
        if len(rest):
            shaded, mirrors = self._shaded(rays, hits, rows[rest], onward)
            found = found.index_copy(0, rest, shaded)
            new[:] = True
            new[rest[mirrors]] = False  # what these show changes with other places
            known = new.nonzero().reshape(-1)
        place = rays.origin[rows[known]] + hits.t[rows[known], None] * rays.direction[rows[known]]
        memory.add(key[known], place, hits.triangle[rows[known]].long(), found[known])
        return found

    def _shaded(self, rays: ReflectedRays, hits: RayHits, rows: Tensor, onward: Onward | None) -> tuple[Tensor, Tensor]:
        """Radiance (N,3) of hits, and the numbers of those that mirror."""
        found = RayHits(hits.t[rows], hits.triangle[rows], hits.barycentric[rows])
        direction = rays.direction[rows]
        width = rays.width[rows] + rays.spread[rows] * found.t
        surface = ray_surface(self.scene, rays.origin[rows], direction, found, width)
        image = surface.image
        sent = self._light_of_many(image) if rays.many else self._light(image)
        radiance = sent.radiance[0, 0]
        mirrors = self.scene.material_table.is_reflector[surface.material].nonzero().reshape(-1)
        if not len(mirrors):
            return radiance, mirrors
        leaving = (width[mirrors], rays.spread[rows][mirrors], rays.many)
        points = _mirrored(self.scene, surface, mirrors, found, leaving)
        if onward is None:
            shown = self.surroundings(points.rays.origin, points.rays.direction)
        else:
            shown = onward(points)
        replaced, weight = (part[0, 0, mirrors] for part in (sent.share.replaced, sent.share.mirrored))
        seen = (radiance[mirrors] - replaced + weight * shown).clamp_min(0.0)
        return radiance.index_copy(0, mirrors, seen), mirrors

    @cached_property
    def _sky(self) -> SkyPyramid:
        """The environment at several resolutions."""
        assert self.scene.environment is not None
        return SkyPyramid.of(self.scene.environment)

    @cached_property
    def _solids(self) -> Solids:
        return Solids.of(self.scene.geometry)

    @cached_property
    def _enclosing(self) -> dict[int, tuple[Solid, ...]]:
        """What the middle of the scene (-1), and those of reflectors, do not see from inside, but for eyes in it."""
        return {-1: self._solids.around(self.scene.bounds.mean(dim=0))}

    @property
    def looked_around(self) -> bool:
        """The scene was drawn from its middle, or from that of a reflector."""
        return bool(self._cubes)

    def unseen(self, owner: Tensor, eyes: Tensor | None = None) -> bool:
        """Something has yet to be drawn before rays that leave the objects (N,) know their environment."""
        own = self._looked_from(owner, eyes)
        found = [self._key(eyes, self._reflectors[number]) for number in own]
        if not bool(torch.isin(owner, torch.tensor(own, dtype=owner.dtype)).all()):
            found.append(self._key(eyes))
        return any(key not in self._cubes for key in found)

    def _looked_from(self, owner: Tensor, eyes: Tensor | None) -> list[int]:
        """Reflectors among objects (N,) that rays leave whose own middles look around: those most seen."""
        numbers, counts = owner.unique(return_counts=True)
        found = []
        for number in numbers[counts >= OWN_SHARE * len(owner)].tolist():
            if number not in self._reflectors:
                self._reflectors[number] = self._solids.reflector(number)
            own = self._reflectors[number]
            if own is not None and (eyes is None or not own.holds(eyes.double())):
                found.append(number)
        return found

    def _key(self, eyes: Tensor | None, own: Solid | None = None) -> tuple[int, tuple[int, ...]]:
        """The middle from which is seen, -1: the scene's, and what is left out."""
        number = -1 if own is None else own.number
        if own is not None and number not in self._enclosing:
            self._enclosing[number] = self._solids.around((own.low + own.high) / 2)
        around = [one.number for one in self._enclosing[number] if eyes is None or not one.holds(eyes.double())]
        return number, tuple(sorted({*around, *([] if own is None else [number])}))

    def _cube(self, eyes: Tensor | None, own: Solid | None = None) -> SceneCube:
        """The scene as its middle sees it, or that of a reflector."""
        key = self._key(eyes, own)
        if key not in self._cubes:
            some = torch.tensor(key[1], dtype=torch.int64)
            size = OWN_SIZE if own is not None and self._several else None
            self._cubes[key] = make_cube(self.scene, self._light_around, self.surrounding, some, own, size)
        return self._cubes[key]

    @cached_property
    def _several(self) -> bool:
        """More than one object mirrors."""
        geometry = self.scene.geometry
        mirrors = self.scene.material_table.is_reflector[geometry.material]
        return len(geometry.object_id[mirrors].unique()) > 1


def _mirrored(
    scene: Scene, surface: RaySurface, rows: Tensor, hits: RayHits, size: tuple[Tensor, Tensor, bool]
) -> MirroredPoints:
    """The mirrors among what rays hit, and the rays that leave them: ``size`` = their width, spread, and if many."""
    normal, gloss = mirror_values(scene, surface, rows)
    normal, flat = normalize(normal.double(), dim=-1, eps=1e-30), surface.geometric_normal[rows].double()
    arriving = -surface.to_eye[rows].double()
    return MirroredPoints(
        rays=ReflectedRays(surface.position[rows], mirrored_direction(arriving, normal, flat), *size),
        normal=normal,
        geometric_normal=flat,
        arriving=arriving,
        length=hits.t[rows],
        gloss=gloss,
        object_id=scene.geometry.object_id[hits.triangle[rows]],
    )
