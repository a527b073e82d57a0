"""Options of pictures that somebody waits for while the view or the scene moves."""

from __future__ import annotations

from dataclasses import replace

from torchrender.effects.reflections.traced import TraceOptions
from torchrender.passes.light import ambient_visibility
from torchrender.passes.mirrors import reflections
from torchrender.passes.table import PASSES
from torchrender.pipeline.options import RenderOptions

QUICK_AMBIENT = "1 x 12"
"""Setting of ambient visibility in pictures that are made within a budget, however small."""
QUICK_MIRRORS = "traced"
"""The same of mirrors."""
ONE_RAY = TraceOptions(glossy_rays=1, bounces=1)
"""Of each mirroring pixel in these pictures; glossy ones share what the rays of their neighbours find."""


def as_bright(options: RenderOptions) -> RenderOptions:
    """With what hides light found quickly, and never left out to save time: without it pictures are brighter.

    That is ambient visibility, and what stands before mirrors: surroundings that are taken from the middle of a room
    show its windows in all of its floor, and nothing dark that stands there.
    """
    quick = options
    if options.ambient_visibility != "off":
        quick = ambient_visibility.PASS.settings.named(QUICK_AMBIENT).applied(quick)
        quick = replace(quick, fixed=(*quick.fixed, ambient_visibility.PASS.name))
    if options.reflections != "off":
        quick = reflections.PASS.settings.named(QUICK_MIRRORS).applied(quick)
        quick = replace(quick, tracing=ONE_RAY, fixed=(*quick.fixed, reflections.PASS.name))
    return quick


def quickest(options: RenderOptions) -> RenderOptions:
    """With the fastest setting of every pass, at as many pixels as the camera has; nothing is left to search for."""
    held = (*options.fixed, PASSES[0].name, ambient_visibility.PASS.name, reflections.PASS.name)
    quick = as_bright(options)
    for step in PASSES:
        if step.settings.all and step.name not in held:
            quick = step.settings.all[0].applied(quick)
    return quick
