"""Ways of scattering: the source's own beside full marching, and all of them in large pictures beside references."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import torch

from torchrender.quality.timing import Timing, take_turns
from torchrender.report.scattering.probes import Probes
from torchrender.report.scattering.scenes import KINDS, eye, t1, t2
from torchrender.report.scattering.stage import SUN_STEPS, Stage, StudyOptions, errors, shaft_edges
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene

PUBLISHED: dict[str, dict[str, Any]] = {
    "3 x 3, guard 0, no gradient": {"block": 3, "halo_guard_px": 0, "gradient": "none"},
    "3 x 3, guard 0, nearest (printed)": {"block": 3, "halo_guard_px": 0, "gradient": "nearest"},
    "3 x 3, guard 0, lsq": {"block": 3, "halo_guard_px": 0, "gradient": "lsq"},
    "3 x 3, guard 20, lsq": {"block": 3, "halo_guard_px": 20, "gradient": "lsq"},
    "2 x 2, guard 20, lsq": {"block": 2, "halo_guard_px": 20, "gradient": "lsq"},
}
"""Rows of the source's table."""
LENGTH_ALONE = 1.0
"""Tolerance of lit shares with which pixels are marked by the length of their way alone."""
ANY_STEP = 0.005
"""One that is less than a step's share of a ray."""

CASES: dict[str, Callable[[], Scene]] = {
    **{f"T1 lamp, {kind}": partial(t1, kind) for kind in KINDS[:2]},
    **{f"T2 {light}, {kind}": partial(t2, light, kind) for light in ("lamp", "sun") for kind in KINDS},
}
"""Large pictures."""
QUICK_WAYS: dict[str, dict[str, Any]] = {
    "slices": {"way": "slices", "block": 1},
    "slices, 2 x 2": {"way": "slices", "block": 2},
    "slices, 3 x 3": {"way": "slices", "block": 3},
    "slices, 3 x 3, marks by length alone": {"way": "slices", "block": 3, "share_tolerance": LENGTH_ALONE},
    "walk, 2 x 2": {"way": "walk", "block": 2},
}
SLOW_WAYS: dict[str, dict[str, Any]] = {"64 steps": {"way": "march", "block": 1}}
"""Run once: the time of 480,000 rays does not scatter much."""


def published(study: StudyOptions) -> dict[str, list[dict[str, Any]]]:
    """The source's own way: T1 without shadows, and T2 with marks by length alone and by lit share, too.

    Errors and speed-up are against all rays marched by the same kernel; edges apart in T2.
    """
    found = {"T1, no shadows": _published(Stage.of(t1(), eye(*study.small), study.map_size, shadows=False), study)}
    for light in ("lamp", "sun"):
        found[f"T2, {light}"] = _published(Stage.of(t2(light), eye(*study.small), study.map_size), study)
    return found


def _published(stage: Stage, study: StudyOptions) -> list[dict[str, Any]]:
    how: dict[str, Any] = {"way": "march", "steps": study.published_steps, "jitter": False}
    every = stage.light(block=1, **how)
    shadows = len(stage.lit.shadow_maps) > 0
    plans = dict(PUBLISHED)
    if shadows:
        last = {"halo_guard_px": 20, "gradient": "lsq", "share_tolerance": LENGTH_ALONE}
        plans |= {f"{n} x {n}, guard 20, lsq, marks by length alone": {"block": n, **last} for n in (3, 2)}
        last = {**last, "share_tolerance": ANY_STEP}
        plans |= {f"{n} x {n}, guard 20, lsq, marks where a step differs": {"block": n, **last} for n in (3, 2)}
    work = {name: _layer(stage, {**how, **plan}) for name, plan in plans.items()}
    times = take_turns({"all": _layer(stage, {**how, "block": 1}), **work}, runs=study.runs, warm_up=1)
    edge = shaft_edges(every) if shadows else None
    rows = []
    for name, plan in plans.items():
        layer = stage.layer(**how, **plan)
        rows.append({
            "plan": name, "marched": float(layer.integrated.mean()), "ms": times[name].least,
            "times": times["all"].least / times[name].least,
            **errors(layer.scattered[0, ..., 0].double(), every, edge),
        })  # fmt: skip
    return rows


def _layer(stage: Stage, how: Mapping[str, Any]) -> Callable[[], object]:
    return lambda: stage.layer(**how)


def ways(study: StudyOptions) -> list[dict[str, Any]]:
    """T1 and T2 in large pictures: milliseconds with all set-up, and errors against the walk and against rays."""
    return [row for name, make in CASES.items() for row in ways_of(name, make(), study)]


def ways_of(name: str, scene: Scene, study: StudyOptions) -> list[dict[str, Any]]:
    """The rows of one scene: its pixels' light is the walk's, with four times as many panels, and that of rays."""
    stage = Stage.of(scene, eye(*study.size), study.map_size)
    chosen = quick_ways(scene)
    times = take_turns({k: _layer(stage, o) for k, o in chosen.items()}, runs=study.runs, warm_up=1)
    slow = {k: _once(_layer(stage, o)) for k, o in SLOW_WAYS.items()}
    layers = {k: stage.layer(**o) for k, o in chosen.items()}
    lights = {k: layer.scattered[0, ..., 0].double() for k, layer in layers.items()}
    probes = Probes.of(stage, lights["slices"], study.probes)
    walk = probes.light(way="walk", panels=32)
    finer = SUN_STEPS if isinstance(scene.lights[0], DirectionalLight) else 1
    rays = probes.light(way="march", shadows="rays", steps=finer * study.rays_steps)
    marched = torch.zeros_like(lights["slices"]).reshape(-1)
    marched[probes.chosen] = probes.light(way="march")
    lights["64 steps"] = marched.reshape(lights["slices"].shape)
    rows = []
    for way, light in lights.items():
        timing: Timing = times[way] if way in times else slow[way]
        share = float(layers[way].integrated.mean()) if way in layers else 1.0
        rows.append({
            "case": name, "way": way, "ms": timing.median, "least_ms": timing.least, "share": share,
            "walk": probes.errors(light, walk), "rays": probes.errors(light, rays),
        })  # fmt: skip
    return rows


def quick_ways(scene: Scene) -> dict[str, dict[str, Any]]:
    """Those that differ: where slices lead to closed forms, all rays are integrated whatever the block."""
    closed = isinstance(scene.media[0].density, float) and scene.media[0].falloff == 0
    return {k: how for k, how in QUICK_WAYS.items() if not (closed and how["way"] == "slices" and how["block"] > 1)}


def _once(work: Callable[[], object]) -> Timing:
    begin = time.perf_counter()
    work()
    return Timing.of([time.perf_counter() - begin])
