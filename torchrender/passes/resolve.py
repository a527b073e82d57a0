"""What each pass does: functions of a :class:`torchrender.pipeline.frame.Frame` that return the buffer they make."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ShadowMap
from torchrender.effects.reflections.clustered import clustered_reflections
from torchrender.effects.reflections.reflectors import ReflectivePixels, blend_reflections, mirrored_share
from torchrender.effects.reflections.reuse import reuse_reflections
from torchrender.effects.reflections.traced import environment_reflections, trace_reflections
from torchrender.effects.shadows.shadow_map import light_visibility, render_shadow_map
from torchrender.effects.shadows.soft_shadow import soft_shadow
from torchrender.effects.shadows.traced import traced_visibility
from torchrender.effects.upsampling.joint import joint_upsampled
from torchrender.pipeline.frame import Frame, lasting_shadows
from torchrender.raster import rasterize
from torchrender.scene.light import RectLight
from torchrender.shade import shade


def draw_gbuffer(frame: Frame) -> GBuffer:
    """What every rendered pixel sees."""
    return rasterize(frame.scene, frame.view)


def draw_shadow_maps(frame: Frame) -> list[ShadowMap | None]:
    """A map per light: those of an earlier picture while nothing moved; None for lights that need none."""
    options, scene = frame.options, frame.scene
    gbuffer: GBuffer = frame.buffers["gbuffer"]
    view = gbuffer.cameras if options.shadow.cascades > 1 else None
    made = list(frame.past.shadow_maps or [None] * len(scene.lights))
    mirrored, drawn = reflects(frame), 0
    for number, light in enumerate(scene.lights):
        sampled = options.area_shadows == "sampled" if isinstance(light, RectLight) else options.point_shadows != "maps"
        if made[number] is None and (mirrored or not sampled):
            # With the border that penumbrae need, so that the same map serves both kinds of look-up.
            how = lasting_shadows(options)
            how = replace(how, filter="pcss", soft=None) if isinstance(light, RectLight) else how
            made[number] = render_shadow_map(scene, light, how, camera=view)
            drawn += 1
    if not drawn and frame.past.shadow_maps is not None:
        return list(frame.past.shadow_maps)
    # Cascades follow the eye: they do not last.
    frame.past = replace(frame.past, shadow_maps=made if options.shadow.cascades == 1 else None)
    return made


def reflects(frame: Frame) -> bool:
    """Some pixel mirrors, and what it mirrors is shaded."""
    return frame.options.reflections != "off" and len(frame.reflectors()) > 0


def find_point_shadows(frame: Frame) -> dict[int, Tensor]:
    """Visibility (B,H,W) of the lights without area, by their number."""
    lights = {n: light for n, light in enumerate(frame.scene.lights) if not isinstance(light, RectLight)}
    gbuffer = frame.buffers["gbuffer"]
    if frame.options.point_shadows == "traced":
        return {n: traced_visibility(frame.caster(), light, gbuffer) for n, light in lights.items()}
    maps, options = frame.buffers["shadow_maps"], frame.options.shadow
    return {n: light_visibility(frame.scene, light, gbuffer, options, maps[n]) for n, light in lights.items()}


def find_area_shadows(frame: Frame) -> dict[int, Tensor]:
    """Visibility (B,H,W) of the rectangular lights, by their number."""
    lights = {n: light for n, light in enumerate(frame.scene.lights) if isinstance(light, RectLight)}
    gbuffer, options = frame.buffers["gbuffer"], frame.options
    if options.area_shadows == "sampled":
        rectangles = list(lights.values())
        found = soft_shadow(frame.occluders(), rectangles, gbuffer, options.soft_shadow, bounds=frame.scene.bounds)
        return dict(zip(lights, found.visibility.unbind(1), strict=True))
    maps = frame.buffers["shadow_maps"]
    if options.area_shadows == "pcss":
        by_size = replace(options.shadow, filter="pcss", soft=None)
    else:
        by_size = options.shadow
    return {n: light_visibility(frame.scene, light, gbuffer, by_size, maps[n]) for n, light in lights.items()}


def light_directly(frame: Frame) -> Tensor:
    """Radiance (B,H,W,3) without reflections."""
    scene, gbuffer = frame.scene, frame.buffers["gbuffer"]
    found = {**frame.buffers.get("point_shadows", {}), **frame.buffers.get("area_shadows", {})}
    visibility = None
    if found:
        lit = torch.ones(gbuffer.triangle.shape)
        visibility = torch.stack([found.get(number, lit) for number in range(len(scene.lights))], dim=1)
    options = frame.options
    return shade(scene, gbuffer, visibility, background=options.background, area_light=options.area_light)


def mirror(frame: Frame) -> ReflectionLayer | None:
    """What the reflective pixels mirror; None if there are none."""
    pixels = frame.reflectors()
    return _mirror(frame, pixels) if len(pixels) else None


def mirror_again(frame: Frame) -> ReflectionLayer | None:
    """The same out of the history, as far as it goes; the scattered rest by rays."""
    pixels = frame.reflectors()
    if not len(pixels):
        return None
    gbuffer = frame.buffers["gbuffer"]

    def trace(chosen: ReflectivePixels) -> ReflectionLayer:
        if len(chosen) == len(pixels):
            return _mirror(frame, chosen)
        return trace_reflections(frame.caster(), chosen, frame.shader(), frame.options.tracing)

    share = mirrored_share(frame.scene, gbuffer, pixels)
    made = reuse_reflections(pixels, gbuffer, trace, frame.past.reuse, frame.options.reuse, share)
    frame.past = replace(frame.past, reuse=made.state, report=made.report)
    return made.layer


def _mirror(frame: Frame, pixels: ReflectivePixels) -> ReflectionLayer:
    options = frame.options
    if options.reflections == "environment":
        return environment_reflections(pixels, frame.shader())
    if options.reflections == "traced":
        return trace_reflections(frame.caster(), pixels, frame.shader(), options.tracing)
    direct = frame.buffers["direct"]
    made = clustered_reflections(
        frame.scene, pixels, frame.shader(), options.reflection, direct=direct, caster=frame.caster
    )
    return made.layer


def make_picture(frame: Frame) -> Tensor:
    """Radiance (B,H,W,3) at the picture's size."""
    radiance, layer = frame.buffers["direct"], frame.buffers.get("reflection_layer")
    if layer is not None:
        radiance = blend_reflections(frame.scene, frame.buffers["gbuffer"], radiance, layer)
    size = (frame.cameras.height, frame.cameras.width)
    rows, columns = radiance.shape[1:3]
    if (rows, columns) == size:
        return radiance
    # The compiled scaling knows no gradients: who wants some gets the bilinear one.
    if frame.options.upscaling == "joint" and (rows < size[0] or columns < size[1]) and not radiance.requires_grad:
        materials = frame.scene.geometry.material
        return joint_upsampled(radiance, frame.buffers["gbuffer"], frame.visibility(), materials)
    return resampled(radiance, size, frame.options.upscaling)


def resampled(radiance: Tensor, size: tuple[int, int], upscaling: str) -> Tensor:
    """Linear radiance (B,h,w,3) at another size (H,W): means where there are more samples, else scaled up.

    Args:
        upscaling: "nearest", else bilinear.
    """
    height, width = size
    count, rows, columns, _ = radiance.shape
    if rows % height == 0 and columns % width == 0:
        return radiance.reshape(count, height, rows // height, width, columns // width, 3).mean(dim=(2, 4))
    planes = radiance.permute(0, 3, 1, 2)
    if rows >= height and columns >= width:
        planes = torch.nn.functional.interpolate(planes, size=size, mode="area")
    elif upscaling == "nearest":
        planes = torch.nn.functional.interpolate(planes, size=size, mode="nearest-exact")
    else:
        planes = torch.nn.functional.interpolate(planes, size=size, mode="bilinear", align_corners=False)
    return planes.permute(0, 2, 3, 1).contiguous()
