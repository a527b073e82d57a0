"""What a system is whose settings are measured on scenes, and how: each setting makes something that can be drawn.

The reference of a picture is the scene itself by another way, never one of the settings.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.tonemap import auto_exposure, tone_map
from torchrender.quality.metrics import flip_map, psnr, relative_squared_error
from torchrender.scene.model import Scene
from torchrender.tuning.measure import FRAMES, Measured


@dataclass(frozen=True, eq=False, kw_only=True)
class Trial:
    """A system on one scene, seen by one camera."""

    settings: Mapping[str, Callable[[], Any]]  # make something, from fast to exact: this is timed
    picture: Callable[[Any], Tensor]  # what it shows: radiance (1,H,W,3)
    reference: Callable[[], Tensor]  # (1,H,W,3)
    own: Callable[[Any], float] | None = None  # the system's own measure of what was made


@dataclass(frozen=True, kw_only=True)
class System:
    """A system, and how it is tried on scenes."""

    name: str
    summary: str  # one line for readers
    reference: str  # what errors are measured against
    own: str | None = None  # title of its own measure
    trial: Callable[[Scene, int], Trial | None]  # of a scene with light, and pixels of a side; None: nothing to do


def measure_system(
    scene: Scene, size: int, system: System, *, pictures: bool = False
) -> tuple[dict[str, Measured], Tensor | None]:
    """Every setting of a system on a scene, in pictures of ``size`` pixels a side; empty where it has nothing to do.

    Times are those of making alone: first, and again with what is kept. With ``pictures`` also the reference (H,W,3)
    sRGB.
    """
    trial = system.trial(scene.with_default_light(), size)
    if trial is None:
        return {}, None
    wanted = trial.reference()
    exposure = auto_exposure(wanted, mask=(wanted > 0).any(-1))
    found = {name: _measured(make, trial, wanted, exposure, pictures) for name, make in trial.settings.items()}
    return found, srgb_from_linear(_displayed(wanted, exposure))[0] if pictures else None


def _displayed(radiance: Tensor, exposure: float) -> Tensor:
    return tone_map(radiance, exposure=exposure)


def _measured(make: Callable[[], Any], trial: Trial, wanted: Tensor, exposure: float, pictures: bool) -> Measured:
    times, shown = [], []
    for number in range(FRAMES):
        begin = time.perf_counter()
        made = make()
        times.append(1e3 * (time.perf_counter() - begin))
        if number >= FRAMES - 2:  # the last one is made twice
            shown.append(trial.picture(made))
    image, exact = _displayed(shown[-1], exposure), _displayed(wanted, exposure)
    difference = flip_map(image, exact)
    quarters = statistics.quantiles(times[1:], n=4)
    return Measured(
        flip=float(difference.mean()),
        psnr=float(psnr(image, exact)[0]),
        relative_mse=float(relative_squared_error(shown[-1], wanted)[0]),
        own=None if trial.own is None else trial.own(made),
        ms=statistics.median(times[1:]),
        spread_ms=quarters[2] - quarters[0],
        first_ms=times[0],
        runs=FRAMES - 1,
        repeats=torch.equal(*shown),
        picture=srgb_from_linear(image)[0] if pictures else None,
        difference=difference[0] if pictures else None,
    )
