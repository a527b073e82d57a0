"""Surface voxels of a scene, drawn as cubes with their own colours and normals in the scene's light."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from torchrender.raster import rasterize
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.shade import shade
from torchrender.tuning.systems.system import System, Trial
from torchrender.voxels.attributes import SurfaceVoxels, voxelize_scene
from torchrender.voxels.mesh import voxel_mesh

CELLS = (32, 64, 128, 256)
"""Along the longest side of the scene."""


def _voxels(scene: Scene, size: int) -> Trial | None:
    if not scene.geometry.triangle_count or scene.geometry.see_through is not None:
        return None  # cubes and the picture beside them show nothing behind panes
    camera = scene.camera(width=size, height=size)

    def seen(shown: Scene) -> Tensor:
        gbuffer = rasterize(shown, camera)
        return torch.where(gbuffer.covered[..., None], shade(shown, gbuffer), 0.0)

    def picture(made: SurfaceVoxels) -> Tensor:
        cubes = voxel_mesh(made.voxels, made.color, normals=made.normal)
        return seen(replace(scene, meshes=(cubes,), materials=(Material(diffuse=torch.ones(3)),)))

    return Trial(
        settings={f"{cells} cells": partial(voxelize_scene, scene, cells) for cells in CELLS},
        picture=picture,
        reference=lambda: seen(scene),
    )


VOXELS = System(
    name="voxels",
    summary="turns surfaces into voxels of normal and colour, drawn as cubes in the scene's light without shadows",
    reference="the scene drawn so",
    trial=_voxels,
)
