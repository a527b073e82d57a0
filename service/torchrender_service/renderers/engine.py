"""The one place where the service calls the renderer and its planner."""

from __future__ import annotations

import math
from typing import Any

from torchrender.image import Image
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.curves import load_curves
from torchrender.planning.planner import plan
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import Bounds


def render_image(
    scene: Scene,
    camera: Cameras,
    bounds: Bounds,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
) -> tuple[Image, dict[str, Any]]:
    """A picture and its plan as plain values: what ran, why, and how long it took."""
    image = render(
        scene, camera, options=options, history=history, budget_ms=bounds.budget_ms, max_error=bounds.max_error
    )
    assert image.plan is not None
    return image, image.plan.to_dict()


def plan_image(scene: Scene, camera: Cameras, bounds: Bounds) -> dict[str, Any]:
    """What :func:`render_image` would do, as plain values, with a table for readers under ``text``."""
    made = plan(scene, camera, budget_ms=bounds.budget_ms, max_error=bounds.max_error)
    return made.to_dict() | {"text": str(made)}


def tradeoff(name: str) -> dict[str, Any]:
    """Time against error of every setting of a pass.

    Times are predictions for the amounts of work that the shipped scenes were measured with; errors are mean FLIP
    against the pass's reference.

    Raises:
        ServiceError: 404, no pass of that name.
    """
    step = next((p for p in PASSES if p.name == name), None)
    if step is None:
        known = ", ".join(p.name for p in PASSES)
        raise ServiceError(404, "no-such-pass", f"there is no pass {name[:80]!r}; known passes: {known}")
    curves = load_curves()
    scenes = {
        scene: {setting: _plain(record) for setting, record in settings.items()}
        for scene, passes in curves.scenes.items()
        for pass_name, settings in passes["passes"].items()
        if pass_name == name
    }
    return {
        "pass": name,
        "summary": step.summary,
        "knob": step.settings.title,
        "reference": step.settings.reference.name,
        "settings": [_setting(setting, scenes) for setting in step.settings.names],
        "scenes": scenes,
        "measured_on": dict(curves.machine),
    }


def _setting(setting: str, scenes: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Means over the scenes in which the pass was measured; null where it never was."""
    records = [measured[setting] for measured in scenes.values() if setting in measured]
    row: dict[str, Any] = {"setting": setting}
    for key in ("ms", "flip"):
        values = [r[key] for r in records if isinstance(r.get(key), int | float)]
        row["ms" if key == "ms" else "error"] = round(sum(values) / len(values), 5) if values else None
    return row


def _plain(record: Any) -> dict[str, Any]:
    """JSON has no infinity."""
    finite = {k: v for k, v in record.items() if not isinstance(v, float) or math.isfinite(v)}
    return finite | {k: None for k in record if k not in finite}
