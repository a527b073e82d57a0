"""What the stability suite knows about a pass: how to run it on a case, what bounds hold, and a law or reference."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.effects.reflections.reflectors import RayShader, ReflectivePixels
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, RectLight
from torchrender.scene.model import Scene

SMALL_SHADOW = ShadowOptions(size=128, search_taps=8, taps=8)
"""Shadow maps of the suite: enough for its small pictures."""


class Subject(Protocol):
    """A scene and its cameras, with what several passes take from them."""

    @property
    def scene(self) -> Scene: ...
    @property
    def cameras(self) -> Cameras: ...
    @property
    def unit(self) -> float:
        """Scene units per unit of the case that must look the same."""

    @property
    def gbuffer(self) -> GBuffer:
        """What the cameras see."""

    @property
    def caster(self) -> RayCaster:
        """Rays into the scene."""

    @property
    def pixels(self) -> ReflectivePixels:
        """Pixels that mirror."""

    @property
    def shader(self) -> RayShader:
        """Colours of what rays hit, with hard shadows by :data:`SMALL_SHADOW`."""

    @property
    def area_lights(self) -> list[RectLight]:
        """The rectangular lights."""

    @property
    def radiance_limit(self) -> float:
        """No surface can send more than this."""

    def with_cameras(self, cameras: Cameras) -> Subject:
        """The same scene, seen by others."""


Outputs = Mapping[str, Tensor]
"""Named results of an effect; lengths are in units of :attr:`Subject.unit`, so that twins can be compared."""

SHAPE, VIEW, LIGHTS = frozenset({"scene"}), frozenset({"scene", "view"}), frozenset({"scene", "light"})
"""What effects that do not depend on everything depend on."""

TOLERANCE = 1e-3
"""Relative difference above which two values count as different."""


@dataclass(frozen=True, kw_only=True)
class Law:
    """Something that must hold for every result: an exact law, or a reference made in another way."""

    text: str  # what must hold, and what the deviation is
    deviation: Callable[[Subject, Outputs], float]  # 0: it holds
    limit: float  # largest deviation that is no error


@dataclass(frozen=True, eq=False, kw_only=True)
class HardEffect:
    """An effect, or a step of the pipeline. A later one adds one record."""

    name: str  # of the pass, where there is one
    modules: tuple[str, ...]  # of the package, that it is about
    run: Callable[[Subject], Outputs]
    bounds: Callable[[Subject], Mapping[str, tuple[float, float]]]  # of each result of floats; +inf: may be infinite
    law: Law
    skip: Callable[[Subject], str | None] = lambda _: None  # why a case says nothing about the effect
    about: frozenset[str] = frozenset({"scene", "view", "light"})  # what it depends on: cases that differ in that
    parallel: bool = True  # orthographic cameras are taken
    borders: bool = False  # what lies exactly on borders of cells decides, which rounding moves
    turns: bool = True  # the result does not depend on the axes of the world
    rounding: float = 0.02  # share of values that may change when vertices are rounded to float32
    twins: float = 0.02  # share of values that may differ between cases that must look the same


def bounds_error(outputs: Outputs, bounds: Mapping[str, tuple[float, float]]) -> str | None:
    """What is wrong with the first result that is not finite or not within its bounds; None if all are right."""
    for name, value in outputs.items():
        if not value.is_floating_point():
            continue
        low, high = bounds[name]
        good = (value >= low) & (value <= high)  # NaN fails both
        if not bool(good.all()):
            bad = value[~good]
            return f"{name}: {bad.numel()} of {value.numel()} values outside [{low:g}, {high:g}], one is {bad[0]:g}"
    return None


def same(first: Outputs, second: Outputs) -> bool:
    """Bit by bit, NaN included."""
    return first.keys() == second.keys() and all(
        first[k].shape == second[k].shape and torch.equal(first[k].nan_to_num(), second[k].nan_to_num()) for k in first
    )


def difference(first: Outputs, second: Outputs, tolerance: float = TOLERANCE) -> float:
    """Largest share over all results of values that differ.

    Floats differ by more than ``tolerance`` of the larger one, or of the result's mean size where that is more.
    """
    if first.keys() != second.keys():
        return 1.0
    return max((_share(first[name], second[name], tolerance) for name in first), default=0.0)


def _share(first: Tensor, second: Tensor, tolerance: float) -> float:
    if first.shape != second.shape:
        return 1.0
    if not first.numel():
        return 0.0
    if not first.is_floating_point():
        return float((first != second).double().mean())
    a, b = first.double(), second.double()
    finite = torch.isfinite(a) & torch.isfinite(b)
    size = torch.where(finite, torch.maximum(a.abs(), b.abs()), 0.0)
    size = size.clamp_min(float(size.sum() / finite.sum().clamp_min(1)))
    near = (a - b).abs() <= tolerance * size
    return float((~torch.where(finite, near, a == b)).double().mean())


def mean_over(error: Tensor, chosen: Tensor) -> float:
    """Mean of ``error`` where ``chosen``; 0 where nothing is."""
    return float(error[chosen].double().mean()) if bool(chosen.any()) else 0.0


def displayed(radiance: Tensor) -> Tensor:
    """Values in [0,1]: differences in what a screen clips do not show."""
    return radiance.clamp(0.0, 1.0)


def no_lights(subject: Subject) -> str | None:
    """Why a case says nothing about shadows."""
    return None if subject.scene.lights else "no light"


def no_mirrors(subject: Subject) -> str | None:
    """Why a case says nothing about reflections."""
    return None if len(subject.pixels) else "nothing in view mirrors"


def receives(subject: Subject, light: Light) -> Tensor:
    """(B,H,W) bool: a surface to whose side the light sends; the other side of a rectangle is not asked for shadows."""
    seen = subject.gbuffer
    if not isinstance(light, RectLight) or not light.area > 0:
        return seen.covered
    before = ((seen.position - light.centre.double()) * light.normal.double()).sum(dim=-1) > 0
    return seen.covered & before


def radiance_bounds(subject: Subject) -> Mapping[str, tuple[float, float]]:
    """Of a picture."""
    return {"radiance": (0.0, subject.radiance_limit)}
