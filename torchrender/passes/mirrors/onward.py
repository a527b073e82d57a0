"""How a picture's mirrors see: the shader of what they show, and what mirrors in mirrors do."""

from __future__ import annotations

from torchrender.effects.reflections.bounces import traced_onward
from torchrender.effects.reflections.clustered import clustered_onward
from torchrender.effects.reflections.reflectors import Onward, RayShader
from torchrender.passes.mirrors.air import InAir, before_mirrors
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.pipeline.behind_panes import BehindPanes
from torchrender.pipeline.frame import Frame


def mirror_shader(frame: Frame) -> RayShader:
    """The shader of hits, through see-through surfaces before them where the scene has some."""
    options, shader = frame.options, frame[HIT_SHADER]
    if frame.scene.geometry.see_through is None or options.transparency == "off":
        return shader
    return BehindPanes(frame.scene, shader, layers=options.transparent_layers)


def onward_of(frame: Frame, shader: RayShader) -> Onward | None:
    """What mirrors in mirrors show, by rays where there are some, else by clusters; None: the guess of the shader."""
    options, caster = frame.options, frame.get(RAY_CASTER)
    air = InAir(frame, shader) if before_mirrors(frame.scene, options) else None
    further, bounces = shader if air is None else air, options.tracing.bounces
    if caster is not None:
        onward = traced_onward(caster, further, bounces, options.tracing.lobe)
    else:
        onward = clustered_onward(frame.scene, frame.cameras, further, options.reflection, bounces)
    return air.guess if onward is None and air is not None else onward
