"""Curves measured on this machine: weights of the cost models, errors of every setting, and how errors add up.

Times are fitted to pictures of several scenes and sizes, with all settings turned step by step together, in short
sequences: every pass of every picture is one observation. Errors are those of ``tradeoff_measure``.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.optimize import nnls

from torchrender import __version__
from torchrender.passes.settings import Setting
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import coarsening
from torchrender.planning.curves import FORMAT, Curves, scene_key
from torchrender.quality.machine import machine_record
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural.anything import anything
from torchrender.tuning import unseen
from torchrender.tuning.measure import FRAMES, SIDE, errors_alone, measure_pass, turned_off, views_of
from torchrender.tuning.windows import Windows

Observations = dict[tuple[str, str], list[tuple[str, tuple[float, ...], float]]]
"""Scene, amounts of work and milliseconds, by pass and setting."""

STEPS = max(len(step.settings.all) for step in PASSES)
SIZES = (128, 256, 512)
NORMS = np.arange(0.75, 3.01, 0.05)

SHORTEST_MS = 0.5
"""Times below count as this in relative errors: nobody plans with them."""

BOUNDS = (0.2, 0.1, 0.06)
"""Of errors, for which whole pictures are compared with the errors of their passes."""

ROUNDS = 60
"""Of a fit, at most: each takes errors relative to what the one before predicts."""

Tell = Callable[[str], None]


def calibrate(scenes: Sequence[Scene], *, size: int = SIDE, known: Curves | None = None, tell: Tell) -> dict[str, Any]:
    """Curves as a JSON object, for :func:`torchrender.planning.curves.parse_curves`.

    Args:
        size: pixels of a side of the pictures that errors are taken of, and of the largest that are timed.
        known: curves whose errors are taken over for the scenes that they hold, and how errors add up: neither
            depends on the machine.
        tell: is told what was done, a line at a time.
    """
    errors: dict[str, Any] = {}
    joint: dict[str, list[tuple[list[float], float]]] = {}
    seen: Observations = defaultdict(list)
    for scene in scenes:
        key = scene_key(scene)
        views = views_of(scene, size)
        before: Mapping[str, Any] = {} if known is None else known.scenes.get(key, {})
        errors[key] = errors_of(scene, views, before.get("passes"))
        if "joint" not in before:
            joint[key] = joint_errors(scene, views, errors[key])
        tell(f"{scene.name}: errors measured")
        for name, values in times_of(scene, [s for s in SIZES if s < size] + [size]).items():
            seen[name] += values
        tell(f"{scene.name}: times measured")
    if known is None or not known.lines:
        records = [unseen.record_of(anything(seed)) for seed in unseen.SEEDS]
        lines = unseen.lines_of(records)
        tell(f"{len(records)} random scenes: errors measured")
        for seed in unseen.TIMED:
            for name, values in times_of(anything(seed), SIZES[:2]).items():
                seen[name] += values
        tell(f"{len(unseen.TIMED)} random scenes: times measured")
    else:
        lines = {
            name: {setting: line.to_list() for setting, line in rows.items()} for name, rows in known.lines.items()
        }
    norm = fit_norm([pair for pairs in joint.values() for pair in pairs]) if known is None else known.norm
    # Else as it was: one new scene says little about how errors add up, but tells its own factor.
    factors = {key: joint_factor(pairs, norm) for key, pairs in joint.items()}
    rest = {
        "side": size if known is None else known.side,
        "foresight": lines,
        "joint": {} if known is None else {"fine": list(known.fine), "coarse": list(known.coarse)},
    }
    made = curves_from(errors, seen, norm, known)
    for key in errors:
        before = {} if known is None else known.scenes.get(key, {})
        made["scenes"][key]["joint"] = factors[key] if key in factors else before["joint"]
    return made | rest


def errors_of(
    scene: Scene, views: Sequence[Cameras], known: Mapping[str, Mapping[str, Any]] | None = None
) -> dict[str, dict[str, dict[str, Any]]]:
    """Error and time of every setting of every pass that has a choice and something to do: means over the views.

    What goes on from an earlier picture is measured in sequences, all else in the last picture of each view alone.

    Args:
        known: by pass; what holds all settings of a pass is taken over.
    """
    lit, found = scene.with_default_light(), {}
    histories = [RenderHistory() for _ in views]
    for step in PASSES:
        own = (known or {}).get(step.name, {})
        if not step.settings.is_choice or set(own) >= set(step.settings.names):
            found[step.name] = dict(own)
        elif step.continues is not None:
            found[step.name] = {name: one.record() for name, one in measure_pass(scene, views, step)[0].items()}
        else:
            seen = []
            for number, view in enumerate(views):
                made, histories[number] = errors_alone(lit, view[FRAMES - 1], step, histories[number])
                seen += [made] if made else []
            found[step.name] = {s: _means([one[s] for one in seen]) for s in step.settings.names if seen}
    return {name: settings for name, settings in found.items() if settings}


def _means(values: Sequence[Mapping[str, float]]) -> dict[str, float]:
    return {key: float(f"{statistics.fmean(one[key] for one in values):.5g}") for key in values[0]}


def at_step(number: int, base: RenderOptions | None = None, first: str | None = None) -> RenderOptions:
    """All passes at their setting ``number`` (those with fewer stay at their last), the first one at ``first``.

    Passes that can be off are off.
    """
    options = turned_off(base or RenderOptions())
    for step in PASSES:
        if step.off is None:
            names = step.settings.names
            name = names[min(number, len(names) - 1)]
            chosen = first if step is PASSES[0] and first is not None else name
            options = step.settings.named(chosen).applied(options)
    return options


def times_of(scene: Scene, sizes: Sequence[int]) -> Observations:
    """What passes took in short sequences at every step of their settings and several sizes."""
    found: Observations = defaultdict(list)
    for size in sizes:
        view = views_of(scene, size, 1)[0]
        for number in range(STEPS):
            # Numbers of pixels at small and large pictures; the largest at small ones, for it is slow.
            turned = size == sizes[0] or (size == sizes[-1] and number < STEPS - 1)
            _observe(scene, view, at_step(number, first=None if turned else "1"), found)
        for step in PASSES:
            on = [setting for setting in step.settings.all if setting.name != step.off]
            for number, setting in enumerate(on if step.off is not None else ()):
                usual = Setting("measured with", step.measured_with).applied(at_step(number, first="1"))
                _observe(scene, view, setting.applied(usual), found)
    return found


def _observe(scene: Scene, view: Cameras, options: RenderOptions, found: Observations) -> None:
    history = RenderHistory()
    for number in range(FRAMES):
        image = render(scene, view[number], options=options, history=history)
        history = image.history or RenderHistory()
        assert image.plan is not None
        for row in image.plan.running:
            if row.amounts is not None and any(row.amounts) and row.measured_ms is not None:
                found[row.name, row.setting].append((scene_key(scene), row.amounts, row.measured_ms))


def joint_errors(
    scene: Scene, views: Sequence[Cameras], errors: Mapping[str, Mapping[str, Mapping[str, Any]]]
) -> list[tuple[list[float], float]]:
    """Errors of the passes alone, and of the picture with all of them, at settings that bounds choose."""
    lit, found = scene.with_default_light(), []
    for view in views:
        camera = view[FRAMES - 1]
        wanted = Windows.of(lit, camera)
        for bound in BOUNDS:
            image = render(lit, camera, options=RenderOptions(reuse=None), max_error=bound)
            assert image.plan is not None
            alone = []
            for step in PASSES:
                row, known = image.plan.row(step.name), errors.get(step.name, {})
                # A plan predicts no error for a setting that does not show.
                if row.setting in known and row.predicted_error:
                    best = min(float(one["flip"]) for one in known.values()) if step.settings.context.changes else 0.0
                    coarse = coarsening(step, image.plan.options) if row.setting in step.patterns else 1.0
                    alone.append(coarse * (float(known[row.setting]["flip"]) - best))
            found.append((alone, wanted.error(image)))
    return found


def joint_factor(joint: Sequence[tuple[Sequence[float], float]], norm: float) -> float:
    """Median of what pictures of a scene err by over what their passes add up to."""
    pairs = [(sum(e**norm for e in alone) ** (1.0 / norm), whole) for alone, whole in joint]
    ratios = [whole / told for told, whole in pairs if told > 0.0 and whole > 0.0]
    return round(min(max(statistics.median(ratios), 0.25), 4.0), 3) if ratios else 1.0


def curves_from(
    errors: Mapping[str, Any],
    seen: Mapping[tuple[str, str], Sequence[Any]],
    norm: float,
    known: Curves | None = None,
) -> dict[str, Any]:
    """Curves as a JSON object: fits weights by pass and setting, and ratios by scene.

    Args:
        known: whose weights stay for work that no picture had, for it would count as free, and whose scenes stay.
    """
    weights: dict[str, dict[str, list[float]]] = {}
    ratios: dict[str, dict[str, dict[str, float]]] = defaultdict(lambda: defaultdict(dict))
    for step in PASSES:
        everything = [row for s in step.settings.all for row in seen.get((step.name, s.name), ())]
        for setting in step.settings.all:
            rows = everything if step.one_cost else seen.get((step.name, setting.name), ())
            earlier = known.weights.get(step.name, {}).get(setting.name) if known is not None else None
            if not rows:
                if earlier is not None:
                    weights.setdefault(step.name, {})[setting.name] = [float(w) for w in earlier]
                continue
            fitted = fit([r[1] for r in rows], [r[2] for r in rows])
            if earlier is not None and len(earlier) == len(fitted):
                fitted = np.where(np.any([r[1] for r in rows], axis=0), fitted, earlier)
            weights.setdefault(step.name, {})[setting.name] = [float(f"{w:.6g}") for w in fitted]
            for scene in {r[0] for r in rows}:
                own = [_slower(ms, float(np.dot(fitted, a))) for s, a, ms in rows if s == scene]
                ratios[scene][step.name][setting.name] = round(statistics.median(own), 3)
    return {
        "format": FORMAT,
        "torchrender": __version__,
        "machine": machine_record(),
        "norm": norm,
        "weights": weights,
        "scenes": (dict(known.scenes) if known is not None else {})
        | {scene: {"passes": passes, "ratios": ratios.get(scene, {})} for scene, passes in errors.items()},
    }


def _slower(measured_ms: float, predicted_ms: float) -> float:
    return max(measured_ms, SHORTEST_MS) / max(predicted_ms, SHORTEST_MS)


def fit(amounts: Sequence[Sequence[float]], times_ms: Sequence[float]) -> np.ndarray:
    """Weights, none negative, of ``amounts @ weights`` that are as often too high as too low.

    Relative to the times that were measured, a prediction that is too low errs by its whole value at most and one that
    is too high without limit, so that fits of those squares come out low: by several times where times scatter. Errors
    are taken relative to what is predicted, and those beyond a half count in proportion (Huber): a picture that
    something else held up moves the weights little.
    """
    work, times = np.asarray(amounts, float), np.asarray(times_ms, float)
    scale = np.maximum(times, SHORTEST_MS)
    weights = np.zeros(work.shape[1])
    for _ in range(ROUNDS):
        found, _ = nnls(work / scale[:, None], times / scale)
        settled = np.allclose(found, weights, rtol=1e-4, atol=0.0)
        weights = np.asarray(found)
        if settled:
            break
        predicted = np.maximum(work @ weights, SHORTEST_MS)
        error = np.abs(times - predicted) / predicted
        scale = predicted * np.sqrt(np.maximum(error / 0.5, 1.0))
    return weights


def fit_norm(joint: Sequence[tuple[Sequence[float], float]]) -> float:
    """The exponent p of ``(sum e^p)^(1/p)`` with the least squared logarithm of predicted by measured error."""
    pairs = [(np.asarray(alone, float), whole) for alone, whole in joint if whole > 1e-6 and max(alone, default=0) > 0]
    if not pairs:
        return 1.5
    cost = [sum(np.log(np.sum(alone**p) ** (1 / p) / whole) ** 2 for alone, whole in pairs) for p in NORMS]
    return round(float(NORMS[int(np.argmin(cost))]), 2)
