"""Extra layers of a keyframe: what cameras around the first one see and its depth image does not hold.

Extra cameras keep the orientation and intrinsics of the first, so a pixel of theirs and the same pixel of the first
image look at the same point of the sky: no sky is sent twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.effects.shadow_map import lights_visibility
from torchrender.effects.traced_reflection import environment_reflections, trace_reflections
from torchrender.history import RenderHistory
from torchrender.hit_shader import HitShader
from torchrender.raster import FragmentTests, rasterize, rasterize_depth
from torchrender.reflection.reflectors import blend_reflections, reflective_pixels
from torchrender.renderer import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shade import shade

BASELINE = 0.06  # distance of the extra cameras in median depths of the first image
MAX_BASELINE = 0.25


@dataclass(frozen=True, eq=False)
class Layer:
    """One extra depth image with its colours."""

    camera: Cameras
    depth: Tensor  # (H,W); +inf where there is no surface
    radiance: Tensor  # (H,W,3) linear
    known: Tensor  # (H,W) bool: a sample, or sky that no earlier layer shows


def extra_layers(
    scene: Scene, first: GBuffer, cameras: Sequence[Cameras], options: RenderOptions, history: RenderHistory | None
) -> list[Layer]:
    """Non-redundant depth images (specification 01, section 5) from each of ``cameras``, shaded like a picture.

    Args:
        scene: as it was given to the renderer.
        first: the one-camera G-buffer of layer 0.
        cameras: single cameras from :func:`cameras_around`.
        history: what the picture of layer 0 left: shadow maps and ray caster are used again.
    """
    scene = scene.with_default_light() if history is None or history.scene is None else history.scene
    known: list[VisibilityBuffer] = [first]
    sky_shown = ~first.covered[0]
    open_air = bool(sky_shown.any())
    layers = []
    for camera in cameras:
        tests = FragmentTests(earlier=_together(known), test="depth_identity")
        gbuffer = rasterize(scene, camera, tests=tests)
        new_sky = torch.zeros_like(sky_shown)
        if open_air:
            new_sky = torch.isinf(rasterize_depth(scene.geometry, camera)[0]) & ~sky_shown
            sky_shown = sky_shown | new_sky
        radiance = _shaded(scene, gbuffer, options, history)
        layers.append(Layer(camera, gbuffer.depth[0], radiance[0], gbuffer.covered[0] | new_sky))
        known.append(gbuffer)
    return layers


def cameras_around(
    camera: Cameras, depth: Tensor, count: int, *, direction: Sequence[float] = (0, 0, 0), baseline: float = 0.0
) -> list[Cameras]:
    """``count`` cameras beside a single one: first where it is going, then to both sides, up and down.

    Args:
        depth: (H,W) what the camera sees.
        direction: where it is going, world axes; zero where it stands.
        baseline: how far, scene units; kept between ``BASELINE`` and ``MAX_BASELINE`` median depths.
    """
    if not count:
        return []
    finite = depth[torch.isfinite(depth)]
    typical = float(finite.median()) if len(finite) else 10.0 * float(camera.near[0])
    reach = min(max(baseline, BASELINE * typical), MAX_BASELINE * typical)
    right, down = camera.rotation[0, 0], camera.rotation[0, 1]
    ways = [right, -right, -down, down]
    ahead = torch.as_tensor(direction, dtype=torch.float64)
    if float(ahead.norm()) > 0.0:
        ahead = ahead / ahead.norm()
        ways = [ahead, *sorted(ways, key=lambda way: -float(way @ ahead))]
    moved = []
    for way in ways[:count]:
        matrix = camera.camera_from_world.clone()
        matrix[0, :3, 3] -= camera.rotation[0] @ (reach * way)
        moved.append(replace(camera, camera_from_world=matrix))
    return moved


def _together(images: Sequence[VisibilityBuffer]) -> VisibilityBuffer:
    names = ("depth", "triangle", "object_id", "barycentric")
    parts = {name: torch.cat([getattr(image, name) for image in images]) for name in names}
    return VisibilityBuffer(cameras=Cameras.cat([image.cameras for image in images]), **parts)


def _shaded(scene: Scene, gbuffer: GBuffer, options: RenderOptions, history: RenderHistory | None) -> Tensor:
    """(1,H,W,3) radiance of samples that need not be the nearest surfaces."""
    maps = None if history is None else history.shadow_maps
    visibility = None
    if options.shadows and scene.lights and bool(gbuffer.covered.any()):
        visibility = lights_visibility(scene, gbuffer, options.shadow, maps)
    radiance = shade(scene, gbuffer, visibility, background=options.background)
    if options.reflections == "off":
        return radiance
    pixels = reflective_pixels(scene, gbuffer)
    if not len(pixels):
        return radiance
    shader = None if history is None else history.shader
    shader = shader or HitShader(scene, options.shadow if options.shadows else None, maps, options.background)
    caster = None if history is None else history.caster
    if caster is None:
        return blend_reflections(scene, gbuffer, radiance, environment_reflections(pixels, shader))
    return blend_reflections(scene, gbuffer, radiance, trace_reflections(caster, pixels, shader, options.tracing))
