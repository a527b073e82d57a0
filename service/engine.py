"""The one place where the service calls the renderer."""

from __future__ import annotations

from typing import Any

from service.jobs import Bounds
from torchrender.history import RenderHistory
from torchrender.image import Image
from torchrender.renderer import RenderOptions, render
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def render_image(
    scene: Scene,
    camera: Cameras,
    bounds: Bounds,
    options: RenderOptions | None = None,
    history: RenderHistory | None = None,
) -> tuple[Image, dict[str, Any]]:
    """A picture and its plan as plain values: what ran, why, and how long it took."""
    del bounds
    image = render(scene, camera, options=options, history=history)
    return image, _plan_of(image)


def _plan_of(image: Image) -> dict[str, Any]:
    steps = {name: ms for name, ms in image.timings_ms.items() if name != "total"}
    rows = [
        {
            "pass": name,
            "runs": True,
            "reason": "always",
            "settings": "",
            "predicted_ms": None,
            "measured_ms": round(ms, 2),
        }
        for name, ms in steps.items()
    ]
    return {
        "rows": rows,
        "predicted_ms": None,
        "measured_ms": round(image.timings_ms["total"], 2),
        "predicted_error": None,
        "statement": "",
    }
