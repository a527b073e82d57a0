"""What media leave of the light that surfaces send, on its way to these: of lamps, and from everywhere."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.media.surfaces import light_transmittance, surroundings_left
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY, has_ambient_light
from torchrender.passes.light.direct_light import ambient_reach, lights_visibility
from torchrender.passes.light.sky_shadow import SKY_SHADOW
from torchrender.pipeline.frame import Frame
from torchrender.shade import AmbientReach, shade


def darkened(frame: Frame, samples: GBuffer | RaySurface) -> Tensor | None:
    """Direct light (B,H,W,3) with what media leave of it on its way from the lights and from everywhere."""
    scene, options = frame.scene, frame.options
    passed = light_transmittance(scene.media, scene.lights, samples.position, samples.covered) if scene.lights else None
    left = None
    if has_ambient_light(scene):
        left = surroundings_left(
            scene.media, samples.position, samples.normal, samples.covered, scattered=options.scattering.environment
        )
    if passed is None and left is None:
        return None
    visibility, around = lights_visibility(frame), ambient_reach(scene, frame.get(AMBIENT_VISIBILITY))

    def of_color(c: int) -> Tensor:
        arriving = visibility
        if passed is not None:
            own = passed[..., c % passed.shape[-1]]
            arriving = (own if visibility is None else visibility * own).contiguous()
        reach = around
        if left is not None:
            own = left[..., c % left.shape[-1]]
            reach = AmbientReach(own) if around is None else replace(around, visibility=around.visibility * own)
        return shade(
            scene, samples, arriving, background=options.background, area_light=options.area_light, around=reach
        )

    colors = max(part.shape[-1] for part in (passed, left) if part is not None)
    images = [of_color(c) for c in range(colors)]
    image = images[0] if colors == 1 else torch.stack([image[..., c] for c, image in enumerate(images)], dim=-1)
    hidden = frame.get(SKY_SHADOW)
    if hidden is None or left is None:
        return image
    return image + (1.0 - left) * hidden  # what objects hide of the sky is not taken twice
