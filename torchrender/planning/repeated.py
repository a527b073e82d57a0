"""Pictures that repeat the last one, with the eye and everything else where it was, are made by its plans.

Which passes run, why, and how much work each has is the same then: only times are foreseen anew, by what the pictures
so far took, and whether the choice still holds is asked as of any picture (:mod:`torchrender.planning.standing`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from torchrender.passes.settings import CUSTOM
from torchrender.pipeline.buffer import same
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.pace import Pace, Search, alike
from torchrender.planning.costs import Knowledge
from torchrender.planning.graph import AnyBuffer, Graph
from torchrender.planning.plan import Plan, PlanRow
from torchrender.planning.planner import make_plan
from torchrender.planning.standing import Cost, still_holds, still_in_time
from torchrender.scene.camera import Cameras

Wishes = tuple[float | None, float | None]


class Made(NamedTuple):
    """A plan of a picture."""

    found: Mapping[str, float]  # quantities that its passes had found out
    plan: Plan
    graph: Graph
    ratios: Mapping[str, float]  # that times were foreseen with, by pass


@dataclass(eq=False)
class Plans:
    """Those of a picture, by the passes that had run."""

    knowledge: Knowledge  # before the picture
    wishes: Wishes
    made: dict[tuple[str, ...], Made] = field(default_factory=dict)
    found: Mapping[str, float] = field(default_factory=dict)  # before the last of them

    def add(self, done: tuple[str, ...], knowledge: Knowledge, plan: Plan, graph: Graph) -> None:
        """Another plan of it, by what is known then."""
        self.found = knowledge.outlook.known
        self.made[done] = _made(knowledge, plan, graph)

    def for_next(self, lasting: Iterable[AnyBuffer]) -> Repeated | None:
        """For the next picture; None where the choice does not stand yet, or this one made what that will not.

        Args:
            lasting: what it made, or handed on, that lasts.
        """
        outlook, first = self.knowledge.outlook, self.made[()].plan
        past = outlook.history
        made_anew = [one for one in lasting if past.get(one, first.options) is None]
        chosen = [one for one in self.made.values() if one.plan.search is not None and not one.plan.search.pictures]
        going_on = any(step.for_next and first.row(step.name).runs for step in self.knowledge.passes)
        stood = past.seen_from is not None and _seen_alike(past.seen_from, outlook.cameras) and not past.moves
        if made_anew or chosen or going_on or not stood or outlook.samples is not None:
            return None
        return Repeated.by(self.knowledge, self.wishes, self.made)


@dataclass(frozen=True, eq=False, kw_only=True)
class Repeated:
    """The plans of the last picture, and what they were made for."""

    about: tuple[object, ...]  # scene, curves, passes, and names of buffers that are asked for
    cameras: Cameras
    options: RenderOptions
    kept: frozenset[str]  # names of what earlier pictures left
    sequence: bool
    wishes: Wishes
    search: Search | None  # that the picture stood by
    made: Mapping[tuple[str, ...], Made]

    @classmethod
    def by(cls, knowledge: Knowledge, wishes: Wishes, made: Mapping[tuple[str, ...], Made]) -> Repeated:
        """Plans that were made by what is known."""
        outlook = knowledge.outlook
        return cls(
            about=(outlook.history.given, knowledge.curves, *_asked(knowledge)),
            cameras=outlook.cameras,
            options=outlook.options,
            kept=frozenset(outlook.history.kept),
            sequence=outlook.history.sequence,
            wishes=wishes,
            search=made[()].plan.search,
            made=made,
        )

    @classmethod
    def of(cls, knowledge: Knowledge, wishes: Wishes) -> Repeated | None:
        """Of the picture before this one, if this one repeats it."""
        last, outlook = knowledge.pace.repeated, knowledge.outlook
        past = outlook.history
        if not isinstance(last, Repeated) or outlook.samples is not None or knowledge.ahead:
            return None
        about = past.given, knowledge.curves, *_asked(knowledge)
        same_things = len(about) == len(last.about) and all(a is b for a, b in zip(about, last.about, strict=True))
        stood = same_things and wishes == last.wishes and knowledge.pace.search is last.search
        stood = stood and past.sequence == last.sequence and last.kept == frozenset(past.kept)
        stood = stood and (last.options is outlook.options or alike(last.options, outlook.options))
        return last if stood and _seen_alike(last.cameras, outlook.cameras) else None

    def first(self, knowledge: Knowledge, spent_ms: float) -> Made | None:
        """The first plan, with times as they are foreseen now; None where another choice may be due."""
        found = _foreseen(self.made[()], knowledge.pace)
        search = found.plan.search
        if search is None:
            return found
        cost = _cost(found.plan, frozenset())
        if not still_holds(knowledge, search, self.wishes, cost, spent_ms):
            return None
        return found._replace(plan=replace(found.plan, search=replace(search, cost=cost, pictures=search.pictures + 1)))

    def later(self, knowledge: Knowledge, now: Made, done: tuple[str, ...], spent_ms: float) -> Made | None:
        """The plan after these passes; None where it has to be made anew.

        Args:
            now: the plan so far.
        """
        known = knowledge.outlook.known
        last = self.made.get(done, now)
        if last.found != known:
            return None
        found = last if last is now else _foreseen(last, knowledge.pace)
        left_ms = _cost(found.plan, frozenset(done))[0]
        if self.wishes[0] is not None and not still_in_time(self.wishes[0], spent_ms + left_ms):
            return None
        return found._replace(plan=replace(found.plan, search=now.plan.search))


def in_advance(knowledge: Knowledge, wishes: Wishes, search: Search) -> Repeated | None:
    """The first plan of the next picture, where it repeats the last one but for the settings of a new search.

    Args:
        knowledge: before that picture.
    """
    plan = make_plan(knowledge, knowledge.outlook.options, *wishes)
    if plan.search is None or plan.search.settings is not search.settings:
        return None
    plan = replace(plan, search=search)
    return Repeated.by(knowledge, wishes, {(): _made(knowledge, plan, knowledge.graph(plan.options))})


def _made(knowledge: Knowledge, plan: Plan, graph: Graph) -> Made:
    ratios = {row.name: knowledge.pace.ratio(row.name, row.setting) for row in plan.running}
    return Made(knowledge.outlook.known, plan, graph, ratios)


def _asked(knowledge: Knowledge) -> tuple[object, ...]:
    """Passes, and buffers that are there and that are wanted."""
    return (*knowledge.passes, None, *knowledge.given, None, *knowledge.wanted)


def _seen_alike(first: Cameras, second: Cameras) -> bool:
    return first is second or same(tuple(vars(first).values()), tuple(vars(second).values()))


def _foreseen(made: Made, pace: Pace) -> Made:
    """With times as they are foreseen now."""

    def again(row: PlanRow) -> PlanRow:
        if not row.predicted_ms or row.setting == CUSTOM or row.name not in made.ratios:
            return row
        ratio = pace.ratio(row.name, row.setting) / max(made.ratios[row.name], 1e-9)
        return row if ratio == 1.0 else replace(row, predicted_ms=ratio * row.predicted_ms)

    return made._replace(plan=replace(made.plan, rows=tuple(again(row) for row in made.plan.rows)))


def _cost(plan: Plan, done: frozenset[str]) -> Cost:
    left = sum(row.predicted_ms or 0.0 for row in plan.running if row.name not in done)
    return left, plan.predicted_error or 0.0, 0.0 if plan.error_interval is None else plan.error_interval[1]
