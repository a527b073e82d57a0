"""Hundreds of small views: depth alone, or with normals and ids; beside open3d's rays of the same cameras."""

from __future__ import annotations

import time
from collections.abc import Callable
from statistics import median
from typing import Any

import torch
from torch import Tensor

from torchrender.raster import rasterize
from torchrender.report.common.memory import added_memory
from torchrender.report.foundation.peers import open3d_rays
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

SIDE = 256
OUTPUTS = ("depth", "normal", "object_id")
PEER_VIEWS = 10
"""Cameras whose rays open3d casts, of those of the whole."""


def random_views(scene: Scene, count: int) -> Cameras:
    """Cameras in the middle of a scene that look anywhere."""
    random = torch.Generator().manual_seed(0)
    low, high = scene.bounds
    eyes, targets = torch.rand(2, count, 3, generator=random, dtype=torch.float64)
    eyes, targets = low + (high - low) * (0.3 + 0.4 * eyes), low + (high - low) * targets
    return Cameras.look_at(eyes, targets, width=SIDE, height=SIDE)


def measured(name: str, count: int, repeats: int) -> dict[str, Any]:
    """Pictures per second of one scene by way of drawing, and the memory that one call adds."""
    scene = load(name)
    views = random_views(scene, count)
    record: dict[str, Any] = {"scene": name, "triangles": scene.geometry.triangle_count, "views": count}
    for outputs in (("depth",), OUTPUTS):
        rasterize(scene, views[:16], outputs=outputs)  # what is compiled or kept for good is there
        grown, peak = added_memory(lambda: rasterize(scene, views, outputs=outputs))  # noqa: B023
        rates = [count / _seconds(lambda: rasterize(scene, views, outputs=outputs)) for _ in range(repeats)]  # noqa: B023
        alone = count / _seconds(lambda: [rasterize(scene, views[k], outputs=outputs) for k in range(count)])  # noqa: B023
        row = {"rate": median(rates), "loop": alone, "grown_mb": grown, "peak_mb": peak}
        record["depth" if len(outputs) == 1 else "all"] = row
    record["open3d"] = _open3d(scene, views)
    record["same"] = _same(rasterize(scene, views, outputs=OUTPUTS), scene, views)
    return record


def _same(found: dict[str, Tensor], scene: Scene, views: Cameras) -> bool:
    """Every tenth view is, bit by bit, what a G-buffer of it alone holds."""
    for k in range(0, len(views), 10):
        alone = rasterize(scene, views[k])
        if not all(torch.equal(found[name][k], getattr(alone, name)[0]) for name in OUTPUTS):
            return False
    return True


def _open3d(scene: Scene, views: Cameras) -> float | str:
    """Pictures per second of rays that were made before, which give depth, normals and ids; or why not."""
    seconds = []
    for k in range(PEER_VIEWS):
        made = open3d_rays(scene.geometry, views[k], torch.get_num_threads())
        if isinstance(made, str):
            return made
        made[1]()
        seconds.append(_seconds(made[1]))
    return len(seconds) / sum(seconds)


def _seconds(work: Callable[[], Any]) -> float:
    begin = time.perf_counter()
    work()
    return time.perf_counter() - begin
