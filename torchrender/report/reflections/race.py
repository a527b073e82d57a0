"""All ways in turn on one view of a scene that changes with every picture, and what the planner would take."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.reflectors import reflected_rays
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.planner import plan
from torchrender.quality.timing import take_turns
from torchrender.report.reflections.stage import Stage
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene

HYBRID = ClusterOptions(missing="trace")
OWN = ("clustered", "hybrid", "traced")
EMBREE = "plain Embree"
FLOOR = "shading alone"


def candidates_of(stage: Stage) -> dict[str, Callable[[], object]]:
    """The ways one mirror deep, as plain Embree has it, trees included; and the floor, the shading of known hits."""
    rays, hits = reflected_rays(stage.pixels), stage.true_hits
    found: dict[str, Callable[[], object]] = {
        "clustered": lambda: stage.clustered(bounces=1),
        "hybrid": lambda: stage.clustered(HYBRID, bounces=1),
        "traced": lambda: stage.traced(bounces=1),
        FLOOR: lambda: stage.shader(rays, hits),
    }
    plain = stage.plain_embree()
    if plain is not None:
        found[EMBREE] = plain
    return found


def race(stage: Stage, cameras: Cameras, runs: int) -> dict[str, Any]:
    """Least milliseconds by way, mirrored pixels, what all ways pay for beside, and the planner's way."""
    timing = take_turns(candidates_of(stage), runs=runs, warm_up=0)
    row: dict[str, Any] = {"pixels": len(stage.pixels), "picked": picked(stage.scene, cameras)}
    row["preparations"] = stage.preparations()
    return row | {name: t.least for name, t in timing.items()}


def picked(scene: Scene, cameras: Cameras) -> str:
    """The way that the planner takes for one picture of a scene that it has not seen before."""
    options = plan(scene, cameras, options=RenderOptions(reflections="auto")).options
    if options.reflections != "clustered":
        return options.reflections
    return "hybrid" if options.reflection.missing == "trace" else "clustered"
