"""Which lights reach what a picture sees: by light, by picture and by tile. Cast shadows are not asked here.

A light that is off, whose cone, range or emitting side misses everything in view, or before which only black surfaces
or backs of surfaces lie, lights no pixel: nobody needs its shadows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import GBuffer, RaySurface
from torchrender.checks import check_range
from torchrender.effects.shadows.receivers import horizon_normals, shadow_receivers
from torchrender.kernels.compile import thread_count
from torchrender.kernels.shadows.light_reach import PARALLEL, POINT, RECTANGLE, SPOT, Lamps, Points, mark_tiles
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight, light_color
from torchrender.scene.model import Scene

TILE = 16
"""Pixels along each side of a tile."""


@dataclass(frozen=True, eq=False)
class LightReach:
    """The lights that reach B pictures, and the list of them for every tile of ``side`` x ``side`` pixels.

    Tiles go row by row, picture after picture. ``lights[starts[t]:starts[t + 1]]`` are the numbers, in the scene's
    order, of the lights that may light a pixel of tile t.
    """

    reaches: Tensor  # (B,L) bool: some pixel of the picture may take light of the lamp
    starts: Tensor  # (B*T+1,) int64
    lights: Tensor  # (N,) int32
    side: int  # pixels

    @property
    def any(self) -> Tensor:
        """(L,) bool: reaches some picture."""
        return self.reaches.any(dim=0)


def light_reach(scene: Scene, samples: GBuffer | RaySurface, *, side: int = TILE) -> LightReach:
    """The lights of a scene that reach what is seen: of B pictures, or of an image of ray hits.

    Tiles err on the side of yes by whole tiles, never by less: a pixel that takes light lies in a tile that lists it.

    Raises:
        OptionError: ``side`` outside [1, 4096].
    """
    check_range("side", side, 1, 4096)
    count, height, width = samples.covered.shape
    tiles = -(-height // side) * -(-width // side)
    marks = np.zeros((count, tiles, len(scene.lights)), np.bool_)
    shining = torch.tensor([shines(light) for light in scene.lights], dtype=torch.bool)
    if bool(shining.any()) and bool(samples.covered.any()):
        lamps, threads = lamps_of(scene.lights), thread_count()
        for index, points in enumerate(points_of(scene, samples, (samples.position, horizon_normals(samples)))):
            mark_tiles(points, lamps, side, threads, marks[index])
    found = torch.from_numpy(marks) & shining
    flat = found.reshape(count * tiles, found.shape[-1] if found.dim() else 0)
    starts = torch.zeros(count * tiles + 1, dtype=torch.int64)
    torch.cumsum(flat.sum(dim=1), dim=0, out=starts[1:])
    return LightReach(found.any(dim=1), starts, flat.nonzero()[:, 1].int(), side)


def shines(light: Light) -> bool:
    """The light sends anything at all."""
    # Asked of thousands of lights in every plan: lists are quicker than tensors of three numbers.
    return any(light_color(light).tolist()) and (not isinstance(light, RectLight) or light.area > 0)


def takes_light(scene: Scene) -> Tensor:
    """(M+1,) bool: the material sends back light that arrives directly; the last row stands for no surface."""
    table = scene.material_table
    physical = table.physical
    layered = (physical.clearcoat[:, 0] != 0) | (physical.sheen != 0).any(dim=1)
    glossy = (physical.kind == 1) & (physical.dielectric * physical.weight != 0) | layered
    return (table.diffuse != 0).any(dim=1) | (table.highlight != 0).any(dim=1) | glossy


def points_of(scene: Scene, samples: GBuffer | RaySurface, places: tuple[Tensor, Tensor] | None = None) -> list[Points]:
    """The pictures as kernels read them.

    Args:
        places: positions and normals (B,H,W,3); None: those by which shadows are looked up.
    """
    takes = takes_light(scene).detach()[samples.material] & samples.covered
    depth = samples.depth if isinstance(samples, GBuffer) else torch.ones(samples.material.shape)
    position, normal = shadow_receivers(samples) if places is None else places
    return [
        Points(
            numpy_view(position[index], np.float64),
            numpy_view(normal[index], np.float32),
            numpy_view(depth[index], np.float32),
            numpy_view(takes[index], np.bool_),
        )
        for index in range(len(samples.material))
    ]


def lamps_of(lights: Sequence[Light]) -> Lamps:
    """The lights as kernels read them."""
    count = len(lights)
    lamps = Lamps(
        kind=np.zeros(count, np.int64),
        place=np.zeros((count, 3)),
        axis=np.zeros((count, 3)),
        reach=np.full(count, np.inf),
        cosine=np.full(count, -1.0),
        edges=np.zeros((count, 2, 3)),
    )
    for number, light in enumerate(lights):
        if isinstance(light, DirectionalLight):
            lamps.kind[number], place = PARALLEL, -light.direction
        elif isinstance(light, RectLight):
            lamps.kind[number], place = RECTANGLE, light.corner
            lamps.axis[number] = light.normal.double().numpy()
            lamps.edges[number] = torch.stack([light.edge_u, light.edge_v]).double().numpy()
        elif isinstance(light, PointLight):
            lamps.kind[number], place = POINT, light.position
        else:
            lamps.kind[number], place = SPOT, light.position
            lamps.axis[number] = light.axis.numpy()
            lamps.cosine[number] = math.cos(math.radians(light.outer_deg))
        lamps.place[number] = place.detach().double().numpy()
        if isinstance(light, PointLight | SpotLight):
            lamps.reach[number] = light.range
    return lamps
