"""What media leave of the light that surfaces send, on its way to these: of lamps, and from everywhere."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.effects.media.surfaces import light_transmittance, surroundings_left
from torchrender.passes.light.ambient_visibility import AMBIENT_VISIBILITY, has_ambient_light
from torchrender.passes.light.direct_light import DIRECT_LIGHT, MIRROR_SHARE, ambient_reach, lights_visibility
from torchrender.passes.light.sky_shadow import SKY_SHADOW
from torchrender.pipeline.frame import Frame
from torchrender.shade import AmbientReach, SentLight, sent_light


def darkened(frame: Frame, samples: GBuffer | RaySurface, *, mirrors: bool) -> SentLight | None:
    """Direct light with what media leave of it on its way from the lights and from everywhere; None: all of it.

    Args:
        mirrors: with what mirrors replace of that light, which media darkened alike.
    """
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

    def of_color(c: int) -> SentLight:
        arriving = visibility
        if passed is not None:
            own = passed[..., c % passed.shape[-1]]
            arriving = (own if visibility is None else visibility * own).contiguous()
        reach = around
        if left is not None:
            own = left[..., c % left.shape[-1]]
            reach = AmbientReach(own) if around is None else replace(around, visibility=around.visibility * own)
        return sent_light(
            scene,
            samples,
            arriving,
            background=options.background,
            area_light=options.area_light,
            around=reach,
            mirrors=mirrors,
        )

    def of_colors(images: list[Tensor]) -> Tensor:
        return images[0] if colors == 1 else torch.stack([image[..., c] for c, image in enumerate(images)], dim=-1)

    colors = max(part.shape[-1] for part in (passed, left) if part is not None)
    sent = [of_color(c) for c in range(colors)]
    image, replaced = (of_colors(parts) for parts in ([s.radiance for s in sent], [s.share.replaced for s in sent]))
    hidden = frame.get(SKY_SHADOW)
    if hidden is not None and left is not None:
        image = image + (1.0 - left) * hidden  # what objects hide of the sky is not taken twice
    return SentLight(image, replace(sent[0].share, replaced=replaced))


def change_of_hits(frame: Frame, samples: RaySurface) -> Tensor | None:
    """What media take (1,1,N,3) from the light that surfaces send which rays hit; None: nothing.

    Of mirrors among them whoever asked takes what they replace later, as it was without media.
    """
    darker = darkened(frame, samples, mirrors=True)
    if darker is None:
        return None
    reflects = frame.scene.material_table.is_reflector[samples.material] & (samples.material >= 0)
    left = torch.where(reflects[..., None], frame[MIRROR_SHARE].replaced - darker.share.replaced, 0.0)
    return darker.radiance - frame[DIRECT_LIGHT] + left
