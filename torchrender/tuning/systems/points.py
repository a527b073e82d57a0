"""Points on a scene's surfaces, drawn by splats, beside the surfaces themselves by many samples a pixel."""

from __future__ import annotations

from functools import partial

import torch
from torch import Tensor

from torchrender.points.draw import render_points
from torchrender.points.load import sample_points
from torchrender.points.options import SplatOptions
from torchrender.points.tree import build_patches
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color
from torchrender.tuning.systems.system import System, Trial

COUNTS, FILTERS = (50_000, 200_000), ("squares", "low_pass", "reconstruction", "adaptive", "full")
"""Points of the coarse models, drawn by the usual filter; filters of the fine one."""
MOST = 800_000
FACTOR = 4
"""Samples of the reference along each side of a pixel."""


def drawn_surfaces(scene: Scene, camera: Cameras, options: SplatOptions, factor: int) -> tuple[Tensor, Tensor]:
    """Picture (H,W,3) and coverage (H,W) of a scene by ``factor`` squared samples a pixel, lit like points."""
    tiles = []
    height = max(1, (1 << 22) // (camera.width * factor * factor))
    for top in range(0, camera.height, height):
        part = camera.sub_camera(0, top, camera.width, min(height, camera.height - top)).scaled(factor)
        view = rasterize(scene, part)
        _, rays = part.rays()
        toward = -torch.nn.functional.normalize(rays, dim=-1)
        facing = (view.normal.double() * toward).sum(-1).abs()
        shade = options.ambient + (1 - options.ambient) * facing.float()
        color = diffuse_color(scene, view) * shade[..., None]
        covered = view.covered[..., None]
        tiles.append(torch.cat([torch.where(covered, color, torch.tensor(options.background)), covered.float()], -1)[0])
    fine = torch.cat(tiles)
    mean = fine.reshape(camera.height, factor, camera.width, factor, 4).mean(dim=(1, 3))
    return mean[..., :3], mean[..., 3]


def _points(scene: Scene, size: int) -> Trial | None:
    if not scene.geometry.triangle_count or scene.geometry.see_through is not None:
        return None  # points of panes are blended, the picture beside them is of what is solid
    camera = scene.camera(width=size, height=size)
    models = {count: build_patches(sample_points(scene, count)) for count in (*COUNTS, MOST)}
    settings = {
        f"{count // 1000} k points": partial(render_points, models[count], camera, SplatOptions()) for count in COUNTS
    }
    for name in FILTERS:
        settings[name.replace("_", "-")] = partial(render_points, models[MOST], camera, SplatOptions(filter=name))
    return Trial(
        settings=settings,
        picture=lambda made: made.image,
        reference=lambda: drawn_surfaces(scene, camera, SplatOptions(), FACTOR)[0][None],
    )


POINTS = System(
    name="points",
    summary=f"draws points on the surfaces by splats: {MOST // 1000} k by each filter, fewer by the usual one",
    reference=f"the surfaces by {FACTOR**2} samples a pixel",
    trial=_points,
)
