"""Searches after pictures: what follows in a sequence with a budget is chosen in time that is left.

A search takes as long as a small picture, and one that a picture pays for before it begins makes it late, or coarse. So
a first picture chooses for those that follow once it has told how fast the machine is; later a search looks at one
number of pixels after another, in as many pictures as it takes, where these end before their budget does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch

from torchrender.clock import StepClock
from torchrender.passes.settings import Setting
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import SEARCHING, TOLERANCE, UNPRICED, Pace, Search, alike
from torchrender.planning.choices import chosen, looked_ahead, paid_once
from torchrender.planning.costs import Knowledge
from torchrender.planning.planner import search_of, settled
from torchrender.planning.question import Question
from torchrender.planning.repeated import Repeated, in_advance
from torchrender.planning.search import Choice, Found, best_of, choice_of, headroom, in_order, looked, loyal, pool_of
from torchrender.planning.standing import EARLY, PICTURES, is_due_after, searching_of
from torchrender.scene.camera import Cameras

NAME = "search"
"""Of the step in an image's times."""

STEPS = 3
"""That a search takes, about, before one told."""

MOST = 0.97
"""Of what a budget tolerates, that searches may take where many pictures left no time for a step."""

STEP = 1e-3
"""Of the scene's diagonal that eyes are taken to move from one picture to the next, if they do."""

QUICKER = (0.85, 0.6)
"""Of the time of passes: what is chosen beside that, for where it turns out too slow by a little, and by more."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Hunt:
    """A search that stops and goes on: the same choice as :func:`torchrender.planning.search.choose` in the end."""

    question: Question
    budget_ms: float
    spent_ms: float
    left: tuple[Setting, ...]  # numbers of pixels that were not looked at
    best: Found | None = None
    took_ms: tuple[float, ...] = ()  # by step

    @classmethod
    def of(cls, question: Question, budget_ms: float, spent_ms: float) -> Hunt:
        """Before the first step; ``spent_ms`` is not for passes."""
        left = in_order(pool_of(question), 1)
        return cls(question=question, budget_ms=budget_ms, spent_ms=spent_ms, left=left)

    @property
    def limit_ms(self) -> float:
        """Of passes."""
        return headroom(self.question.knowledge.pace) * self.budget_ms - self.spent_ms

    def on(self) -> Hunt:
        """After another step."""
        left, best = looked(pool_of(self.question), 1, self.limit_ms, self.left, self.best)
        return replace(self, left=left, best=best)

    def choice(self) -> Choice:
        """What it came to, once nothing is left."""
        pool, found, limits = pool_of(self.question), self.best, (self.limit_ms, float("inf"))
        if found is None:
            found = best_of(pool, 0, float("inf"))
            assert found is not None, "every problem has a combination"
        else:
            found = loyal(self.question, pool, found, limits, 1)
        return choice_of(self.question, found, self.spent_ms, self.best is not None)

    def quicker(self) -> list[Choice]:
        """Choices that take less, and the least: for where the machine turns out to be slower."""
        pool = pool_of(self.question)
        found = [*(best_of(pool, 1, share * self.limit_ms) for share in QUICKER), best_of(pool, 0, float("inf"))]
        return [choice_of(self.question, one, self.spent_ms, True) for one in found if one is not None]


def go_on(knowledge: Knowledge, kept: RenderHistory, budget_ms: float, clock: StepClock, error: float | None) -> Pace:
    """The pace of the pictures that follow, with the search for these as far as there is time.

    The first picture of a sequence searches to the end, and so does one that is late in any case, where nothing quicker
    is at hand for the next one.

    Args:
        knowledge: of the picture that was just made. kept: what it leaves. clock: its time so far.
        error: that was expected of it.
    """
    pace = kept.pace or Pace()
    took_ms = clock.elapsed_ms["total"]
    hunt = pace.hunt if isinstance(pace.hunt, Hunt) and _goes_on(pace.hunt, knowledge, budget_ms) else None
    pace = replace(pace, hunt=hunt)
    if hunt is None and not is_due_after(pace, kept.pictures, budget_ms, took_ms, error):
        return pace
    last = pace.search
    at_hand = last is not None and last.quicker is not None
    # Where nothing keeps the budget, something that one picture pays once may.
    said = last is not None and not last.possible and kept.pictures <= EARLY and _stands_still(knowledge)
    all_of_it = kept.pictures < 2 or said or (took_ms > TOLERANCE * budget_ms and not at_hand)
    starved = last is not None and last.pictures >= PICTURES
    limit_ms = MOST * TOLERANCE * budget_ms if starved else budget_ms
    while all_of_it or clock.elapsed_ms["total"] + _step_ms(hunt, pace) <= limit_ms:
        before = clock.elapsed_ms.get(NAME, 0.0)
        with clock.measure("total"), clock.measure(NAME):
            if hunt is None:
                hunt = _begun(knowledge, kept, budget_ms)
            elif hunt.left:
                hunt = hunt.on()
            else:
                search = _ended(hunt, kept.pictures, _stands_still(knowledge))
                known = {**pace.known, SEARCHING: sum(hunt.took_ms)}
                pace = replace(pace, search=search, hunt=None, known=known)
                return replace(pace, repeated=_planned(knowledge, replace(kept, pace=pace), budget_ms))
        hunt = replace(hunt, took_ms=(*hunt.took_ms, clock.elapsed_ms[NAME] - before))
    return replace(pace, hunt=hunt)


def _step_ms(hunt: Hunt | None, pace: Pace) -> float:
    """Of the next step, about."""
    return max(hunt.took_ms if hunt is not None else (), default=searching_of(pace) / STEPS)


def _goes_on(hunt: Hunt, knowledge: Knowledge, budget_ms: float) -> bool:
    """What was begun is still what is asked for."""
    now, then = knowledge.outlook, hunt.question.knowledge.outlook
    sizes = [(len(o.cameras), o.cameras.width, o.cameras.height) for o in (now, then)]
    same = now.options is then.options or alike(now.options, then.options)
    return hunt.budget_ms == budget_ms and same and sizes[0] == sizes[1] and not then.history.leaps_to(now.cameras)


def _begun(knowledge: Knowledge, kept: RenderHistory, budget_ms: float) -> Hunt:
    """A search for a picture like the last one, after it."""
    outlook, pace = knowledge.outlook, replace(kept.pace or Pace(), hunt=None)
    kept = replace(kept, pace=pace)  # a search keeps none that was before it
    scene = kept.given
    assert scene is not None
    cameras, before = outlook.cameras, outlook.history.seen_from
    if before is None or not torch.equal(before.camera_from_world, cameras.camera_from_world):
        cameras = _moved_on(cameras, STEP * scene.diagonal)  # what follows the eye is made anew
    if outlook.history.moves:
        kept = _outdated(kept)
    known = Knowledge.of(scene, cameras, outlook.options, kept, knowledge.curves)
    options = settled(known, known.outlook.options, frozenset())
    # The second picture knows how fast the machine is, and looks around for those that follow where that serves them.
    once = 1.0 / PICTURES if kept.pictures < 2 else 1.0
    question = Question.about(known, options, near=True, careful=True, share_once=once)
    spent_ms = sum(pace.beside(False, _stands_still(knowledge)).values()) + pace.known.get(UNPRICED, 0.0)
    return Hunt.of(question, budget_ms, spent_ms)


def _stands_still(knowledge: Knowledge) -> bool:
    """The eye, and all meshes, were where they are in the picture before, too."""
    outlook = knowledge.outlook
    now, before = outlook.cameras.camera_from_world, outlook.history.seen_from
    return before is not None and torch.equal(before.camera_from_world, now) and not outlook.history.moves


def _planned(knowledge: Knowledge, kept: RenderHistory, budget_ms: float) -> Repeated | None:
    """The plan of the next picture, if it is like this one."""
    scene, search = kept.given, None if kept.pace is None else kept.pace.search
    if scene is None or search is None or not _stands_still(knowledge):
        return None
    known = Knowledge.of(scene, knowledge.outlook.cameras, knowledge.outlook.options, kept, knowledge.curves)
    return in_advance(known, (budget_ms, None), search)


def _moved_on(cameras: Cameras, length: float) -> Cameras:
    """Cameras that went on a little."""
    matrices = cameras.camera_from_world.clone()
    matrices[:, 2, 3] -= length
    return replace(cameras, camera_from_world=matrices)


def _outdated(kept: RenderHistory) -> RenderHistory:
    """Where meshes move: what this picture made does not hold for the next one."""
    none = (object(),)
    parts = {name: replace(one, scene=none) if one.picture == kept.pictures else one for name, one in kept.kept.items()}
    return replace(kept, kept=parts)


def _ended(hunt: Hunt, pictures: int, still: bool) -> Search:
    """What the pictures that follow stand by; ``still``: they may be like the last one."""
    question, wishes = hunt.question, (hunt.budget_ms, None)
    choice, made = hunt.choice(), None
    if pictures < 2 and question.knowledge.outlook.history.sequence:
        made = looked_ahead(question, choice, hunt.budget_ms, (hunt.spent_ms, hunt.spent_ms))
    elif still:
        made = paid_once(question, choice, hunt.budget_ms, hunt.spent_ms)
    search = search_of(question.knowledge, wishes, made or chosen(question, choice))
    quicker: Search | None = None
    for other in reversed(hunt.quicker() if choice.possible else ()):
        if other.settings != choice.settings:
            quicker = replace(_alone(search, other, hunt.spent_ms), quicker=quicker)
    return replace(search, quicker=quicker)


def _alone(search: Search, choice: Choice, spent_ms: float) -> Search:
    """The same search with another choice, that makes nothing for pictures to come."""
    cost = (choice.predicted_ms - spent_ms, choice.predicted_error, choice.predicted_error)
    return replace(search, settings=choice.settings, possible=choice.possible, cost=cost, ahead=())
