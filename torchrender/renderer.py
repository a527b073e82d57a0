"""Scene and camera in, picture out: makes a plan, runs its passes, and hands on what the next picture can use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from torchrender.clock import StepClock
from torchrender.errors import InputError
from torchrender.image import Image
from torchrender.passes.table import Pass
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import load_curves
from torchrender.planning.plan import Plan
from torchrender.planning.planner import (
    CUSTOM,
    WANTED,
    Knowledge,
    check_buffers,
    check_fixed,
    check_wishes,
    make_load,
    make_plan,
)
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene, resized

DEFAULT_SIZE = (1024, 768)


def render(
    scene: Scene | str | Path,
    camera: Cameras | str | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
    budget_ms: float | None = None,
    max_error: float | None = None,
) -> Image:
    """Pictures of a scene, one per camera.

    Args:
        scene: a scene, or the name or file of one.
        camera: cameras, the name of one of the scene's cameras, or None for its first, or where it has none one that
            frames the scene.
        width, height: size of the picture in pixels; the default is the size of ``camera`` where cameras are given,
            else 1024 x 768. Cameras of another shape keep their vertical opening angle.
        history: ``RenderHistory()`` starts a sequence of pictures, ``image.history`` of one picture is for the next.
            Shadow maps, ray caster and reflections are then used again as far as the scene has stood still; reused
            reflections are close to traced ones, not the same. See :class:`torchrender.pipeline.history.RenderHistory`.
        budget_ms: time that the picture may take, loading of the scene apart. The settings of all passes are chosen
            for the least error within it. The picture is always complete; ``image.plan`` tells what was chosen, what
            was predicted and what it took, and says so if the budget is not enough for the cheapest settings.
        max_error: mean FLIP, in [0,1], that the picture may be away from one with every pass at its reference. The
            quickest settings are chosen that keep it; with a budget, too, that comes first.

    A scene without any light gets :meth:`Scene.with_default_light`. A scene without triangles gives its background.

    Raises:
        SceneFileError: the scene cannot be loaded.
        InputError: no camera, buffer or pass of that name; a size or an option out of range.
        OptionError: ``budget_ms`` not positive, ``max_error`` outside [0, 1].
    """
    check_wishes(budget_ms, max_error)
    options = options or RenderOptions()
    check_buffers(options.buffers)
    check_fixed(options)
    clock = StepClock()
    if not isinstance(scene, Scene):
        with clock.measure("load"):
            scene = load(scene)
    with clock.measure("total"):
        cameras = view_of(scene, camera, width, height)
        knowledge = Knowledge.of(scene, cameras, history, load_curves(), options.buffers)
        run = Run(knowledge, options, (budget_ms, max_error), clock)
        image = run.image()
    plan = run.plan.measured(clock.elapsed_ms, run.amounts, clock.elapsed_ms["total"])
    kept = None if history is None else run.history(plan)
    return replace(image, plan=plan, timings_ms=clock.elapsed_ms, history=kept)


def view_of(scene: Scene, camera: Cameras | str | None, width: int | None, height: int | None) -> Cameras:
    """The cameras that :func:`render` takes; same arguments and errors."""
    if isinstance(camera, Cameras):
        return resized(camera, width or camera.width, height or camera.height)
    if camera is not None and not isinstance(camera, str):
        raise InputError(f"camera must be Cameras, a name or None, got {type(camera).__name__}")
    return scene.camera(camera, width=width or DEFAULT_SIZE[0], height=height or DEFAULT_SIZE[1])


@dataclass(eq=False)
class Run:
    """A plan that is made, and run by :meth:`image`."""

    knowledge: Knowledge
    wished: RenderOptions
    limits: tuple[float | None, float | None]  # budget, error bound
    clock: StepClock
    plan: Plan = field(init=False)
    frame: Frame = field(init=False)
    amounts: dict[str, tuple[float, ...]] = field(default_factory=dict)  # of work, by pass

    def __post_init__(self) -> None:
        known = self.knowledge
        with self.clock.measure("plan"):
            self.plan = make_plan(self.knowledge, self.wished, *self.limits)
        self.frame = Frame(scene=known.scene, cameras=known.cameras, options=self.wished, past=known.past)
        self.frame.choose(self.plan.options)

    def image(self) -> Image:
        """Run the passes; a buffer is dropped once nobody needs it any more."""
        steps = {step.name: step for step in self.knowledge.passes}
        done: list[str] = []
        while True:
            left = [row.name for row in self.plan.running if row.name not in done]
            if not left:
                break
            self._weigh(steps[left[0]])
            with self.clock.measure(left[0]):
                made = steps[left[0]].run(self.frame)
            self.frame.buffers[steps[left[0]].makes] = made
            done.append(left[0])
            if left[0] == "gbuffer":
                self._look_again()
                left = [left[0], *(row.name for row in self.plan.running if row.name not in done)]
            self._forget([steps[name] for name in left[1:]])
        rendered = self.frame.buffers.get("gbuffer")
        return Image(
            radiance=self.frame.buffers[WANTED],
            cameras=self.frame.cameras,
            scene=self.frame.scene,
            buffers={name: self.frame.buffers[name] for name in self.knowledge.wanted if name in self.frame.buffers},
            rendered=rendered if self.frame.options.supersample <= 1 else None,
            seen=self.frame.seen,
            exposure=self.wished.exposure,
            tone_map=self.wished.tone_map,
        )

    def _look_again(self) -> None:
        """The pixels that mirror, and a part of the time, are known: reasons, and what is left to choose, follow."""
        mirrors = self.knowledge.outlook(self.frame.options).reflects
        if not mirrors and self.limits[0] is None:
            return
        with self.clock.measure("plan"):
            rendered = self.frame.buffers["gbuffer"].triangle.numel()
            share = len(self.frame.reflectors()) / rendered if mirrors else None
            # The choice starts from the history as it came: what the first choice dropped may still serve.
            self.frame.past = self.knowledge.past
            self.knowledge = replace(self.knowledge, reflective_share=share)
            spent = dict(self.clock.elapsed_ms)
            self.plan = make_plan(self.knowledge, self.frame.options, *self.limits, spent_ms=spent)
            self.frame.choose(self.plan.options)

    def _weigh(self, step: Pass) -> None:
        """Note how much work the pass has; a key frame of reuse is another pass's work."""
        setting = self.plan.row(step.name).setting
        key_frame = step.name == "reflection_reuse" and (self.frame.past.reuse is None or self.frame.past.reuse.renew)
        if setting != CUSTOM and not key_frame:
            load_ = make_load(replace(self.knowledge, past=self.frame.past), self.frame.options)
            self.amounts[step.name] = step.work(load_, step.knob.setting(setting))

    def _forget(self, left: list[Pass]) -> None:
        """Release the buffers that no pass asks for; a G-buffer that is no larger than the picture stays with it."""
        asked = {name for step in left for name in (*step.needs, *step.uses)} | set(self.knowledge.wanted)
        if self.frame.options.supersample <= 1:
            asked.add("gbuffer")
        for name in [name for name in self.frame.buffers if name not in asked]:
            del self.frame.buffers[name]

    def history(self, plan: Plan) -> RenderHistory:
        """What the next picture of the sequence starts from."""
        pace = self.knowledge.pace.aged({(row.name, row.setting) for row in plan.running})
        for row in plan.running:
            if row.amounts is not None and row.measured_ms is not None:
                raw = self.knowledge.curves.time_ms(row.name, row.setting, row.amounts, self.knowledge.name)
                pace = pace.learned(row.name, row.setting, row.measured_ms, raw or 0.0)
        share = self.knowledge.reflective_share
        choice: Mapping[str, str] = {row.name: row.setting for row in plan.rows}
        pace = replace(pace, choice=choice, reflective_share=pace.reflective_share if share is None else share)
        return replace(self.frame.past, pace=pace)
