"""What one picture hands to the next one of a sequence, as an explicit value.

Frames of a still scene share their shadow maps, their ray caster and the reflections of the last key frame. Nothing is
kept in the package itself: ``render(scene, camera, history=...)`` takes a history and its picture carries the next one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

from torchrender.brief import brief
from torchrender.pipeline.buffer import Buffer, look_of, same
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.pipeline.standing import same_faces
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

T = TypeVar("T")

LEAP, LEAP_DEG = 0.1, 30.0
"""Of the scene's diagonal, and degrees, by which an eye moves and turns to see something else."""


@dataclass(frozen=True, eq=False)
class Kept:
    """Something that outlives its picture, and what it was made from."""

    buffer: Buffer[Any]
    value: Any
    scene: tuple[Any, ...]
    options: tuple[Any, ...]
    settings: RenderOptions  # of the picture that made it
    picture: int  # its number in the sequence

    def holds(self, scene: Scene, options: RenderOptions | None = None) -> bool:
        """It was made from the same, as it is rendered; ``options`` None: whatever they are."""
        lasting = self.buffer.lasting
        assert lasting is not None
        if not same(self.scene, lasting.scene(scene)):
            return False
        return options is None or same(self.options, lasting.options(options))


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderHistory:
    """Start a sequence with ``RenderHistory()``; go on with ``image.history``.

    A part is used again only while what it was made from is the same (:class:`torchrender.pipeline.buffer.Lasting`).
    Scenes are frozen values: meshes, materials, lights, environments and media count as the same if they are the same
    objects, so an object that moves is a new mesh in a new scene (:meth:`Scene.moved`, :meth:`Scene.at`).

    - meshes at other places, faces as they were: shadow maps of what stands still are kept and what moves is drawn into
      them, the ray caster is brought up to date; so is what mirrors show, but of places that light reaches past what
      moved, and with the eye standing still the same goes for shadows;
    - other meshes, or another material with holes: nothing is kept;
    - other lights (the sun of an environment is one, so is the light of a scene that has none) or shadow options: the
      ray caster is kept;
    - another material, environment without a sun, ambient light, medium or background, or other options of
      reflections: the ray caster and the shadow maps are kept.
    """

    given: Scene | None = None  # as it came
    scene: Scene | None = (
        None  # as it was rendered: with a default light where it had none, with the sun of its sky as a light
    )
    kept: Mapping[str, Kept] = field(default_factory=dict)  # by name of the buffer
    pace: Pace | None = None  # what the pictures so far took, beside what was predicted
    pictures: int = 0  # made so far
    drawn: tuple[Mesh, ...] | None = None  # what the last picture showed
    seen_from: Cameras | None = None  # by these
    sequence: bool = True  # what belongs to one sequence is used again, too

    __repr__ = brief

    @classmethod
    def alone(cls) -> RenderHistory:
        """Of a picture that is part of no sequence."""
        return cls(sequence=False)

    def of_scene(self, scene: Scene) -> RenderHistory:
        """This history before a picture of ``scene``: with the scene as it will be rendered."""
        if self.given is not None and self.scene is not None and same(look_of(self.given), look_of(scene)):
            return self if self.given is scene else replace(self, given=scene, scene=_named_as(self.scene, scene))
        stands = self.given is None or same_faces(self.given.meshes, scene.meshes)
        lit = scene.with_default_light().with_sun_apart()
        return replace(self, given=scene, scene=lit, pace=self.pace if stands else None)

    @property
    def moves(self) -> bool:
        """Meshes are not those of the last picture."""
        return self.drawn is not None and self.given is not None and not same(self.drawn, self.given.meshes)

    def get(self, buffer: Buffer[T], options: RenderOptions | None = None) -> T | None:
        """What is kept of a buffer, if it was made from the same scene, and with ``options`` from the same of these."""
        kept = self.kept.get(buffer.name)
        if kept is None or kept.buffer is not buffer or self.scene is None:
            return None
        return buffer.checked(kept.value) if kept.holds(self.scene, options) else None

    def last(self, buffer: Buffer[T]) -> T | None:
        """What was kept of a buffer, whether it still holds or not: for who knows how to bring it up to date."""
        kept = self.kept.get(buffer.name)
        return buffer.checked(kept.value) if kept is not None and kept.buffer is buffer else None

    def newest(self, buffer: Buffer[T]) -> T | None:
        """What the last picture made of a buffer; None if it did not."""
        kept = self.kept.get(buffer.name)
        return buffer.checked(kept.value) if kept is not None and kept.picture == self.pictures else None

    def leaps_to(self, cameras: Cameras) -> bool:
        """The view has little to do with that of the last picture: what was sensed there says little here."""
        last, scene = self.seen_from, self.scene
        if last is None or scene is None:
            return False
        if len(last) != len(cameras):
            return True
        turned = (last.forward * cameras.forward).sum(dim=-1) < math.cos(math.radians(LEAP_DEG))
        return bool((turned | ((last.eye - cameras.eye).norm(dim=-1) > LEAP * scene.diagonal)).any())

    def with_picture(
        self, made: Iterable[tuple[Buffer[Any], Any]], options: RenderOptions, cameras: Cameras | None = None
    ) -> RenderHistory:
        """After a picture, by these cameras, that made these."""
        assert self.given is not None and self.scene is not None
        number = self.pictures + 1
        kept = {name: one for name, one in self.kept.items() if one.holds(self.scene)}
        for buffer, value in made:
            if buffer.lasting is not None:
                origin = buffer.lasting.scene(self.scene), buffer.lasting.options(options)
                kept[buffer.name] = Kept(buffer, value, *origin, options, number)
        return replace(self, kept=kept, pictures=number, drawn=self.given.meshes, seen_from=cameras)

    def shared(self) -> RenderHistory:
        """Without what belongs to one sequence: for another one of the same scene."""
        kept = {n: one for n, one in self.kept.items() if one.buffer.lasting is not None and one.buffer.lasting.shared}
        return replace(self, kept=kept)


_UNSEEN = ("name", "cameras", "motions", "photometric", "report")
"""What of a scene no light of a surface depends on."""


def _named_as(lit: Scene, scene: Scene) -> Scene:
    """A scene as it is rendered, with what of another one of the same look does not show in its light."""
    values = {name: getattr(scene, name) for name in _UNSEEN}
    return lit if all(getattr(lit, name) is value for name, value in values.items()) else lit.replace(**values)
