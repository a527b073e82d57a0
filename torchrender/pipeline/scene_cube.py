"""What the middle of a scene sees all around: a guess at what arrives along rays that nothing answers.

A closed object in the middle would show its inside: what encloses the middle is left out, as if the object that
mirrors were not there. What holds the eye, or other objects, is a room and stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

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

MIRRORED_TWICE = 2
"""How often mirrors in the cube map are lit: by what surrounds the scene, then by the cube map itself."""

_INSIDE = 0.5  # winding number from which on a point is inside
_SAMPLES = 32  # other objects that are looked for inside one

# Right and down axis of each face in the order and orientation of OpenGL's cube maps.
_FACES = (
    ((0, 0, -1), (0, -1, 0)),
    ((0, 0, 1), (0, -1, 0)),
    ((1, 0, 0), (0, 0, 1)),
    ((1, 0, 0), (0, 0, -1)),
    ((1, 0, 0), (0, -1, 0)),
    ((-1, 0, 0), (0, -1, 0)),
)

Surrounding = Callable[[Tensor], Tensor]
"""Radiance (N,3) of what lies outside the scene, along unit directions (N,3)."""


@dataclass(frozen=True, eq=False)
class SceneCube:
    """Radiance by direction from the scene's middle, and where a surface is seen at all."""

    radiance: Environment
    covered: Environment

    def lookup(self, direction: Tensor, outside: Tensor) -> Tensor:
        """Radiance (N,3) along unit directions (N,3); ``outside`` (N,3) where no surface is seen there."""
        direction = direction.float()
        return torch.lerp(outside, self.radiance.lookup(direction), self.covered.lookup(direction))


def make_cube(scene: Scene, light: SampleRenderer, surrounding: Surrounding, left_out: Tensor) -> SceneCube:
    """Draw the scene around its middle.

    Args:
        light: shades what is seen, reflections left out; these come from ``surrounding``, then from the cube itself.
        left_out: (K,) objects that are not drawn.
    """
    seen = rasterize(_without(scene, left_out), _cameras(scene))
    covered = Environment.from_cube(seen.covered.float()[..., None].expand(*seen.covered.shape, 3))
    sent = light(seen)
    direct = sent.radiance
    pixels = reflective_pixels(scene, seen)
    cube = SceneCube(Environment.from_cube(direct), covered)
    if not len(pixels):
        return cube
    state = torch.full((len(pixels),), 1)
    far = torch.full((len(pixels),), torch.inf)
    around = surrounding(pixels.direction)
    mirrored = around
    for _ in range(MIRRORED_TWICE):
        layer = replace(reflection_layer(pixels, mirrored, far, state), share=sent.share)
        cube = replace(cube, radiance=Environment.from_cube(blend_reflections(scene, seen, direct, layer)))
        mirrored = cube.lookup(pixels.direction, around)
    return cube


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


def middle_solids(geometry: Geometry) -> tuple[Solid, ...]:
    """Objects that enclose the middle of the scene and hold no other object."""
    middle = geometry.bounds.mean(dim=0)
    owner = geometry.object_id[geometry.order[geometry.clusters[:, 0]].long()]
    boxes = geometry.cluster_bounds
    count = int(owner.max()) + 1 if len(owner) else 0
    low = torch.full((count, 3), torch.inf, dtype=torch.float64)
    high = torch.full((count, 3), -torch.inf, dtype=torch.float64)
    rows = owner[:, None].expand(-1, 3)
    low, high = low.scatter_reduce(0, rows, boxes[:, 0], "amin"), high.scatter_reduce(0, rows, boxes[:, 1], "amax")
    present = (low <= high).all(-1).nonzero().reshape(-1)
    around = ((low < middle) & (middle < high)).all(-1).nonzero().reshape(-1)
    found = []
    for number in around.tolist():
        corners = geometry.vertices[geometry.faces[geometry.object_id == number].long()]
        solid = Solid(number, corners, low[number], high[number])
        if not solid.holds(middle[None].double()):
            continue
        others = present[present != number]
        held = others[((low[number] <= low[others]) & (high[others] <= high[number])).all(-1)]
        if not solid.holds((low + high)[held][:_SAMPLES] / 2):
            found.append(solid)
    return tuple(found)


def _without(scene: Scene, left_out: Tensor) -> Scene:
    """The scene without some objects; materials and lights are the same."""
    if not len(left_out):
        return scene
    rest = replace(scene)
    rest.__dict__["geometry"] = scene.geometry.part(~torch.isin(scene.geometry.object_id, left_out))
    return rest


def _cameras(scene: Scene) -> Cameras:
    middle = scene.bounds.mean(dim=0)
    matrices = torch.eye(4, dtype=torch.float64).repeat(6, 1, 1)
    for number, (right, down) in enumerate(_FACES):
        axes = torch.tensor([right, down], dtype=torch.float64)
        matrices[number, :3, :3] = torch.cat([axes, torch.linalg.cross(axes[:1], axes[1:])])
        matrices[number, :3, 3] = -matrices[number, :3, :3] @ middle
    half = CUBE_SIZE / 2
    intrinsics = torch.tensor([[half, 0, half], [0, half, half], [0, 0, 1]], dtype=torch.float64)
    near = torch.tensor(1e-3 * (scene.diagonal or 1.0), dtype=torch.float64)
    far = torch.tensor(torch.inf, dtype=torch.float64)
    return Cameras(matrices, intrinsics.expand(6, 3, 3), CUBE_SIZE, CUBE_SIZE, near, far)
