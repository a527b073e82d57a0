"""Scene and camera in, picture out: makes a plan, runs its passes, and hands on what the next picture can use."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from torch import Tensor

from torchrender.arrays import in_single_precision
from torchrender.buffers import GBuffer
from torchrender.checks import options_of
from torchrender.clock import StepClock, garbage_left
from torchrender.errors import InputError
from torchrender.image import Image
from torchrender.passes.contract import Buffers
from torchrender.passes.picture.composite import COMPOSITE
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import GBUFFER
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.doubts import say, scene_doubts, shadow_doubts
from torchrender.pipeline.gradients import check_gradients
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace
from torchrender.planning.ahead import go_on
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import load_curves
from torchrender.planning.plan import Plan
from torchrender.planning.planner import check_names, check_wishes, wishes_about
from torchrender.run import Run
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import DEFAULT_SIZE, Scene, resized, sides

if TYPE_CHECKING:
    from torchrender.points.cloud import PointCloud
    from torchrender.points.options import PointImage
    from torchrender.points.tree import PatchSet

LOOK = 0.5
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
@in_single_precision
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
        camera: cameras, the name of one of the scene's, or None for its first, or where it has none one that frames it.
        width, height: size of the picture in pixels; the default is the size of ``camera`` where cameras are given,
            else 1024 x 768; one side alone keeps that shape. Others keep the camera's vertical opening angle.
        history: ``RenderHistory()`` starts a sequence of pictures, ``image.history`` of one picture is for the next.
            Shadow maps, ray caster and reflections are then used again as far as the scene has stood still; reused
            reflections are close to traced ones, not the same. See :class:`torchrender.pipeline.history.RenderHistory`.
        budget_ms: time that the picture may take, loading of the scene apart. The settings of all passes are chosen
            for the least error within it. The picture is always complete; ``image.plan`` tells what was chosen,
            predicted and took, and says so if the budget is not enough for the cheapest settings.
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

        given = {"options": options, "history": history, "budget_ms": budget_ms, "max_error": max_error}
        return picture(scene, camera, (width, height), given)
    check_wishes(budget_ms, max_error)
    check_names(options := options_of(options, RenderOptions))
    _check_history(history)
    clock = StepClock(watched=budget_ms is not None)
    if not isinstance(scene, Scene):
        with clock.measure("load"):
            scene = load(scene)
    with garbage_left() if budget_ms is not None else nullcontext(), clock.measure("total"):
        cameras = view_of(scene, camera, width, height)
        check_gradients("render", scene, options)
        knowledge = Knowledge.of(scene, cameras, options, history, load_curves())
        wishes = wishes_about(cameras, budget_ms, max_error)
        if wishes[0] is None and wishes[1] is not None and knowledge.blind:
            knowledge = _looked(knowledge, history, clock)
        image = (run := Run(knowledge, wishes, clock)).image()
        say([*scene_doubts(scene), *shadow_doubts(scene, run.plan.options), *run.doubts])
    kept = None if history is None else _history_of(run)
    return replace(image, plan=run.measured(), timings_ms=clock.elapsed_ms, history=kept)


def _history_of(run: Run) -> RenderHistory:
    """What the next picture starts from, with what is chosen for it in time that is left of a budget."""
    plan, (budget_ms, max_error) = run.measured(), run.limits
    kept = run.history(plan)
    if budget_ms is None or max_error is not None:
        return kept
    with garbage_left():
        return replace(kept, pace=go_on(run.knowledge, kept, budget_ms, run.clock, plan.predicted_error))


def _looked(knowledge: Knowledge, history: RenderHistory | None, clock: StepClock) -> Knowledge:
    """With what passes sense in a picture of a quarter of the pixels, and what lasts of it."""
    outlook, curves = knowledge.outlook, knowledge.curves
    scene, cameras, options = outlook.history.given or outlook.scene, outlook.cameras, outlook.options
    steps = [step for step in knowledge.passes if step.settings.is_choice]
    held = tuple(step.name for step in steps if step.settings.current(options) != CUSTOM)
    coarse = replace(options, supersample=min(options.supersample, LOOK), upscaling="nearest", fixed=held)
    past = RenderHistory() if history is None else history
    with clock.measure("senses"):
        run = Run(Knowledge.of(scene, cameras, coarse, past, curves), (NO_LIMIT, None), StepClock())
        run.buffers({})
        found = run.history(run.plan)
    if history is None:
        found = replace(found.shared(), sequence=False)
    sensed = {} if found.pace is None else found.pace.known
    return Knowledge.of(
        scene, cameras, options, replace(found, pace=replace(past.pace or Pace(), known=sensed, search=None)), curves
    )


def _check_history(history: object) -> None:
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


@in_single_precision
def light_of_samples(
    scene: Scene, samples: GBuffer, options: RenderOptions | None = None, history: RenderHistory | None = None
) -> LitSamples:
    """:func:`shade_samples` with its plan and what it leaves; same arguments."""
    history = RenderHistory.alone() if history is None else replace(history, sequence=False)
    clock = StepClock()
    with clock.measure("total"):
        knowledge = Knowledge.of(scene, samples.cameras, options_of(options, RenderOptions), history, load_curves())
        past = knowledge.outlook.history
        chosen = knowledge.outlook.options
        for step in knowledge.passes:
            chosen = step.over_samples(chosen, past)
        outlook = replace(knowledge.outlook.at(chosen), samples=samples)
        run = Run(replace(knowledge, outlook=outlook, wanted=(COMPOSITE,), given=(GBUFFER,)), (None, None), clock)
        radiance = run.buffers({GBUFFER: samples})[COMPOSITE]
    plan = run.plan.measured(clock.elapsed_ms, run.amounts, clock.elapsed_ms["total"])
    return LitSamples(radiance, plan, run.history(plan).shared())


@in_single_precision
def make_buffers(
    scene: Scene,
    cameras: Cameras,
    wanted: Buffers,
    options: RenderOptions | None = None,
    *,
    given: Mapping[Buffer[Any], Any] | None = None,
) -> dict[Buffer[Any], Any]:
    """Buffers of a picture that is not made to its end, by name; those in ``given`` are taken as they are."""
    knowledge = Knowledge.of(scene, cameras, options_of(options, RenderOptions), None, load_curves())
    run = Run(replace(knowledge, wanted=wanted, given=tuple(given or ())), (None, None), StepClock())
    return run.buffers(given or {})


def view_of(scene: Scene, camera: Cameras | str | None, width: int | None, height: int | None) -> Cameras:
    """The cameras that :func:`render` takes; same arguments and errors."""
    if isinstance(camera, Cameras):
        return resized(camera, *sides((width, height), (camera.width, camera.height)))
    if camera is not None and not isinstance(camera, str):
        raise InputError(f"camera must be Cameras, a name or None, got {type(camera).__name__}")
    return scene.camera(camera, **sides((width, height), DEFAULT_SIZE)._asdict())
