"""The passes of a picture. A new one is one file beside those listed here, and one line."""

from __future__ import annotations

from collections.abc import Sequence

from torchrender.errors import InputError
from torchrender.passes.contract import Pass
from torchrender.passes.light import (
    ambient_visibility,
    direct_light,
    light_reach,
    pane_shadow,
    point_shadow,
    shadow_map,
    sky_shadow,
    soft_shadow,
)
from torchrender.passes.mirrors import hit_shader, key_frame, reflection_reuse, reflections, reflective_pixel
from torchrender.passes.picture import composite, enhancement, mesh_curvature, resample, scattering, transparency
from torchrender.passes.picture.resample import PICTURE as PICTURE
from torchrender.passes.seen import gbuffer, occluders, picture_visibility, ray_caster
from torchrender.passes.seen.gbuffer import GBUFFER as GBUFFER
from torchrender.pipeline.options import RenderOptions

# The first sets the number of pixels. Where several make a buffer, the first that applies does.
PASSES: tuple[Pass, ...] = (
    gbuffer.PASS,
    reflective_pixel.PASS,
    light_reach.PASS,
    ray_caster.PASS,
    occluders.PASS,
    shadow_map.PASS,
    point_shadow.PASS,
    soft_shadow.PASS,
    pane_shadow.PASS,
    ambient_visibility.PASS,
    direct_light.PASS,
    sky_shadow.PASS,
    hit_shader.PASS,
    reflection_reuse.PASS,
    reflections.PASS,
    key_frame.PASS,
    scattering.PASS,
    transparency.PASS,
    mesh_curvature.PASS,
    enhancement.PASS,
    composite.PASS,
    picture_visibility.PASS,
    resample.PASS,
)


def table_of(options: RenderOptions) -> tuple[Pass, ...]:
    """The passes to render with: those of the options, else the built-in ones."""
    return PASSES if options.passes is None else options.passes


def find_pass(name: str, passes: Sequence[Pass] = PASSES) -> Pass:
    """The pass of that name.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    for step in passes:
        if step.name == name:
            return step
    raise InputError(f"there is no pass {name!r}; known passes: {', '.join(p.name for p in passes)}")
