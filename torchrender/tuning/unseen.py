"""Errors of settings over random scenes, beside what passes sense there: lines for scenes that nobody measured.

Each scene is seen once, by its first camera. What is sensed is taken from a picture with every pass at its usual
setting, as a sequence would have it from the picture before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from torchrender.image import Image
from torchrender.passes.senses import closely
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import sense_of
from torchrender.planning.foresight import COVERED, LEAST, Expected, Line, Whole, fitted, joint_of_pictures
from torchrender.quality.metrics import flip
from torchrender.renderer import NO_LIMIT, render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.tuning.measure import errors_alone, exact_options

SIDE = 176
"""Pixels of a side."""

SEEDS = range(40)
"""Of the random scenes that lines are fitted to. Tests of predictions take others."""

TIMED = (0, 1, 5, 7, 8, 10, 11, 12, 13)
"""Those with mirrors, lights and numbers of triangles of every kind, whose times join those of built-in scenes: few of
these have mirrors, and none has glossy ones."""

WISHES: tuple[dict[str, Any], ...] = (
    {"budget_ms": 80.0},
    {"budget_ms": 250.0},
    {"max_error": 0.2},
    {"max_error": 0.1},
    {"max_error": 0.05},
    {"max_error": 0.025},
)
"""For which whole pictures are compared with the errors of their passes, in scenes of ``HELD_OUT``."""

HELD_OUT = range(40, 60)
"""Seeds of random scenes that no line was fitted to: in those that were, lines are closer than elsewhere."""

Record = dict[str, dict[str, Any]]
"""By pass: ``sensed`` and ``probed``, None where nothing was, and ``errors`` by setting."""


def record_of(scene: Scene, size: int = SIDE) -> Record:
    """Errors of every setting of every pass that runs and has a choice, and what it senses."""
    lit = scene.with_default_light()
    camera = lit.camera(width=size, height=size)
    usual, history = sensed(lit, camera)
    assert usual.plan is not None and history.pace is not None
    known = history.pace.known
    found: Record = {}
    for step in PASSES:
        if step.settings.is_choice and usual.plan.row(step.name).runs:
            made, history = errors_alone(lit, camera, step, history)
            found[step.name] = {
                "sensed": known.get(sense_of(step.name)),
                "probed": known.get(sense_of(closely(step.name))),
                "errors": {setting: one["flip"] for setting, one in made.items()},
            }
    return found


def sensed(scene: Scene, camera: Cameras) -> tuple[Image, RenderHistory]:
    """A picture at usual settings, and a history that holds what its passes sensed."""
    usual = RenderOptions()
    held = tuple(p.name for p in PASSES if p.settings.is_choice and p.settings.current(usual) != CUSTOM)
    image = render(scene, camera, options=replace(usual, fixed=held), history=RenderHistory(), budget_ms=NO_LIMIT)
    assert image.history is not None
    return image, image.history


def lines_of(records: Iterable[Record]) -> dict[str, dict[str, list[float]]]:
    """Lines by pass and setting, for :func:`torchrender.planning.foresight.parse_lines`.

    Settings that are the reference wherever they were tried have none: their error is that of the pass's records.
    What probes found has lines of its own, where errors follow it more closely.
    """
    found: dict[str, dict[str, list[float]]] = {}
    rows: dict[str, dict[str, list[tuple[float, dict[str, Any]]]]] = {}
    for record in records:
        for name, values in record.items():
            for setting, error in values["errors"].items():
                rows.setdefault(name, {}).setdefault(setting, []).append((error, values))
    for name, settings in rows.items():
        for setting, pairs in settings.items():
            usual = _line(pairs, "sensed")
            if usual is None:
                continue
            found.setdefault(name, {})[setting] = usual.to_list()
            probed = _line(pairs, "probed", needed=True)
            if probed is not None and probed.left < usual.left:
                found.setdefault(closely(name), {})[setting] = probed.to_list()
    return found


def _line(pairs: Iterable[tuple[float, dict[str, Any]]], kind: str, *, needed: bool = False) -> Line | None:
    """Through errors over what was sensed where something was, else, unless that is ``needed``, of the errors alone."""
    known = [(error, values[kind]) for error, values in pairs if values.get(kind) is not None]
    chosen = known if known or needed else [(error, 1.0) for error, _ in pairs]
    if not any(error > LEAST for error, _ in chosen):
        return None
    errors, seen = zip(*chosen, strict=True)
    return fitted(errors, seen)


def joint_of(scenes: Iterable[Scene], size: int = SIDE) -> dict[str, list[float]]:
    """How errors of whole pictures lie about what their passes add up to, of ``fine`` and of ``coarse`` ones.

    Of the second picture of a sequence, and of the first one under a bound, at settings that budgets and bounds choose
    by curves which do not tell it yet.
    """
    pictures: dict[str, list[Whole]] = {"fine": [], "coarse": []}
    for number, scene in enumerate(scenes):
        camera = scene.with_default_light().camera(width=size, height=size)
        wanted = render(scene, camera, options=exact_options()).displayed().float()
        for wish in WISHES:
            history: RenderHistory | None = RenderHistory()
            for second in (False, True):
                image = render(scene, camera, history=history, **wish)
                history, plan = image.history, image.plan
                assert plan is not None
                if plan.predicted_error and plan.error_interval is not None and (second or "max_error" in wish):
                    spread = math.log(plan.predicted_error / plan.error_interval[0]) / COVERED
                    error = float(flip(image.displayed().float(), wanted)[0])
                    few = plan.options.supersample
                    told = Expected(plan.predicted_error, spread)
                    pictures["coarse" if few < 1.0 else "fine"].append(Whole(error, told, min(few, 1.0), number))
    return {kind: [round(value, 3) for value in joint_of_pictures(found)] for kind, found in pictures.items()}
