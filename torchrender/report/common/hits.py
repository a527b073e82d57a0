"""Colours of what rays hit, for studies of reflections alone."""

from __future__ import annotations

from collections.abc import Sequence

from torchrender.buffers import ShadowMap
from torchrender.passes.light.shadow_map import SCENE_SHADOW_MAP, SHADOW_MAP
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import make_buffers
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def hit_shader(
    scene: Scene, options: RenderOptions | None = None, maps: Sequence[ShadowMap | None] | None = None
) -> HitShader:
    """Colours of what rays hit in a scene, as a picture with these options has them.

    Args:
        scene: with its lights.
        maps: shadow maps, one per light; drawn where missing.
    """
    place = Cameras.look_at([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], width=1, height=1, near=1e-3)  # nobody looks from there
    given = {} if maps is None else dict.fromkeys((SHADOW_MAP, SCENE_SHADOW_MAP), tuple(maps))  # one pass makes both
    shader: HitShader = make_buffers(scene, place, (HIT_SHADER,), options, given=given)[HIT_SHADER]
    return shader
