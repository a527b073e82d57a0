"""Reflections from clustered depth images: neighbouring mirror pixels share a depth image, every ray stays its own.

Reflective pixels are grouped by reflector and normal; each group gets a camera that sees about what its reflected rays
see; the scene is drawn from there once, and every ray is marched through that depth image. The camera only decides
which surfaces are recorded. Nothing is precomputed: the scene may change with every picture.
Source: specification 03 (image-space reflections by clustered depth images), algorithms 6 and 7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import RayHits, ReflectionLayer, ReflectionState, VisibilityBuffer
from torchrender.clock import StepClock
from torchrender.effects.reflections.cluster_cameras import ClusterCameras, build_cluster_cameras
from torchrender.effects.reflections.cluster_images import (
    ClusterAnswer,
    cluster_camera,
    cluster_image,
    march_image,
    mirror_view,
)
from torchrender.effects.reflections.cluster_options import ClusterOptions as ClusterOptions
from torchrender.effects.reflections.cluster_shading import RAYS, Question, Shading, far_plane
from torchrender.effects.reflections.pixel_clusters import cluster_pixels
from torchrender.effects.reflections.reflectors import (
    START,
    Onward,
    RayShader,
    ReflectedRays,
    ReflectivePixels,
    lobe_rays,
    reflected_rays,
    reflection_layer,
)
from torchrender.errors import OptionError
from torchrender.kernels.rays.depth_march import UNKNOWN
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False)
class ClusteredReflections:
    """The layer, and how it came about."""

    layer: ReflectionLayer
    cameras: ClusterCameras
    unknown: Tensor  # (N,) share of each pixel's rays that no depth image answered
    steps: int  # texels visited by all rays
    elapsed_ms: Mapping[str, float]  # clusters, cameras, depth images, marching, shading


def clustered_reflections(
    scene: Scene,
    pixels: ReflectivePixels,
    shader: RayShader,
    options: ClusterOptions | None = None,
    *,
    direct: Tensor | None = None,
    caster: Callable[[], RayCaster] | None = None,
    onward: Onward | None = None,
) -> ClusteredReflections:
    """What the pixels mirror, by a depth image for each cluster of them.

    Args:
        shader: gives hits their colour, and rays without an answer a guess.
        direct: (B,H,W,3) the picture without reflections: what glossy reflections fade to; None: black.
        caster: makes the ray caster for ``missing="trace"``; called only if a ray needs it.
        onward: what mirrors show that are seen in mirrors; None: the guess of the shader.

    Raises:
        OptionError: ``missing="trace"`` without a caster.
    """
    options = options or ClusterOptions()
    if options.missing == "trace" and caster is None:
        raise OptionError('missing="trace" needs a caster')
    own = torch.zeros(len(pixels), 3) if direct is None else direct.reshape(-1, 3).index_select(0, pixels.pixel)
    shading = Shading(scene, pixels, shader, options, caster, own, onward)
    clock = shading.clock
    with clock.measure("clusters"):
        clusters = cluster_pixels(
            pixels,
            scene.diagonal,
            bins=options.bins,
            rule=options.scale_rule,
            m=options.bin_factor,
            plane_share=options.plane_share,
            camera_share=options.camera_share,
        )
    with clock.measure("cameras"):
        made = build_cluster_cameras(
            pixels,
            clusters,
            scene.diagonal,
            centre=options.centre,
            scale=options.image_scale,
            shorten=options.fade,
            aim=options.aim,
        )
    steps = 0
    for number in range(len(made)):
        for question in _ask(scene, pixels, made, number, options, clock):
            steps += question.answer.steps
            shading.add(question)
    shading.flush()
    known = torch.isfinite(shading.distance)
    state = torch.where(known, int(ReflectionState.DEPTH_IMAGE), int(ReflectionState.ENVIRONMENT))
    state = torch.where(known & (shading.traced > 0), int(ReflectionState.TRACED), state)
    layer = reflection_layer(pixels, shading.color, shading.distance, state, made.clusters.cluster)
    return ClusteredReflections(layer, made, shading.unknown, steps, clock.elapsed_ms)


def _ask(
    scene: Scene,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    number: int,
    options: ClusterOptions,
    clock: StepClock,
) -> Iterator[Question]:
    """Send the rays of a cluster to its depth image, not more than memory holds at a time."""
    members = made.clusters.members(number)
    part = pixels.select(members)
    known = bool(made.usable[number]) and len(members) >= options.min_cluster_pixels
    if known and bool(made.planar[number]):
        with clock.measure("depth images"):
            answer = mirror_view(scene.geometry, pixels, made, number, scene.diagonal)
        yield Question(
            members,
            1,
            reflected_rays(part),
            answer,
            torch.ones(len(members)),
            torch.zeros(len(members), dtype=torch.bool),
        )
        return
    seen = None
    if known:
        with clock.measure("depth images"):
            seen = cluster_image(scene.geometry, cluster_camera(made, number), part.position, options.cull)
    concave = options.self_reflection == "diffuse" and _is_concave(part, made, number)
    count = options.glossy_rays if bool((part.gloss > 0).any()) else 1
    for some in torch.arange(len(members)).split(max(1, RAYS // count)):
        piece = part.select(some)
        if count == 1:
            rays, weight = reflected_rays(piece), torch.ones(len(piece))
        else:
            rays, weight = lobe_rays(piece, count, options.lobe)
        with clock.measure("marching"):
            answer = _march(scene, piece, rays, seen, options)
        itself = torch.zeros(len(some) * count, dtype=torch.bool)
        if concave:
            hit = answer.hits.triangle
            own = scene.geometry.object_id[hit.clamp_min(0)] == piece.object_id.repeat_interleave(count)
            itself = (hit >= 0) & own
        yield Question(members[some], count, rays, answer, weight, itself)


def _march(
    scene: Scene, piece: ReflectivePixels, rays: ReflectedRays, seen: VisibilityBuffer | None, options: ClusterOptions
) -> ClusterAnswer:
    """What rays meet in a depth image; nothing is known without one."""
    total = len(rays.origin)
    if seen is None:
        return ClusterAnswer(torch.full((total,), UNKNOWN, dtype=torch.uint8), RayHits.misses(total), 0)
    count = total // len(piece)
    reach = far_plane(piece.gloss, scene.diagonal, options).repeat_interleave(count)
    climb = (rays.direction * piece.geometric_normal.repeat_interleave(count, 0)).sum(-1)
    ends = torch.where(climb > 0, reach / climb.clamp_min(1e-9), scene.diagonal).clamp_max(scene.diagonal)
    return march_image(scene.geometry, seen, rays, (START * scene.diagonal, ends), options.depth_tolerance)


def _is_concave(part: ReflectivePixels, made: ClusterCameras, number: int) -> bool:
    """Normals of a hollow surface lean towards the middle of its pixels."""
    offset = part.position - made.frame[number, 0]
    return float((offset * part.normal).sum(-1).mean()) < 0.0
