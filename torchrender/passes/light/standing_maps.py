"""Shadow maps over the pictures of a sequence in which something moves.

What stands still is drawn once, what moves anew for each picture into a copy: see
:mod:`torchrender.effects.shadows.movers`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from torchrender.buffers import ShadowMap
from torchrender.effects.shadows.movers import covers, deeper, with_movers
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.effects.shadows.shadow_map import draw_shadow_map
from torchrender.pipeline.buffer import Buffer, Lasting, triangles_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.options import RenderOptions, lasting_shadows
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry, Mesh
from torchrender.scene.model import Scene

Maps = tuple[ShadowMap | None, ...]
MOST_MOVING = 0.5
"""Of a scene's triangles: where more of them move, everything is drawn anew."""


@dataclass(frozen=True, eq=False)
class StandingMaps:
    """Maps of the meshes that stood still, of the picture's views and of everything."""

    meshes: tuple[Mesh, ...]
    picture: Maps
    everything: Maps


def lit_by(scene: Scene) -> tuple[Any, ...]:
    """What else shadows depend on but where meshes are."""
    return (triangles_of(scene)[1], scene.lights)


def _made_with(options: RenderOptions) -> tuple[Any, ...]:
    return (options.shadows, lasting_shadows(options))


STANDING_MAPS = Buffer("standing_shadow_map", StandingMaps, lasting=Lasting(lit_by, _made_with, shared=False))


class Moving:
    """What of a scene stands still, what does not, and maps of the former that can be used again."""

    def __init__(self, scene: Scene, kept: StandingMaps, still: tuple[Mesh, ...]) -> None:
        self._scene, self._still = scene, still
        stands = {id(mesh) for mesh in still}
        self._movers = tuple(mesh for mesh in scene.meshes if id(mesh) not in stands)
        unchanged = len(still) == len(kept.meshes)
        nothing: Maps = (None,) * len(scene.lights)
        self.drawn = {
            "picture": list(kept.picture if unchanged else nothing),
            "everything": list(kept.everything if unchanged else nothing),
        }

    @classmethod
    def of(cls, frame: Frame) -> Moving | None:
        """None where nothing moved, where most of the scene did, or nothing is known of earlier pictures."""
        kept, scene = frame.earlier(STANDING_MAPS), frame.scene
        if kept is None or not frame.history.sequence or len(kept.picture) != len(scene.lights):
            return None
        now = {id(mesh) for mesh in scene.meshes}
        still = tuple(mesh for mesh in kept.meshes if id(mesh) in now)
        count = sum(len(mesh.faces) for mesh in still)
        if len(still) == len(scene.meshes) or count < (1.0 - MOST_MOVING) * scene.geometry.triangle_count:
            return None
        return cls(scene, kept, still)

    def standing(self) -> StandingMaps:
        """What the next picture starts from."""
        return StandingMaps(self._still, tuple(self.drawn["picture"]), tuple(self.drawn["everything"]))

    def draw(
        self, kind: str, number: int, views: tuple[Cameras, tuple[int, ...] | None], how: ShadowOptions
    ) -> ShadowMap:
        """The map of light ``number`` from these views."""
        cameras, starts = views
        still = self.drawn[kind][number]
        if still is None or still.starts != starts or not covers(still.cameras, cameras):
            still = draw_shadow_map(self._standing_geometry, deeper(cameras), starts, how)
            self.drawn[kind][number] = still
        return with_movers(still, self._moving_geometry, how.cull)

    @cached_property
    def _standing_geometry(self) -> Geometry:
        return replace(self._scene, meshes=self._still).geometry

    @cached_property
    def _moving_geometry(self) -> Geometry:
        return replace(self._scene, meshes=self._movers).geometry


Draw = Callable[[str, int, tuple[Cameras, tuple[int, ...] | None], ShadowOptions], ShadowMap]


def drawing(frame: Frame, moving: Moving | None) -> Draw:
    """How the maps of a picture are drawn: ``moving`` or at once."""

    def at_once(kind: str, number: int, views: tuple[Cameras, tuple[int, ...] | None], how: ShadowOptions) -> ShadowMap:
        del kind, number
        return draw_shadow_map(frame.scene.geometry, *views, how)

    return at_once if moving is None else moving.draw
