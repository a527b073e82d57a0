"""Runs the plan of a picture: pass by pass, planning anew where more is known, and handing on what lasts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from torchrender.buffers import GBuffer, RaySurface
from torchrender.clock import StepClock
from torchrender.errors import OptionError
from torchrender.image import Image
from torchrender.kernels.compile import Kernel
from torchrender.passes.contract import Pass
from torchrender.passes.light.direct_light import MIRROR_SHARE
from torchrender.passes.outlook import Outlook
from torchrender.passes.picture.composite import COMPOSITE
from torchrender.passes.seen.picture_visibility import PICTURE_VISIBILITY
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import GBUFFER, PICTURE
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.doubts import Doubt, exposure_of
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import (
    TOLERANCE,
    UNPRICED,
    Pace,
    Search,
    looks,
)
from torchrender.pipeline.view_doubts import picture_doubts, view_doubts
from torchrender.planning.costs import Knowledge, sense_of
from torchrender.planning.graph import Graph
from torchrender.planning.learned import beside, unpriced
from torchrender.planning.plan import Plan
from torchrender.planning.planner import make_plan
from torchrender.planning.repeated import Made, Plans, Repeated
from torchrender.planning.rows import expected_of
from torchrender.planning.search import headroom
from torchrender.planning.standing import SHARE, cost_of_rows
from torchrender.shade import SentLight

OFF = 0.02
"""Share of a budget: so much more or less time spent than was foreseen changes no choice that another plan is worth."""


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
    searches: list[Search] = field(init=False, default_factory=list)  # of its plans
    # Passes that loaded kernels, or did what is done once: their times teach nothing.
    untypical: set[str] = field(init=False, default_factory=set)
    foreseen_ms: float = field(init=False, default=0.0)  # of all of it, by the first plan
    sensed: dict[str, float] = field(init=False, default_factory=dict)  # what errors of the next picture follow
    doubts: list[Doubt] = field(init=False, default_factory=list)  # about what cameras see
    plans: Plans = field(init=False)  # all that were made
    last: Repeated | None = field(init=False, default=None)  # those of the last picture, where this one repeats it

    def image(self) -> Image:
        """The picture.

        Raises:
            OptionError: the table of passes makes none.
        """
        self.buffers({})
        if PICTURE not in self.values:
            reasons = [f"{name}: {one.reason}" for name, one in self.graph.verdicts.items()]
            said = [reason for reason in reasons if "nobody makes" in reason] or [f"nobody makes {PICTURE.name}"]
            raise OptionError(f"passes: this table makes no picture: {'; '.join(said)}")
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
            before = Kernel.loads
            with self.clock.measure(step.name):
                self._take(step, step.run(self._frame()))
            if step.did is not None and step.name in self.amounts:
                self.amounts[step.name] = step.did(self._frame(), self.amounts[step.name])
            if Kernel.loads != before or self._did_once(step):
                self.untypical.add(step.name)
            self.done.append(step.name)
            if step.senses is not None and self.knowledge.unseen and self._looks:
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
            pace = self.knowledge.pace
            if not done:
                self.plans, self.last = Plans(self.knowledge, self.limits), Repeated.of(self.knowledge, self.limits)
            usual = pace.beside(self._looks if done else pace.looks_next, self.last is not None)
            spent += sum(max(0.0, told - took.get(name, 0.0)) for name, told in usual.items())
            spent += 0.0 if done else pace.known.get(UNPRICED, 0.0)
            again = self._repeated(tuple(done), spent)
            if again is None:
                self.last = None
                before = self.plan if done else None
                self.plan = make_plan(self.knowledge, options, *self.limits, done=done, spent_ms=spent, before=before)
                if self.plan.ahead:
                    self.knowledge = replace(self.knowledge, ahead=self.plan.ahead)
                self.graph = self.knowledge.graph(self.plan.options)
            else:
                self.plan, self.graph = again.plan, again.graph
            self.plans.add(tuple(done), self.knowledge, self.plan, self.graph)
            if not done:
                self.foreseen_ms = spent + (self.plan.predicted_ms or 0.0)
            if self.plan.search is not None:
                self.searches.append(self.plan.search)

    def _repeated(self, done: tuple[str, ...], spent_ms: float) -> Made | None:
        """The last picture's plan at this place, if this one repeats it."""
        if self.last is None:
            return None
        if not done:
            return self.last.first(self.knowledge, spent_ms)
        now = Made(self.plans.found, self.plan, self.graph, {})
        return self.last.later(self.knowledge, now, done, spent_ms)

    def _look_again(self) -> None:
        """More is known, and not the time spent that was foreseen: reasons, and what is left to choose, follow."""
        if self.found or self._off_time:
            self.knowledge, self.found = self.knowledge.found_out(**self.found), {}
            self._choose(self.plan.options)

    @property
    def _off_time(self) -> bool:
        """Passes of a picture with a budget took so much more or less than foreseen that it may change a choice."""
        if self.limits[0] is None:
            return False
        took, off = self.clock.elapsed_ms, 0.0
        for row in self.plan.rows:
            if row.name in self.done:
                off += took[row.name] - (row.predicted_ms or 0.0)
        return abs(off) > OFF * self.limits[0]

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
            spare_ms=self._spare_ms,
        )

    @property
    def _spare_ms(self) -> float:
        """What sensing may take: a small share of a budget, or what the passes leave of it."""
        budget, pace = self.limits[0], self.knowledge.pace
        return math.inf if budget is None else max(SHARE * budget, headroom(pace) * budget - self.foreseen_ms)

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

    def _did_once(self, step: Pass) -> bool:
        """The pass has just done what is done once for many pictures."""
        return step.did_once(self.amounts.get(step.name, ()))

    def _forget(self) -> None:
        """Release the buffers that no pass asks for; a G-buffer that is no larger than the picture stays with it."""
        left = {step.makes for step in self.graph.running if step.name not in self.done}
        kept = set(self.knowledge.wanted) | {PICTURE_VISIBILITY}
        if self.plan.options.supersample <= 1:
            kept.add(GBUFFER)
        for buffer in list(self.values):
            if buffer not in kept and not self.graph.asked.get(buffer, frozenset()) & left:
                del self.values[buffer]

    @property
    def _looks(self) -> bool:
        """It is time to sense: a search was made, or many pictures stood by it, and there is time left for that."""
        budget, took = self.limits[0], self.clock.elapsed_ms
        if self.limits == (None, None) or not all(looks(search.pictures) for search in self.searches):
            return False
        left = sum(row.predicted_ms or 0.0 for row in self.plan.running if row.name not in self.done)
        left += max(self.knowledge.pace.beside(True)["senses"] - took.get("senses", 0.0), 0.0)
        spent = sum(ms for name, ms in took.items() if name not in ("load", "total"))
        return budget is None or not self._stands or spent + left <= TOLERANCE * budget

    @property
    def _stands(self) -> bool:
        """All that was chosen is what an earlier picture chose."""
        return bool(self.searches) and all(search.pictures for search in self.searches)

    def _missed(self, pace: Pace) -> Pace:
        """With how far the time was missed that a picture after the first was chosen for."""
        past, took = self.knowledge.outlook.history, self.clock.elapsed_ms.get("total", 0.0)
        if not past.pictures or past.pace is None:
            return pace
        pace = pace.warned(took, self.limits[0])
        return pace.missed(took, self.foreseen_ms) if self._stands else pace

    def _search(self, plan: Plan) -> Search | None:
        """That of the plan, for the next picture: a new one with what all of the picture was expected to be.

        A picture that stood by a choice hands that one on, also where it ran late and chose anew for what was left of
        its time: the next one has all of its own.
        """
        if self.searches and self.searches[0].pictures:
            return self.searches[0]
        found = plan.search
        if found is None or found.later is not None:
            return None if found is None else found.later
        expected = expected_of(self.knowledge, plan.rows, plan.options)
        return replace(found, cost=cost_of_rows(plan.rows, expected, frozenset()))

    def measured(self) -> Plan:
        """The plan with what its passes, and all of it, took so far."""
        took = self.clock.elapsed_ms
        return self.plan.measured(took, self.amounts, took["total"], waited=self.clock.waited)

    def history(self, plan: Plan) -> RenderHistory:
        """What the next picture of the sequence starts from."""
        known = self.knowledge
        settings = {step.name: step.settings.current(plan.options) for step in known.passes}
        pace = known.pace.aged({(row.name, row.setting) for row in plan.running})
        times: dict[tuple[str, str], tuple[float, float]] = {}
        for row in plan.running:
            if row.amounts is not None and row.measured_ms is not None and row.name not in self.untypical:
                raw = known.curves.time_ms(row.name, row.setting, row.amounts, known.name) or 0.0
                times[row.name, row.setting] = row.measured_ms, raw
        pace = pace.learned_all(times)
        took, told = sum(ms for ms, raw in times.values() if raw > 0.0), sum(raw for _, raw in times.values())
        spent = self.clock.elapsed_ms
        own = pace.hurried(took, told) | beside(known, spent, self.searches, self.last is not None)
        own |= unpriced(known, plan, spent, self.untypical)
        learned = {**pace.known, **known.outlook.known, **self.sensed, **own}
        pace = replace(self._missed(pace), choice=settings, known=learned, search=self._search(plan))
        pace = replace(pace, repeated=None if self.sensed else self.plans.for_next(self.lasting))
        past = known.outlook.history.with_picture(self.lasting.items(), plan.options, known.outlook.cameras)
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
