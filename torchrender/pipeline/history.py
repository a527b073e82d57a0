"""What one picture hands to the next one of a sequence, as an explicit value.

Frames of a still scene share their shadow maps, their ray caster and the reflections of the last key frame. Nothing is
kept in the package itself: ``render(scene, camera, history=...)`` takes a history and its picture carries the next one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch

from torchrender.buffers import ShadowMap
from torchrender.effects.reflections.reuse import ReuseReport, ReuseState
from torchrender.effects.shadows.soft_shadow import Occluders
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.pace import Pace
from torchrender.rays import RayCaster
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderHistory:
    """Start a sequence with ``RenderHistory()``; go on with ``image.history``.

    A part is used again only while what it was made from is the same. Scenes are frozen values: meshes, materials,
    lights, environments and media count as the same if they are the same objects, so an object that moves is a new
    mesh in a new scene, and everything that could show it is made anew.

    - another mesh, or another material with holes: nothing is kept;
    - other lights or shadow options: the ray caster is kept;
    - another material, environment, ambient light, medium or background, or other options of reflections: the ray
      caster and the shadow maps are kept.
    """

    given: Scene | None = None  # as it came
    scene: Scene | None = None  # as it was rendered: with a default light where it had none
    caster: RayCaster | None = None
    occluders: Occluders | None = None
    shadow_maps: Sequence[ShadowMap | None] | None = None
    shader: HitShader | None = None
    reuse: ReuseState | None = None
    report: ReuseReport | None = None  # how this picture's reflections were made; None: nothing mirrors
    shadow_settings: object = None  # options that the shadow maps were made with
    background: object = None  # that reflections show
    settings: object = None  # options that the reflections were made with
    pace: Pace | None = None  # what the pictures so far took, beside what was predicted
    wanted: bool = True  # a sequence: reflections are reused, not only made

    def of_scene(self, scene: Scene) -> RenderHistory:
        """What of this history holds for another picture, of ``scene``, with the same options."""
        fresh = RenderHistory(given=scene, scene=scene.with_default_light(), pace=self.pace, wanted=self.wanted)
        if self.given is None:
            return fresh
        if not _same_triangles(self.given, scene):
            return replace(fresh, pace=None)
        fresh = replace(fresh, caster=self.caster, occluders=self.occluders)
        if not _same(self.given.lights, scene.lights):
            return fresh
        fresh = replace(fresh, shadow_maps=self.shadow_maps, shadow_settings=self.shadow_settings)
        if not _same_look(self.given, scene):
            return fresh
        return replace(self, report=None)

    def with_options(self, shadow_settings: object, background: object, settings: object) -> RenderHistory:
        """What of it holds with other options: of shadows, the background, and of reflections."""
        kept = replace(self, shadow_settings=shadow_settings, background=background, settings=settings)
        if shadow_settings != self.shadow_settings:
            return replace(kept, shadow_maps=None, shader=None, reuse=None)
        if background != self.background:
            return replace(kept, shader=None, reuse=None)
        return kept if settings == self.settings else replace(kept, reuse=None)


def _same(first: Sequence[object], second: Sequence[object]) -> bool:
    return len(first) == len(second) and all(a is b for a, b in zip(first, second, strict=True))


def _same_triangles(first: Scene, second: Scene) -> bool:
    """Rays hit the same: the same meshes, and the same holes in them."""
    if not _same(first.meshes, second.meshes):
        return False
    holes = any(m.alpha_cutoff is not None for m in (*first.materials, *second.materials))
    return not holes or _same(first.materials, second.materials)


def _same_look(first: Scene, second: Scene) -> bool:
    return (
        _same(first.materials, second.materials)
        and _same(first.media, second.media)
        and first.environment is second.environment
        and torch.equal(first.ambient, second.ambient)
    )
