"""Curved clusters to the letter of the thesis: one depth image each, marched by algorithm 7, whose colours rays take.

To compare with; what is beyond it is in :mod:`torchrender.effects.reflections.clusters.layers`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import RayHits, VisibilityBuffer
from torchrender.clock import StepClock
from torchrender.effects.reflections.clusters.bundle import ClusterCameras
from torchrender.effects.reflections.clusters.extents import NEARER
from torchrender.effects.reflections.clusters.images import ClusterAnswer, cluster_camera
from torchrender.effects.reflections.clusters.options import ClusterOptions
from torchrender.effects.reflections.clusters.shading import RAYS, Question, bundles, ray_ends
from torchrender.effects.reflections.reflectors import RayShader, ReflectedRays, ReflectivePixels
from torchrender.kernels.reflections.secant import Painted, Painting, search_rays
from torchrender.raster import rasterize_visibility
from torchrender.scene.model import Scene

START = 1e-5
"""Distance from the reflector at which rays start, in scene diagonals, as published."""


def published_answers(
    scene: Scene,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    number: int,
    shader: RayShader,
    options: ClusterOptions,
    clock: StepClock,
) -> Iterator[Question]:
    """What the rays of a curved cluster met, in its depth image's colours; those that met nothing look at the
    environment."""
    with clock.measure("depth images"):
        camera = cluster_camera(made, number)
        camera = replace(camera, near=camera.near / NEARER)
        seen = rasterize_visibility(scene.geometry, camera, cull=options.cull)
    with clock.measure("shading"):
        color = _paint(seen, shader)
    members = made.clusters.members(number)
    for some in members.split(RAYS // options.glossy_rays):
        for rows, rays, weight in bundles(pixels, some, options):
            ends = ray_ends(pixels.select(rows), rays, scene.diagonal, options)
            with clock.measure("marching"):
                answer, paint = _march(seen, color, rays, (START * scene.diagonal, ends), options.depth_tolerance)
            missed = ~answer.hits.hit
            paint[missed] = shader.environment(rays.direction[missed], pixels.cameras.eye)
            yield replace(Question.plain(rows, rays, answer, weight), painted=paint)


def _paint(seen: VisibilityBuffer, shader: RayShader) -> Tensor:
    """(H,W,3) radiance of what the camera sees, towards it."""
    camera = seen.cameras
    origins, directions = (x.reshape(-1, 3) for x in camera.rays())
    covered = seen.covered.reshape(-1).nonzero().reshape(-1)
    color = torch.zeros(len(origins), 3)
    if len(covered):
        point = (
            origins[covered]
            + directions[covered]
            * (seen.depth.reshape(-1)[covered].double() / (directions[covered] * camera.forward[0]).sum(-1))[:, None]
        )
        toward = point - camera.eye[0]
        length = toward.norm(dim=-1)
        toward = toward / length.clamp_min(1e-300)[:, None]
        angle = camera.footprint(seen.depth.double()).reshape(-1)[covered] / length.clamp_min(1e-300)
        rays = ReflectedRays(camera.eye.expand(len(covered), 3), toward, torch.zeros_like(length), angle)
        hits = RayHits(length, seen.triangle.reshape(-1)[covered], seen.barycentric.reshape(-1, 2)[covered])
        color[covered] = shader(rays, hits)
    return color.reshape(camera.height, camera.width, 3)


def _march(
    seen: VisibilityBuffer, color: Tensor, rays: ReflectedRays, ends: tuple[float, Tensor], epsilon: float
) -> tuple[ClusterAnswer, Tensor]:
    camera, count = seen.cameras, len(rays.origin)
    image = Painting(
        seen.depth[0].numpy(),
        seen.triangle[0].numpy(),
        view(color, np.float32),
        view(camera.intrinsics[0] @ camera.camera_from_world[0, :3], np.float64),
        float(camera.near[0]),
        float(camera.footprint(torch.ones(1, 1))[0, 0]),
    )
    found = Painted(
        np.empty(count, np.uint8), np.empty(count), np.empty(count, np.int64), np.zeros((count, 3), np.float32)
    )
    sent = (view(rays.origin, np.float64), view(rays.direction, np.float64))
    search_rays(image, float(epsilon), sent, (float(ends[0]), view(ends[1], np.float64)), found)
    state, t, triangle, paint = (torch.from_numpy(a) for a in found)
    weights = torch.full((count, 2), 1.0 / 3.0)
    return ClusterAnswer(state, RayHits(t, triangle, weights), count), paint
