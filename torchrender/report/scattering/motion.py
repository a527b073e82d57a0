"""What changes from picture to picture: a sun that moves, and edits of a medium."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.effects.media.in_view import boxes_in_view, boxes_of, shadowed_by
from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.pipeline.history import RenderHistory
from torchrender.quality.timing import take_turns
from torchrender.renderer import render
from torchrender.report.scattering.scenes import eye, t2
from torchrender.report.scattering.stage import Stage, StudyOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.fog import changed_media

SHOWN = 5
"""Pictures of the film that are kept."""
MAGNIFIED = 8.0
"""Errors are shown so many times as bright."""


def film(study: StudyOptions, folder: Path) -> dict[str, float]:
    """A sun that turns slowly: variance over time of the error, beside plain bilinear interpolation.

    ``scattering-film.jpg`` shows the light, the error of blocks and that of plain interpolation.
    """
    scene, camera = t2("sun"), eye(*study.film)
    every, ours, plain = [], [], []
    for k in range(study.frames):
        angle = 0.15 * k / max(study.frames - 1, 1)
        sun = DirectionalLight(
            direction=torch.tensor([0.75, -0.55 + angle, -0.35 + angle]), irradiance=torch.full((3,), 3.0)
        )
        stage = Stage.of(replace(scene, lights=(sun,)), camera, study.map_size)
        whole = stage.light(block=1)
        few = whole[1::3, 1::3]
        between = torch.nn.functional.interpolate(
            few[None, None], size=whole.shape, mode="bilinear", align_corners=False
        )[0, 0]
        every.append(whole)
        ours.append(stage.light(block=3) - whole)
        plain.append(between - whole)
    _show(every, ours, plain, folder / "scattering-film.jpg")
    variance = [float(torch.stack(e).var(dim=0, unbiased=False).mean()) for e in (ours, plain)]
    return {"ours": variance[0], "bilinear": variance[1], "ratio": variance[0] / max(variance[1], 1e-30)}


def _show(every: list[Tensor], ours: list[Tensor], plain: list[Tensor], path: Path) -> None:
    top = torch.stack(every).max().clamp_min(1e-12)
    chosen = sorted({round(k * (len(every) - 1) / (SHOWN - 1)) for k in range(SHOWN)})
    rows = [torch.cat([every[k] / top for k in chosen], dim=1)]
    rows += [torch.cat([MAGNIFIED * e[k].abs() / top for k in chosen], dim=1) for e in (ours, plain)]
    sheet = (srgb_from_linear(torch.cat(rows).clamp(0, 1).float()) * 255).round().to(torch.uint8).numpy()
    write_atomically(path, lambda file: Picture.fromarray(sheet).save(file, format="JPEG", quality=88))


def edits(study: StudyOptions) -> dict[str, Any]:
    """Milliseconds of pictures after edits and of those that follow, and of asking whether a medium is in view."""
    scene, camera = t2("lamp", "height"), eye(*study.size)
    lamp = scene.lights[0]
    assert isinstance(lamp, PointLight)
    # Each number is another one than before: the scene with it is new to the history.
    changes: dict[str, Callable[[int], Scene]] = {
        "density": lambda k: changed_media(scene, 1.0 + 0.01 * k),
        "phase function": lambda k: changed_media(scene, 1.0, 0.1 + 0.02 * k),
        "a light moves": lambda k: replace(scene, lights=(replace(lamp, position=lamp.position + 0.01 * k),)),
    }
    return {
        "pictures": {name: _first_and_next(change, camera, max(study.runs, 3)) for name, change in changes.items()},
        "none in view": _asked(scene, camera, study),
    }


def _first_and_next(change: Callable[[int], Scene], camera: Cameras, runs: int) -> dict[str, float]:
    """Least milliseconds of the picture after an edit, and of the next one, in turn."""
    history = RenderHistory()
    times: tuple[list[float], list[float]] = ([], [])
    for k in range(runs + 1):
        scene = change(k + 1)
        for turn in range(2):
            begin = time.perf_counter()
            image = render(scene, camera, history=history)
            times[turn].append(1e3 * (time.perf_counter() - begin))
            assert image.history is not None
            history = image.history
    first, after = (min(found[1:]) for found in times)  # the first turn compiles and draws what lasts
    return {"first": first, "next": after, "ratio": first / after}


def _asked(scene: Scene, camera: Cameras, study: StudyOptions) -> float:
    """Milliseconds of what the planner asks before it leaves the pass out."""
    low, high = torch.tensor([0.0, 0.0, 3.0]), torch.tensor([1.0, 1.0, 4.0])
    boxes = boxes_of((replace(scene.media[0], low=low, high=high, name="behind"),))

    def none() -> bool:
        seen = bool(boxes_in_view(boxes, camera).any())
        return seen or bool(boxes_in_view(shadowed_by(boxes, (), scene.diagonal), camera).any())

    assert not none()
    return take_turns({"none": none}, runs=max(study.runs, 5), warm_up=1)["none"].median
