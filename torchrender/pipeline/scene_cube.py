"""What the middle of a scene, or of a reflector, sees all around: a guess at what arrives along rays.

A closed object in the middle would show its inside, and a reflector itself: what encloses the middle is left out, and
so is the reflector, as if they were not there. What holds the eye, or other objects, is a room and stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.reflections.reflectors import blend_reflections, reflection_layer, reflective_pixels
from torchrender.numerics.winding import winding_number
from torchrender.pipeline.frame import SampleRenderer
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

CUBE_SIZE = 128
"""Pixels along the edge of the cube map of the scene (specification 03, section 3)."""

OWN_SIZE = 64
"""Pixels along the edge of one reflector's cube map, where there are several: four are drawn like one of the scene."""

FOLLOWED = 4
"""Steps towards the place that a ray from beside the middle reaches."""

FLAT = 0.05
"""Least share of its longest side that a reflector is thick, to have a middle of its own: another may stand on it."""

MIRRORED_TWICE = 2
"""How often mirrors in the cube map are lit: by what surrounds the scene, then by the cube map itself."""

_INSIDE = 0.5  # winding number from which on a point is inside
_SAMPLES = 32  # other objects that are looked for inside one

# Right and down axis of each face in the order of OpenGL's cube maps, whose pictures are these seen in a mirror: their
# columns run the other way.
_FACES = (
    ((0, 0, 1), (0, -1, 0)),
    ((0, 0, -1), (0, -1, 0)),
    ((-1, 0, 0), (0, 0, 1)),
    ((-1, 0, 0), (0, 0, -1)),
    ((-1, 0, 0), (0, -1, 0)),
    ((1, 0, 0), (0, -1, 0)),
)

Surrounding = Callable[[Tensor], Tensor]
"""Radiance (N,3) of what lies outside the scene, along unit directions (N,3)."""


@dataclass(frozen=True, eq=False)
class SceneCube:
    """Radiance by direction from one place, and where a surface is seen at all."""

    radiance: Environment
    covered: Environment
    place: Tensor  # (3,) float64
    distance: Tensor  # (6,N,N) float32 of surfaces from there; +inf where none is seen

    @classmethod
    def of(cls, radiance: Tensor, seen: GBuffer, place: Tensor) -> SceneCube:
        """From pictures of the faces and what is seen in them."""
        size = seen.covered.shape[-1]
        across = (torch.arange(size) + 0.5) * (2.0 / size) - 1.0
        longer = (1.0 + across.square()[:, None] + across.square()).sqrt()
        covered = seen.covered.float()[..., None].expand(*seen.covered.shape, 3)
        distance = torch.where(seen.covered, seen.depth.float() * longer, torch.inf)
        return cls(_environment(radiance), _environment(covered), place, distance.flip(2).contiguous())

    def lookup(self, direction: Tensor, outside: Tensor, position: Tensor | None = None) -> Tensor:
        """Radiance (N,3) along unit directions (N,3); ``outside`` (N,3) where no surface is seen there.

        Args:
            position: (N,3) where the rays start; None: in the map's own place.
        """
        direction = direction.float()
        if not self.shows_something:
            return outside
        if position is not None:
            direction = self.towards((position - self.place).float(), direction)
        return torch.lerp(outside, self.radiance.lookup(direction), self.covered.lookup(direction))

    @cached_property
    def shows_something(self) -> bool:
        """A surface is seen in some direction."""
        return bool(torch.isfinite(self.distance).any())

    def towards(self, start: Tensor, direction: Tensor) -> Tensor:
        """Unit directions (N,3) of the map in which it shows what rays reach that start beside its place, (N,3).

        A surface is taken for a sphere about the map's place as large as it is far in the direction that was last
        found. Source: Szirmay-Kalos et al., Approximate ray-tracing on the GPU with distance impostors, 2005.
        """
        along = (start * direction).sum(-1)
        inside = along.square() - start.square().sum(-1)
        faces, found = self.distance.reshape(-1), direction
        for _ in range(FOLLOWED):
            distance = faces[cube_texel(found, self.distance.shape[-1])]
            length = (inside + distance.square()).clamp_min(0.0).sqrt() - along
            reached = torch.addcmul(start, length.clamp_min(0.0)[:, None], direction)
            reached = torch.nn.functional.normalize(reached, dim=-1, eps=1e-30)
            found = torch.where(torch.isfinite(distance)[:, None], reached, direction)
        return found


def make_cube(
    scene: Scene,
    light: SampleRenderer,
    surrounding: Surrounding,
    left_out: Tensor,
    own: Solid | None = None,
    size: int | None = None,
) -> SceneCube:
    """Draw the scene around its middle, or around that of one of its objects.

    Args:
        light: shades what is seen, reflections left out; these come from ``surrounding``, then from the cube itself.
        left_out: (K,) objects that are not drawn.
        own: object around whose middle it is; None: the scene's.
        size: pixels along the edges; None: ``CUBE_SIZE``.
    """
    low, high = scene.bounds if own is None else (own.low, own.high)
    place = (low + high) / 2
    near = 1e-3 * (float((high - low).norm()) or scene.diagonal or 1.0)
    seen = rasterize(_without(scene, left_out), _cameras(place, near, CUBE_SIZE if size is None else size))
    sent = light(seen)
    direct = sent.radiance
    cube = SceneCube.of(direct, seen, place)
    pixels = reflective_pixels(scene, seen)
    if not len(pixels):
        return cube
    state = torch.full((len(pixels),), 1)
    far = torch.full((len(pixels),), torch.inf)
    around = surrounding(pixels.direction)
    mirrored = around
    for _ in range(MIRRORED_TWICE):
        layer = replace(reflection_layer(pixels, mirrored, far, state), share=sent.share)
        cube = replace(cube, radiance=_environment(blend_reflections(scene, seen, direct, layer)))
        mirrored = cube.lookup(pixels.direction, around, pixels.position)
    return cube


def _environment(faces: Tensor) -> Environment:
    """Pictures (6,N,N,3) of the cameras as a map by direction."""
    return Environment.from_cube(faces.flip(2), height=2 * faces.shape[1])


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed object: its number, the corners (F,3,3) of its triangles, and its box."""

    number: int
    corners: Tensor
    low: Tensor  # (3,) float64
    high: Tensor

    def holds(self, points: Tensor) -> bool:
        """Any of the points (N,3) float64 is inside; outside its box none is."""
        near = points[((self.low <= points) & (points <= self.high)).all(-1)]
        return len(near) > 0 and bool((winding_number(self.corners, near).abs() > _INSIDE).any())


@dataclass(frozen=True, eq=False)
class Solids:
    """The objects of a scene, and which of them are left out where."""

    geometry: Geometry
    low: Tensor  # (K,3) float64 box of each object; +inf where there is none
    high: Tensor  # (K,3)

    @classmethod
    def of(cls, geometry: Geometry) -> Solids:
        """With the boxes of all objects."""
        owner = geometry.object_id[geometry.order[geometry.clusters[:, 0]].long()]
        boxes = geometry.cluster_bounds
        count = int(owner.max()) + 1 if len(owner) else 0
        low = torch.full((count, 3), torch.inf, dtype=torch.float64)
        high = torch.full((count, 3), -torch.inf, dtype=torch.float64)
        rows = owner[:, None].expand(-1, 3)
        return cls(
            geometry,
            low.scatter_reduce(0, rows, boxes[:, 0], "amin"),
            high.scatter_reduce(0, rows, boxes[:, 1], "amax"),
        )

    def around(self, place: Tensor) -> tuple[Solid, ...]:
        """Objects that enclose a place (3,) and hold no other object."""
        found = []
        for number in ((self.low < place) & (place < self.high)).all(-1).nonzero().reshape(-1).tolist():
            solid = self.solid(number)
            if solid.holds(place[None].double()) and not self.holds_others(solid):
                found.append(solid)
        return tuple(found)

    def solid(self, number: int) -> Solid:
        """One of the objects."""
        corners = self.geometry.vertices[self.geometry.faces[self.geometry.object_id == number].long()]
        return Solid(number, corners, self.low[number], self.high[number])

    def holds_others(self, solid: Solid) -> bool:
        """The object is around some other one: a room."""
        held = ((solid.low <= self.low) & (self.high <= solid.high) & (self.low <= self.high)).all(-1)
        held[solid.number] = False
        return solid.holds((self.low + self.high)[held][:_SAMPLES] / 2)

    def reflector(self, number: int) -> Solid | None:
        """An object that has a middle of its own to look around from, itself left out; None: a sheet or a room."""
        solid = self.solid(number)
        sides = solid.high - solid.low
        if not float(sides.amin()) > FLAT * float(sides.amax()) or self.holds_others(solid):
            return None
        return solid


def _without(scene: Scene, left_out: Tensor) -> Scene:
    """The scene without some objects; materials and lights are the same."""
    if not len(left_out):
        return scene
    rest = replace(scene)
    rest.__dict__["geometry"] = scene.geometry.part(~torch.isin(scene.geometry.object_id, left_out))
    return rest


def cube_texel(direction: Tensor, size: int) -> Tensor:
    """(N,) int64 number of the texel that directions (N,3) meet among those of six faces (6,size,size)."""
    axis = direction.abs().argmax(dim=-1)
    x, y, z = direction.unbind(-1)
    major = direction.gather(-1, axis[:, None])[:, 0]
    s = torch.where(axis == 0, -z, x) / torch.where(axis == 1, major.abs(), major)
    t = torch.where(axis == 1, z / major, -y / major.abs())
    column, row = (((v + 1.0) * (size / 2)).long().clamp(0, size - 1) for v in (s, t))
    return ((2 * axis + (major < 0)) * size + row) * size + column


def _cameras(place: Tensor, nearest: float, size: int) -> Cameras:
    matrices = torch.eye(4, dtype=torch.float64).repeat(6, 1, 1)
    for number, (right, down) in enumerate(_FACES):
        axes = torch.tensor([right, down], dtype=torch.float64)
        matrices[number, :3, :3] = torch.cat([axes, torch.linalg.cross(axes[:1], axes[1:])])
        matrices[number, :3, 3] = -matrices[number, :3, :3] @ place
    half = size / 2
    intrinsics = torch.tensor([[half, 0, half], [0, half, half], [0, 0, 1]], dtype=torch.float64)
    near, far = (torch.tensor(value, dtype=torch.float64) for value in (nearest, torch.inf))
    return Cameras(matrices, intrinsics.expand(6, 3, 3), size, size, near, far)
