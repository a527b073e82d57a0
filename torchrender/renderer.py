"""Scene and camera in, picture out: makes a plan, runs its passes, and hands on what the next picture can use."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.clock import StepClock
from torchrender.errors import InputError
from torchrender.image import Image
from torchrender.passes.contract import Buffers, Pass
from torchrender.passes.light.direct_light import MIRROR_SHARE
from torchrender.passes.outlook import Outlook
from torchrender.passes.picture.composite import COMPOSITE
from torchrender.passes.seen.picture_visibility import PICTURE_VISIBILITY
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import GBUFFER, PICTURE, table_of
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.doubts import Doubt, exposure_of, picture_doubts, say, scene_doubts, view_doubts
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.gradients import check_gradients
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.planning.costs import Knowledge, sense_of
from torchrender.planning.curves import load_curves
from torchrender.planning.graph import Graph
from torchrender.planning.plan import Plan
from torchrender.planning.planner import check_names, check_wishes, make_plan
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import DEFAULT_SIZE, Scene, resized, sides
from torchrender.shade import SentLight

if TYPE_CHECKING:
    from torchrender.points.cloud import PointCloud
    from torchrender.points.options import PointImage
    from torchrender.points.tree import PatchSet

LOOK = 0.25
"""Rendered pixels per pixel and side where a picture is looked at before its settings are chosen."""

NO_LIMIT = 1e9
"""A budget, in ms, that holds nobody back: passes sense only where there is one."""


@overload
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
) -> Image: ...
@overload
def render(
    scene: PointCloud | PatchSet,
    camera: Cameras | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
) -> PointImage: ...
def render(
    scene: Scene | PointCloud | PatchSet | str | Path,
    camera: Cameras | str | None = None,
    *,
    width: int | None = None,
    height: int | None = None,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
    budget_ms: float | None = None,
    max_error: float | None = None,
) -> Image | PointImage:
    """Pictures of a scene, one per camera.

    Args:
        scene: a scene, or the name or file of one. A point cloud or patch set is drawn by
            :func:`~torchrender.points.draw.render_points`, which has options of its own.
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
    Gradients reach colours, textures, lights and environments, with visibility as it is; not meshes, not cameras.

    Raises:
        SceneFileError: the scene cannot be loaded.
        InputError: no camera, buffer or pass of that name; a size or an option out of range.
        OptionError: ``budget_ms`` not positive, ``max_error`` outside [0, 1]. GradientError: a mesh wants a gradient.
    """
    if not isinstance(scene, Scene | str | Path):
        from torchrender.points.picture import picture

        wishes = {"options": options, "history": history, "budget_ms": budget_ms, "max_error": max_error}
        return picture(scene, camera, (width, height), wishes)
    check_wishes(budget_ms, max_error)
    options = options or RenderOptions()
    _check_kinds(options, history)
    check_names(options)
    clock = StepClock(watched=budget_ms is not None)
    if not isinstance(scene, Scene):
        with clock.measure("load"):
            scene = load(scene)
    with clock.measure("total"):
        cameras = view_of(scene, camera, width, height)
        check_gradients("render", scene, options)
        curves = load_curves()
        knowledge = Knowledge.of(scene, cameras, options, history, curves)
        if max_error is not None and budget_ms is None and knowledge.blind:
            with clock.measure("senses"):
                looked = first_look(scene, cameras, options, history)
            knowledge = Knowledge.of(scene, cameras, options, looked, curves)
        run = Run(knowledge, (budget_ms, max_error), clock)
        image = run.image()
        say([*scene_doubts(scene), *run.doubts])
    plan = run.plan.measured(clock.elapsed_ms, run.amounts, clock.elapsed_ms["total"], waited=clock.waited)
    kept = None if history is None else run.history(plan)
    return replace(image, plan=plan, timings_ms=clock.elapsed_ms, history=kept)


def first_look(scene: Scene, cameras: Cameras, options: RenderOptions, history: RenderHistory | None) -> RenderHistory:
    """The history with what passes sense in a picture of a sixteenth of the pixels, and what lasts of it."""
    steps = [step for step in table_of(options) if step.settings.is_choice]
    held = tuple(step.name for step in steps if step.settings.current(options) != CUSTOM)
    coarse = replace(options, supersample=min(options.supersample, LOOK), upscaling="nearest")
    past = RenderHistory() if history is None else history
    knowledge = Knowledge.of(scene, cameras, replace(coarse, fixed=held), past, load_curves())
    run = Run(knowledge, (NO_LIMIT, None), StepClock())
    run.buffers({})
    found = run.history(run.plan)
    if history is None:
        found = replace(found.shared(), sequence=False)
    return replace(found, pace=replace(past.pace or Pace(), known=found.pace.known if found.pace is not None else {}))


def _check_kinds(options: object, history: object) -> None:
    if not isinstance(options, RenderOptions):
        raise InputError(f"options must be RenderOptions, got {type(options).__name__}")
    if not isinstance(history, RenderHistory | None):
        raise InputError(f"history must be a RenderHistory, such as image.history, got {type(history).__name__}")


def shade_samples(
    scene: Scene,
    samples: GBuffer,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
) -> Tensor:
    """Radiance (B,H,W,3) of samples that need not be the nearest surfaces, by the passes of a picture.

    Each pass runs at the setting that it has for samples which are not the eye's (:attr:`Pass.over_samples`), and all
    layers are blended as in a picture.

    Args:
        scene: as it was given to the picture.
        samples: (B,H,W) of the scene; empty ones get the background.
        history: what a picture of the scene left: what lasts is used again.
    """
    return light_of_samples(scene, samples, options, history).radiance


@dataclass(frozen=True, eq=False)
class LitSamples:
    """Samples with their light, and what it took."""

    radiance: Tensor  # (B,H,W,3) linear
    plan: Plan  # what was done, with its times
    history: RenderHistory  # what lasts, for further samples and pictures of the scene


def light_of_samples(
    scene: Scene, samples: GBuffer, options: RenderOptions | None = None, history: RenderHistory | None = None
) -> LitSamples:
    """:func:`shade_samples` with its plan and what it leaves; same arguments."""
    history = RenderHistory.alone() if history is None else replace(history, sequence=False)
    clock = StepClock()
    with clock.measure("total"):
        knowledge = Knowledge.of(scene, samples.cameras, options or RenderOptions(), history, load_curves())
        past = knowledge.outlook.history
        chosen = knowledge.outlook.options
        for step in knowledge.passes:
            chosen = step.over_samples(chosen, past)
        outlook = replace(knowledge.outlook.at(chosen), samples=samples)
        run = Run(replace(knowledge, outlook=outlook, wanted=(COMPOSITE,), given=(GBUFFER,)), (None, None), clock)
        radiance = run.buffers({GBUFFER: samples})[COMPOSITE]
    plan = run.plan.measured(clock.elapsed_ms, run.amounts, clock.elapsed_ms["total"])
    return LitSamples(radiance, plan, run.history(plan).shared())


def make_buffers(
    scene: Scene,
    cameras: Cameras,
    wanted: Buffers,
    options: RenderOptions | None = None,
    *,
    given: Mapping[Buffer[Any], Any] | None = None,
) -> dict[Buffer[Any], Any]:
    """Buffers of a picture that is not made to its end, by name; those in ``given`` are taken as they are."""
    knowledge = Knowledge.of(scene, cameras, options or RenderOptions(), None, load_curves())
    run = Run(replace(knowledge, wanted=wanted, given=tuple(given or ())), (None, None), StepClock())
    return run.buffers(given or {})


def view_of(scene: Scene, camera: Cameras | str | None, width: int | None, height: int | None) -> Cameras:
    """The cameras that :func:`render` takes; same arguments and errors."""
    if isinstance(camera, Cameras):
        return resized(camera, *sides((width, height), (camera.width, camera.height)))
    if camera is not None and not isinstance(camera, str):
        raise InputError(f"camera must be Cameras, a name or None, got {type(camera).__name__}")
    return scene.camera(camera, **sides((width, height), DEFAULT_SIZE)._asdict())


@dataclass(eq=False)
class Run:
    """A plan that is made, and run by :meth:`image`."""

    knowledge: Knowledge
    limits: tuple[float | None, float | None]  # budget, error bound
    clock: StepClock
    plan: Plan = field(init=False)
    graph: Graph = field(init=False)
    values: dict[Buffer[Any], Any] = field(init=False, default_factory=dict)
    lasting: dict[Buffer[Any], Any] = field(init=False, default_factory=dict)  # made here, for the next picture
    amounts: dict[str, tuple[float, ...]] = field(init=False, default_factory=dict)  # of work, by pass
    done: list[str] = field(init=False, default_factory=list)  # passes that ran
    found: dict[str, float] = field(init=False, default_factory=dict)  # quantities, since the plan was made
    sensed: dict[str, float] = field(init=False, default_factory=dict)  # what errors of the next picture follow
    doubts: list[Doubt] = field(init=False, default_factory=list)  # about what cameras see

    def image(self) -> Image:
        """The picture."""
        self.buffers({})
        outlook, wanted = self.knowledge.outlook, self.knowledge.wanted
        if self.plan.options.supersample == 1:
            self.doubts += picture_doubts(outlook.scene, self.values[GBUFFER], self.values[PICTURE])
        return Image(
            radiance=self.values[PICTURE],
            cameras=outlook.cameras,
            scene=outlook.scene,
            buffers={buffer.name: self.values[buffer] for buffer in wanted if buffer in self.values},
            rendered=self.values.get(GBUFFER) if self.plan.options.supersample <= 1 else None,
            seen=self.values.get(PICTURE_VISIBILITY),
            exposure=exposure_of(outlook.scene, outlook.options),
            tone_map=outlook.options.tone_map,
        )

    def buffers(self, given: Mapping[Buffer[Any], Any]) -> dict[Buffer[Any], Any]:
        """Run the passes; a buffer is dropped once nobody needs it any more."""
        self.values.update(given)
        self._choose(self.knowledge.outlook.options)
        while True:
            left = [step for step in self.graph.running if step.name not in self.done]
            if not left:
                return self.values
            step, rest = left[0], left[1:]
            self._weigh(step)
            with self.clock.measure(step.name):
                self._take(step, step.run(self._frame()))
            self.done.append(step.name)
            if step.senses is not None and self.limits != (None, None) and self.knowledge.unseen:
                with self.clock.measure("senses"):
                    self.sensed |= {sense_of(name): value for name, value in step.senses(self._frame()).items()}
            if step.checkpoint is not None:
                self.found |= step.checkpoint(self._frame())
                if not rest or rest[0].checkpoint is None:
                    self._look_again()
            self._forget()

    def _choose(self, options: RenderOptions) -> None:
        """Make the plan, with other options if that is what it comes to."""
        with self.clock.measure("plan"):
            took = self.clock.elapsed_ms
            done = {name: took[name] for name in self.done}
            spent = sum(ms for name, ms in took.items() if name not in ("load", "total"))
            self.plan = make_plan(self.knowledge, options, *self.limits, done=done, spent_ms=spent)
            self.graph = self.knowledge.graph(self.plan.options)

    def _look_again(self) -> None:
        """More is known, and a part of the time is spent: reasons, and what is left to choose, follow."""
        if self.found or self.limits[0] is not None:
            self.knowledge, self.found = self.knowledge.found_out(**self.found), {}
            self._choose(self.plan.options)

    def _frame(self) -> Frame:
        """What the next pass gets."""
        outlook = self.knowledge.outlook
        return Frame(
            scene=outlook.scene,
            cameras=outlook.cameras,
            options=self.plan.options,
            history=outlook.history,
            values=self.values,
            asked=self.graph.asked,
            hits=self._over_hits,
            wanted=frozenset(self.knowledge.wanted),
        )

    def _over_hits(self, given: Mapping[Buffer[Any], Any], changes: Mapping[str, Any]) -> OverHits:
        """The same passes, over what rays hit."""
        outlook = self.knowledge.outlook
        groups = {name: replace(getattr(self.plan.options, name), **values) for name, values in changes.items()}
        options = replace(self.plan.options, **groups)
        for step in self.knowledge.passes:
            options = step.over_hits(options, outlook.history)
        alone = replace(outlook.history, sequence=False, kept={})
        over = replace(outlook, options=options, history=alone, known={}, facts={})
        knowledge = replace(self.knowledge, outlook=over, wanted=(COMPOSITE, MIRROR_SHARE), given=())
        return OverHits(knowledge, dict(given))

    def _take(self, step: Pass, made: Any) -> None:
        values = made if step.also else (made,)
        for buffer, value in zip(step.makes_all, values, strict=True):
            self.values[buffer] = buffer.checked(value)
            if buffer is GBUFFER:
                self.doubts += view_doubts(self.knowledge.outlook.scene, value)
            if buffer.lasting is not None:
                self.lasting[buffer] = value

    def _weigh(self, step: Pass) -> None:
        """Note how much work the pass has."""
        if self.plan.row(step.name).setting != CUSTOM:
            self.amounts[step.name] = step.amounts(self.knowledge.outlook.at(self.plan.options))

    def _forget(self) -> None:
        """Release the buffers that no pass asks for; a G-buffer that is no larger than the picture stays with it."""
        left = {step.makes for step in self.graph.running if step.name not in self.done}
        kept = set(self.knowledge.wanted) | {PICTURE_VISIBILITY}
        if self.plan.options.supersample <= 1:
            kept.add(GBUFFER)
        for buffer in list(self.values):
            if buffer not in kept and not self.graph.asked.get(buffer, frozenset()) & left:
                del self.values[buffer]

    def history(self, plan: Plan) -> RenderHistory:
        """What the next picture of the sequence starts from."""
        known = self.knowledge
        settings = {step.name: step.settings.current(plan.options) for step in known.passes}
        pace = known.pace.aged({(row.name, row.setting) for row in plan.running})
        for row in plan.running:
            if row.amounts is not None and row.measured_ms is not None:
                raw = known.curves.time_ms(row.name, row.setting, row.amounts, known.name)
                pace = pace.learned(row.name, row.setting, row.measured_ms, raw or 0.0)
        pace = replace(pace, choice=settings, known={**pace.known, **known.outlook.known, **self.sensed})
        past = known.outlook.history.with_picture(self.lasting.items(), plan.options)
        return replace(past, pace=pace)


@dataclass(eq=False)
class OverHits:
    """The passes of a picture over what rays hit; what lasts is made once, for all calls."""

    knowledge: Knowledge
    given: dict[Buffer[Any], Any]

    def __call__(self, samples: GBuffer | RaySurface) -> SentLight:
        """Radiance (B,H,W,3) of samples (B,H,W), reflections left out, and how these go into it."""
        cameras = samples.cameras if isinstance(samples, GBuffer) else self.knowledge.outlook.cameras
        outlook: Outlook = replace(self.knowledge.outlook, samples=samples, cameras=cameras)
        known = replace(self.knowledge, outlook=outlook, given=(GBUFFER, *self.given))
        run = Run(known, (None, None), StepClock())
        made = run.buffers({GBUFFER: samples, **self.given})
        self.given |= run.lasting
        return SentLight(made[COMPOSITE], made[MIRROR_SHARE])
