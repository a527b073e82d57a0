"""Reflections from clustered depth images: neighbouring mirror pixels share a depth image, every ray stays its own.

Reflective pixels are grouped by reflector and normal; each group gets a camera that sees about what its reflected rays
see; the scene is drawn from there once, and every ray is marched through that depth image. The camera only decides
which surfaces are recorded. Nothing is precomputed: the scene may change with every picture.
Source: specification 03 (image-space reflections by clustered depth images), algorithms 6 and 7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.buffers import RayHits, ReflectionLayer, ReflectionState
from torchrender.checks import options_of
from torchrender.clock import StepClock
from torchrender.effects.reflections.clusters.bundle import ClusterCameras
from torchrender.effects.reflections.clusters.cameras import build_cluster_cameras
from torchrender.effects.reflections.clusters.grouping import cluster_pixels
from torchrender.effects.reflections.clusters.images import ClusterAnswer, mirror_view
from torchrender.effects.reflections.clusters.layers import batches, draw_images
from torchrender.effects.reflections.clusters.options import ClusterOptions as ClusterOptions
from torchrender.effects.reflections.clusters.published import published_answers
from torchrender.effects.reflections.clusters.shading import RAYS, Question, Shading, bundles, ray_ends
from torchrender.effects.reflections.glossy import share_rays
from torchrender.effects.reflections.reflectors import (
    START,
    MirroredPoints,
    Onward,
    RayShader,
    ReflectivePixels,
    reflected_rays,
    reflection_layer,
)
from torchrender.errors import OptionError
from torchrender.kernels.rays.depth_march import UNKNOWN
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False)
class ClusteredReflections:
    """The layer, and how it came about."""

    layer: ReflectionLayer
    cameras: ClusterCameras
    unknown: Tensor  # (N,) share of each pixel's rays that no depth image answered
    steps: int  # texels visited by all rays
    elapsed_ms: Mapping[str, float]  # clusters, cameras, depth images, marching, shading

    __repr__ = brief


def clustered_reflections(
    scene: Scene,
    pixels: ReflectivePixels,
    shader: RayShader,
    options: ClusterOptions | None = None,
    *,
    direct: Tensor | None = None,
    caster: Callable[[], RayCaster] | None = None,
    onward: Onward | None = None,
    planes: bool = True,
) -> ClusteredReflections:
    """What the pixels mirror, by a depth image for each cluster of them.

    Args:
        shader: gives hits their colour, and rays without an answer a guess.
        direct: (B,H,W,3) the picture without reflections: what glossy reflections fade to; None: black.
        caster: makes the ray caster for ``missing="trace"``; called only if a ray needs it.
        onward: what mirrors show that are seen in mirrors; None: the guess of the shader.
        planes: the pixels are those of a picture, so that planar clusters may be drawn by the mirrored eye.

    Raises:
        OptionError: ``missing="trace"`` without a caster.
    """
    options = options_of(options, ClusterOptions)
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
        made = build_cluster_cameras(pixels, clusters, scene.diagonal, replace(options.cameras, planes=planes))
    steps = 0
    for question in _questions(scene, pixels, made, shader, options, clock):
        steps += question.answer.steps
        shading.add(question)
    shading.flush()
    known = torch.isfinite(shading.distance)
    state = torch.where(known, int(ReflectionState.DEPTH_IMAGE), int(ReflectionState.ENVIRONMENT))
    state = torch.where(known & (shading.traced > 0), int(ReflectionState.TRACED), state)
    color = share_rays(pixels, shading.color) if options.share_rays and planes else shading.color
    layer = reflection_layer(pixels, color, shading.distance, state, made.clusters.cluster)
    return ClusteredReflections(layer, made, shading.unknown, steps, clock.elapsed_ms)


def _questions(
    scene: Scene,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    shader: RayShader,
    options: ClusterOptions,
    clock: StepClock,
) -> Iterator[Question]:
    """What the rays of all clusters met."""
    sizes = made.clusters.sizes
    asked = made.usable & (sizes >= options.min_cluster_pixels)
    if options.missing == "trace":
        sent = sizes * (options.glossy_rays if bool((pixels.gloss > 0).any()) else 1)
        asked &= made.planar | (sent >= options.trace_below * scene.geometry.triangle_count)
    for number in (asked & made.planar).nonzero().reshape(-1).tolist():
        yield _mirror(scene, pixels, made, number, clock)
    curved = (asked & ~made.planar).nonzero().reshape(-1)
    if options.search == "secant":
        for number in curved.tolist():
            yield from published_answers(scene, pixels, made, number, shader, options, clock)
    elif len(curved):
        for numbers in batches(made, curved, options.glossy_rays, RAYS):
            yield from _ask(scene, pixels, made, numbers, options, clock)
    unanswered = (~asked)[made.clusters.cluster].nonzero().reshape(-1)
    for members in unanswered.split(RAYS // options.glossy_rays):
        for rows, rays, weight in bundles(pixels, members, options):
            total = len(rays.origin)
            nothing = ClusterAnswer(torch.full((total,), UNKNOWN, dtype=torch.uint8), RayHits.misses(total), 0)
            yield Question.plain(rows, rays, nothing, weight)


def _mirror(scene: Scene, pixels: ReflectivePixels, made: ClusterCameras, number: int, clock: StepClock) -> Question:
    """What a planar cluster mirrors."""
    members = made.clusters.members(number)
    with clock.measure("depth images"):
        answer = mirror_view(scene.geometry, pixels, made, number)
    return Question.plain(members, reflected_rays(pixels.select(members)), answer, torch.ones(len(members)))


def _ask(
    scene: Scene,
    pixels: ReflectivePixels,
    made: ClusterCameras,
    numbers: Tensor,
    options: ClusterOptions,
    clock: StepClock,
) -> Iterator[Question]:
    """Send the rays of some curved clusters to their images."""
    place = torch.full((len(made),), -1, dtype=torch.int64)
    place[numbers] = torch.arange(len(numbers))
    members = (place[made.clusters.cluster] >= 0).nonzero().reshape(-1)
    asked = []
    for rows, rays, weight in bundles(pixels, members, options):
        owner = made.clusters.cluster[rows].repeat_interleave(len(rays.origin) // len(rows))
        ends = ray_ends(pixels.select(rows), rays, scene.diagonal, options)
        asked.append((rows, owner, weight, (rays, place[owner], (START * rays.width, ends))))
    with clock.measure("depth images"):
        sent = [one[3] for one in asked]
        images = draw_images(scene.geometry, pixels, made, numbers, sent, options.layers)
    concave = _concave(pixels, made) if options.self_reflection == "diffuse" else None
    for rows, owner, weight, one in asked:
        with clock.measure("marching"):
            answer = images.ask(one)
        question = Question.plain(rows, one[0], answer, weight)
        if concave is not None:
            hit = answer.hits.triangle
            reflector = pixels.object_id[rows].repeat_interleave(question.per_pixel)
            own = scene.geometry.object_id[hit.clamp_min(0)] == reflector
            question = replace(question, itself=(hit >= 0) & own & concave[owner])
        yield question


def _concave(pixels: ReflectivePixels, made: ClusterCameras) -> Tensor:
    """(C,) bool: normals of a hollow surface lean towards the middle of its pixels."""
    cluster = made.clusters.cluster
    lean = ((pixels.position - made.frame[cluster, 0]) * pixels.normal).sum(-1)
    return torch.zeros(len(made), dtype=torch.float64).index_add(0, cluster, lean) < 0.0


def clustered_onward(
    scene: Scene, cameras: Cameras, shader: RayShader, options: ClusterOptions, bounces: int
) -> Onward | None:
    """What mirrors in mirrors show, by clusters of the places where rays have met mirrors.

    Args:
        cameras: of the picture.
        bounces: mirrors that light is followed over, the one that the eye sees included; with 1: None.
    """
    if bounces <= 1:
        return None
    further = clustered_onward(scene, cameras, shader, options, bounces - 1)

    def onward(points: MirroredPoints) -> Tensor:
        count = len(points.gloss)
        pixels = ReflectivePixels(
            shape=(1, 1, count),
            cameras=cameras[:1],
            pixel=torch.arange(count),
            position=points.rays.origin,
            normal=points.normal,
            geometric_normal=points.geometric_normal,
            view=points.arriving,
            direction=points.rays.direction,
            gloss=points.gloss,
            object_id=points.object_id,
            depth=points.length,
            length=points.length,
            pixel_angle=points.rays.spread,
        )
        return clustered_reflections(scene, pixels, shader, options, onward=further, planes=False).layer.color.reshape(
            -1, 3
        )

    return onward
