"""What is known about a picture before it is made, and how much work that means for its passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from torchrender.passes.load import Load, map_views
from torchrender.passes.outlook import Outlook, reflectors_in_view
from torchrender.passes.table import PASSES, Pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.planning.curves import Curves, scene_key
from torchrender.planning.search import Question
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

WANTED = "picture"

UNSEEN_SHARE = 0.3
"""Share of the pixels that are taken to mirror before a picture of the scene was made."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Knowledge:
    """What the planner knows about a picture."""

    scene: Scene
    cameras: Cameras
    past: RenderHistory
    curves: Curves
    passes: tuple[Pass, ...] = PASSES
    wanted: tuple[str, ...] = (WANTED,)  # buffers
    reflective_share: float | None = None  # of the rendered pixels, once they are known
    reflectors: int = -1  # in view; counted once, and kept by ``replace``

    def __post_init__(self) -> None:
        if self.reflectors < 0:
            object.__setattr__(self, "reflectors", reflectors_in_view(self.scene, self.cameras))

    @classmethod
    def of(
        cls,
        scene: Scene,
        cameras: Cameras,
        history: RenderHistory | None,
        curves: Curves,
        buffers: Sequence[str] = (),
    ) -> Knowledge:
        """Before a picture of a scene as it was given; without a history it is one alone."""
        alone = RenderHistory(scene=scene.with_default_light(), wanted=False)
        past = alone if history is None else history.of_scene(scene)
        wanted = (WANTED, *buffers)
        return cls(scene=past.scene or scene, cameras=cameras, past=past, curves=curves, wanted=wanted)

    @property
    def pace(self) -> Pace:
        """What the sequence's pictures took so far."""
        return self.past.pace or Pace()

    @property
    def name(self) -> str:
        """Name under which the scene was measured."""
        return scene_key(self.scene)

    def outlook(self, options: RenderOptions) -> Outlook:
        """The same for the reasons of passes."""
        return Outlook(
            scene=self.scene,
            cameras=self.cameras,
            options=options,
            reflectors_in_view=self.reflectors,
            sequence=self.past.wanted,
            mirrored=self.reflective_share,
        )


def make_load(knowledge: Knowledge, options: RenderOptions) -> Load:
    """What a picture with these options brings its passes."""
    scene, past, cameras = knowledge.scene, knowledge.past, knowledge.cameras
    view = cameras if options.supersample == 1 else cameras.scaled(options.supersample)
    pixels = 1e-6 * len(view) * view.width * view.height
    outlook = knowledge.outlook(options)
    share = knowledge.reflective_share
    if share is None:
        share = knowledge.pace.reflective_share
    if share is None:
        share = UNSEEN_SHARE
    return Load(
        picture=1e-6 * len(cameras) * cameras.width * cameras.height,
        pixels=pixels,
        triangles=1e-6 * scene.geometry.triangle_count,
        views=sum(map_views(light) for light in scene.lights),
        map_size=_map_size(past),
        point_lights=outlook.point_lights,
        area_lights=outlook.area_lights,
        reflective=share * pixels if outlook.reflects else 0.0,
        caster=past.caster is not None,
        occluders=past.occluders is not None,
        shader=past.shader is not None,
    )


def _map_size(past: RenderHistory) -> int | None:
    for made in past.shadow_maps or ():
        if made is not None:
            return int(made.depth.shape[-1])
    return None


def question_about(knowledge: Knowledge) -> Question:
    """A question without open settings: for predictions."""
    return Question(
        passes=(), settings={}, loads={}, curves=knowledge.curves, scene=knowledge.name, pace=knowledge.pace,
        reusable=None,
    )  # fmt: skip


def reuses(knowledge: Knowledge, options: RenderOptions) -> bool:
    """The history holds reflections that a picture with these options can use again."""
    kept = reusable(knowledge)
    if kept is None:
        return False
    return all(step.knob.current(options) == kept[step.name] for step in knowledge.passes if step.name in kept)


def reusable(knowledge: Knowledge) -> Mapping[str, str] | None:
    """Settings that pictures must keep to use the history's reflections again; None if there are none to use."""
    past = knowledge.past
    if past.reuse is None or past.reuse.renew:
        return None
    choice = knowledge.pace.choice
    return {name: choice[name] for name in ("gbuffer", "reflections") if name in choice}
