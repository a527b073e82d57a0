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
from torchrender.planning.curves import FORMAT, Curves, scene_key
from torchrender.quality.machine import machine_record
from torchrender.quality.metrics import flip
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural.anything import anything
from torchrender.tuning import unseen
from torchrender.tuning.measure import FRAMES, SIDE, Measured, exact_options, measure_pass, turned_off, views_of

Observations = dict[tuple[str, str], list[tuple[str, tuple[float, ...], float]]]
"""Scene, amounts of work and milliseconds, by pass and setting."""

STEPS = max(len(step.settings.all) for step in PASSES)
SIZES = (128, 256, 512)
NORMS = np.arange(0.75, 3.01, 0.05)

SHORTEST_MS = 0.5
"""Times below count as this in relative errors: nobody plans with them."""

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
    joint: list[tuple[list[float], float]] = []
    seen: Observations = defaultdict(list)
    for scene in scenes:
        key = scene_key(scene)
        if known is not None and key in known.scenes:
            errors[key] = known.scenes[key]["passes"]
        else:
            errors[key] = errors_of(scene, views_of(scene, size))
            joint += [] if known is not None else joint_errors(scene, size, errors[key])
            tell(f"{scene.name}: errors measured")
        for name, values in times_of(scene, [s for s in SIZES if s < size] + [size]).items():
            seen[name] += values
        tell(f"{scene.name}: times measured")
    if known is None or not known.lines:
        records = [unseen.record_of(anything(seed)) for seed in unseen.SEEDS]
        lines = unseen.lines_of(records)
        tell(f"{len(records)} random scenes: errors measured")
    else:
        lines = {
            name: {setting: line.to_list() for setting, line in rows.items()} for name, rows in known.lines.items()
        }
    norm = fit_norm(joint) if known is None else known.norm  # one new scene says little about how errors add up
    rest = {
        "side": size if known is None else known.side,
        "foresight": lines,
        "joint": {} if known is None else {"fine": list(known.fine), "coarse": list(known.coarse)},
    }
    return curves_from(errors, seen, norm, known) | rest


def errors_of(scene: Scene, views: Sequence[Cameras]) -> dict[str, dict[str, dict[str, Any]]]:
    """Records of every setting of every pass that has something to do."""
    found: dict[str, dict[str, Measured]] = {step.name: measure_pass(scene, views, step)[0] for step in PASSES}
    return {
        name: {setting: measured.record() for setting, measured in settings.items()}
        for name, settings in found.items()
        if settings
    }


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
    scene: Scene, size: int, errors: Mapping[str, Mapping[str, Mapping[str, Any]]]
) -> list[tuple[list[float], float]]:
    """Errors of the passes alone, and of the picture with all of them, for every step of the settings."""
    view = views_of(scene, size, 1)[0][:1]
    wanted = render(scene, view, options=exact_options()).displayed()
    found = []
    for number in range(STEPS - 1):
        image = render(scene, view, options=at_step(number))
        assert image.plan is not None
        alone = [
            float(errors[row.name][row.setting]["flip"])
            for row in image.plan.running
            # A plan predicts no error for a setting that does not show.
            if row.setting in errors.get(row.name, {}) and row.predicted_error
        ]
        found.append((alone, float(flip(image.displayed(), wanted)[0])))
    return found


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
