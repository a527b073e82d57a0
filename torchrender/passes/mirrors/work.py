"""How much work reflections are: what their times follow."""

from __future__ import annotations

from torchrender.passes.contract import Amounts
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.mirrors.reflective_pixel import glossy, reflective
from torchrender.passes.outlook import Outlook
from torchrender.pipeline.frame import Frame

YOUNG = 3
"""Pictures after which rays that never asked for the surroundings will not."""

VIEWS = 300.0
"""Depth images that curved clusters need beside those of planes, per million reflective pixels."""

OF_LOBE = 7.0
"""Times a mirror's work where surroundings are looked up for a glossy pixel: several times, and shared."""

OF_POINT, OF_AREA, MOST_LIT = 0.5, 1.0, 8.0
"""Times the work of shading what is met that each light without and with an area adds to it, and the most of it all."""


def amounts(outlook: Outlook) -> Amounts:
    """Once, for mirrors and for glossy ones; reflective pixels, by their rays and the lights; triangles in pictures of
    clusters; the first look at the surroundings of hits, by the lights."""
    options, pixels, drawn, look = outlook.options, reflective(outlook), 0.0, False
    kinds, lobes = 1.0, glossy(outlook)
    shader = outlook.kept(HIT_SHADER)  # rays, and clusters, that find mirrors over and over end in surroundings
    young = options.reflections == "environment" or outlook.history.pictures < YOUNG
    look = shader is None or (not shader.looked_around and young)
    if options.reflections == "environment":
        pixels += (OF_LOBE - 1.0) * lobes
    elif options.reflections == "traced" and lobes > 0.0:
        kinds += 1.0
        pixels += (options.tracing.glossy_rays - 1.0) * lobes
    if options.reflections == "clustered":
        drawn = outlook.triangles * (1.0 if options.reflection.missing == "trace" else 1.0 + VIEWS * pixels)
    lit = min(1.0 + OF_POINT * outlook.point_lights + OF_AREA * outlook.area_lights, MOST_LIT)
    return (kinds, pixels * (lit if options.reflections == "traced" else 1.0), drawn, lit * look)


def did(frame: Frame, amounts: Amounts) -> Amounts:
    """Of that; rays that find no mirrors over and over look at no surroundings."""
    return amounts if frame[HIT_SHADER].looked_around else (*amounts[:-1], 0.0)
