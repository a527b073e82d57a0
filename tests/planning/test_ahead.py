"""Searches after pictures: the same choices as before them, in time that is left."""

from __future__ import annotations

import gc
from dataclasses import replace

import pytest
import torch

import torchrender as tr
from torchrender.errors import InputError
from torchrender.image import Image
from torchrender.passes.seen.ray_caster import RAY_CASTER
from torchrender.passes.table import find_pass
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.pace import Pace, Search
from torchrender.planning.ahead import QUICKER, Hunt, _begun, _goes_on, _moved_on
from torchrender.planning.costs import Knowledge
from torchrender.planning.curves import load_curves
from torchrender.planning.question import Question
from torchrender.planning.search import HEADROOM, choose
from torchrender.planning.standing import EARLY, FILLED, FULL, LONGEST, PICTURES, is_due_after
from torchrender.run import Run

SCENE = tr.load("living_room")
CAMERA = SCENE.camera(width=64, height=48)


def question(pace: Pace | None = None) -> Question:
    history = replace(RenderHistory(), pace=pace)
    knowledge = Knowledge.of(SCENE, CAMERA, tr.RenderOptions(), history, load_curves())
    return Question.about(knowledge, knowledge.outlook.options, careful=True)


@pytest.mark.parametrize("budget_ms", [0.5, 20.0, 60.0, 200.0, 1e4])
def test_step_by_step_the_same_is_chosen(budget_ms: float) -> None:
    for spent_ms in (0.0, 7.0):
        hunt, steps = Hunt.of(question(), budget_ms, spent_ms), 0
        while hunt.left:
            hunt, steps = hunt.on(), steps + 1
            assert hunt.best is None or hunt.best.cost[0] <= hunt.limit_ms * (1 + 1e-9), "never more than there is"
        found, wanted = hunt.choice(), choose(question(), budget_ms, None, spent_ms)
        assert found == wanted and steps >= 1
        if wanted.possible:
            *quick, least = hunt.quicker()
            for one in quick:
                assert one.predicted_ms - spent_ms <= QUICKER[0] * hunt.limit_ms * (1 + 1e-9)
                assert one.predicted_error >= wanted.predicted_error
            assert least.predicted_ms <= min(one.predicted_ms for one in (wanted, *quick))
        if budget_ms == 1e4:  # where all that is left of a budget is the time of the most exact settings
            tight = replace(hunt, budget_ms=wanted.predicted_ms / HEADROOM)
            assert tight.quicker()[0].predicted_ms - spent_ms <= QUICKER[0] * tight.limit_ms * (1 + 1e-9)


def test_what_was_begun_stands_still_between_pictures() -> None:
    """A history may be gone on from twice."""
    hunt = Hunt.of(question(), 60.0, 0.0)
    first, again = hunt.on(), hunt.on()
    assert first.left == again.left and first.left != hunt.left
    assert (first.best is None) == (again.best is None)


def _with_background(known: Knowledge, color: torch.Tensor) -> Knowledge:
    return replace(known, outlook=known.outlook.at(tr.RenderOptions(background=color)))


def test_another_wish_or_view_ends_what_was_begun() -> None:
    hunt = Hunt.of(question(), 60.0, 0.0)
    now = hunt.question.knowledge
    assert _goes_on(hunt, now, 60.0) and not _goes_on(hunt, now, 50.0)
    other = replace(now, outlook=now.outlook.at(tr.RenderOptions(shadows=False)))
    assert not _goes_on(hunt, other, 60.0)
    blue = torch.tensor([0.1, 0.2, 0.3])
    hunt_before_blue = replace(hunt, question=replace(hunt.question, knowledge=_with_background(now, blue)))
    assert _goes_on(hunt_before_blue, _with_background(now, blue), 60.0)
    assert not _goes_on(hunt_before_blue, _with_background(now, blue.clone()), 60.0), "colours may change in place"
    larger = replace(now, outlook=replace(now.outlook, cameras=SCENE.camera(width=65, height=48)))
    assert not _goes_on(hunt, larger, 60.0)


def test_searches_take_what_follows_the_eye_and_what_moved_as_made_anew() -> None:
    """As the next picture of a walk, or of an animation, finds it; of a view that stands still all is kept."""
    options = tr.RenderOptions(reuse=None, point_shadows="maps", area_shadows="hard", reflections="traced")
    shift = torch.eye(4, dtype=torch.float64)
    shift[0, 3] = 0.01 * SCENE.diagonal
    moved = SCENE.moved(SCENE.meshes[-1].name, shift)
    onward = _moved_on(CAMERA, 0.01 * SCENE.diagonal)
    first = tr.render(SCENE, CAMERA, options=options, history=RenderHistory()).history
    found = {}
    for name, scene, camera in (("stands", SCENE, CAMERA), ("walks", SCENE, onward), ("moves", moved, CAMERA)):
        knowledge = Knowledge.of(scene, camera, options, first, load_curves())
        kept = tr.render(scene, camera, options=options, history=first).history
        assert kept is not None
        asked = _begun(knowledge, kept, 60.0).question
        outlook = asked.knowledge.outlook
        maps = find_pass("shadow_map").amounts(outlook)[0]
        found[name] = maps, outlook.kept(RAY_CASTER) is not None, outlook.history.last(RAY_CASTER) is not None
    assert found["stands"] == (0.0, True, True)
    assert found["walks"][0] > 0.0 and found["walks"][1]
    assert found["moves"][1:] == (False, True)


def stood(pictures: int, *, possible: bool = True, error: float = 0.1) -> Pace:
    search = Search(
        wishes=(100.0, None), asked=tr.RenderOptions(), settings={}, possible=possible, changes=(),
        cost=(50.0, error, error), pictures=pictures,
    )  # fmt: skip
    return Pace(search=search)


@pytest.mark.parametrize("pictures, pace, took, due", [
    (1, stood(0), 10.0, True), (1, stood(0), 300.0, True),
    (EARLY, stood(1), 50.0, True), (EARLY, stood(1), 1.01 * FILLED * HEADROOM * 100.0, False),
    (30, stood(PICTURES - 1), 50.0, False), (30, stood(PICTURES), 50.0, True),
    (30, stood(PICTURES), 1.01 * FILLED * HEADROOM * 100.0, False), (30, stood(LONGEST), 84.0, True),
    (30, stood(1), 1.01 * FULL * HEADROOM * 100.0, True), (30, stood(0), 120.0, False),
    (30, stood(1, possible=False), 300.0, False), (30, stood(PICTURES, possible=False), 300.0, True),
    (30, stood(PICTURES - 4), 50.0, False),
    (10, stood(4), 50.0, False), (10, stood(5), 50.0, True),
    (30, stood(PICTURES - 4, error=0.2), 50.0, True), (30, stood(2, error=0.2), 50.0, False),
])  # fmt: skip
def test_when_another_search_is_due(pictures: int, pace: Pace, took: float, due: bool) -> None:
    """After the first picture, where a choice takes too much, and once enough stood by one that leaves time."""
    assert is_due_after(pace, pictures, 100.0, took, 0.1) == due


def test_without_a_choice_nothing_is_searched_for_after_a_picture() -> None:
    assert not is_due_after(Pace(), 1, 100.0, 10.0, None)


def test_no_garbage_is_collected_while_a_picture_with_a_budget_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is between pictures, and in those without; as it was, also where a picture fails."""
    found: list[bool] = []
    image = Run.image

    def made(run: Run) -> Image:
        found.append(gc.isenabled())
        if len(found) == 3:
            raise InputError("no picture")
        return image(run)

    monkeypatch.setattr(Run, "image", made)
    was = gc.isenabled()
    gc.enable()
    try:
        for wishes in ({"budget_ms": 50.0}, {}):
            tr.render(SCENE, CAMERA, **wishes)
            assert gc.isenabled()
        with pytest.raises(InputError):
            tr.render(SCENE, CAMERA, budget_ms=50.0)
        assert gc.isenabled() and found == [False, True, False]
        gc.disable()
        tr.render(SCENE, CAMERA, budget_ms=50.0)
        assert not gc.isenabled()
    finally:
        (gc.enable if was else gc.disable)()
