"""What changes from picture to picture: a sun that moves, and edits of a medium."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.effects.media.in_view import boxes_in_view, boxes_of, shadowed_by
from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.quality.timing import take_turns
from torchrender.report.scattering.scenes import eye, t2
from torchrender.report.scattering.stage import Stage, StudyOptions
from torchrender.scene.light import DirectionalLight

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


def edits(study: StudyOptions) -> dict[str, float]:
    """Milliseconds of pictures of a medium that stays, of ones before which it changes, and of none in view."""
    stage = Stage.of(t2("lamp", "height"), eye(*study.size), study.map_size)
    count = [0]

    def edited() -> object:
        count[0] += 1
        step = 1.0 + 0.01 * count[0]
        medium = replace(stage.scene.media[0], density=1.5 * step, asymmetry=0.1 * (count[0] % 5))
        return replace(stage, scene=replace(stage.scene, media=(medium,))).layer()

    behind = replace(
        stage.scene.media[0], low=torch.tensor([0.0, 0.0, 3.0]), high=torch.tensor([1.0, 1.0, 4.0]), name="behind"
    )

    def none() -> bool:
        """What the planner asks before it leaves the pass out."""
        boxes = boxes_of((behind,))
        seen = bool(boxes_in_view(boxes, stage.camera).any())
        return seen or bool(boxes_in_view(shadowed_by(boxes, (), stage.scene.diagonal), stage.camera).any())

    candidates: dict[str, Callable[[], object]] = {
        "the same medium": stage.layer, "another medium each time": edited, "none in view": none
    }  # fmt: skip
    found = take_turns(candidates, runs=max(study.runs, 3), warm_up=1)
    return {name: timing.least for name, timing in found.items()}
