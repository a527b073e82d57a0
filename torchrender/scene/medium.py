"""Participating media, as data: a box with absorption, scattering and a density."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import as_array, as_vector, check_choice, check_finite, check_no_gradient, check_range
from torchrender.errors import InputError
from torchrender.scene.parts.places import check_near

SCALES = ("both", "absorption")
LARGEST_RISE = 60.0
"""Largest exponent of a density inside its box: more would leave the range of float32."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Medium:
    """A medium inside an axis-aligned box; coefficients are per scene unit at density 1.

    Without further words it is a thin white haze: it scatters 0.1 per unit, and absorbs and emits nothing. What is to
    absorb alone takes ``scattering=0`` besides ``absorption``. Coefficients are numbers, or three for red, green, blue.

    A ray gains ``absorption emission`` radiance per unit: what does not absorb does not glow, and a picture of such a
    medium says so (NotUsedWarning).

    The density is a number, a number that falls off with height, ``density exp(-falloff (y - floor))``, or a grid whose
    cells fill the box; between the centres of cells it is trilinear, and outside of the box there is nothing. Media may
    overlap: what is in them adds up.

    Raises:
        InputError: box corners out of order or beyond 1e30, negative or infinite coefficients or densities, a grid that
            is not (D,H,W), a grid that also falls off, or a density that leaves the range of float32 inside the box.
        OptionError: ``asymmetry`` outside [-0.99, 0.99], ``falloff`` negative, another ``density_scales``.
    """

    low: Tensor  # (3,) float64 smallest corner
    high: Tensor  # (3,) float64 largest corner
    absorption: Tensor = field(default_factory=lambda: torch.zeros(3))  # (3,) 1/unit; default 0
    scattering: Tensor = field(default_factory=lambda: torch.full((3,), 0.1))  # (3,) 1/unit; default 0.1
    emission: Tensor = field(default_factory=lambda: torch.zeros(3))  # (3,) radiance L_e that what absorbs sends out
    asymmetry: float = 0.0  # Henyey-Greenstein g
    density: Tensor | float = 1.0  # a number, or a grid (D,H,W) over the box: z, y, x
    falloff: float = 0.0  # 1/unit; of a number, with height
    floor: float | None = None  # height y at which a density that falls off is the number; None: the box's floor
    density_scales: str = "both"  # what the density multiplies: "both" coefficients, or "absorption" alone
    name: str = "medium"

    __repr__ = brief

    def __post_init__(self) -> None:
        # Places are float64: float32 steps far from the origin would move the sides of the box.
        for name in ("low", "high", "absorption", "scattering", "emission"):
            dtype = torch.float64 if name in ("low", "high") else torch.float32
            value = as_vector(f"medium {self.name!r}: {name}", getattr(self, name), dtype=dtype)
            object.__setattr__(self, name, value)
        for name in ("low", "high"):
            check_near(f"medium {self.name!r}: {name}", getattr(self, name))
        if not bool((self.high > self.low).all()):
            low, high = self.low.tolist(), self.high.tolist()
            raise InputError(f"medium {self.name!r}: high must exceed low, got {low} and {high}")
        for name in ("absorption", "scattering", "emission"):
            if bool((getattr(self, name) < 0).any()):
                raise InputError(f"medium {self.name!r}: {name} must not be negative")
        check_no_gradient("a medium", asymmetry=self.asymmetry, falloff=self.falloff, floor=self.floor)
        check_range(f"medium {self.name!r}: asymmetry", self.asymmetry, -0.99, 0.99)
        check_choice(f"medium {self.name!r}: density_scales", self.density_scales, SCALES)
        check_range(f"medium {self.name!r}: falloff", self.falloff, 0.0)
        if isinstance(self.density, np.ndarray | list | tuple):
            grid = as_array(f"medium {self.name!r}: density", self.density, torch.float32)
            object.__setattr__(self, "density", grid)
        self._check_density()

    def _check_density(self) -> None:
        if isinstance(self.density, Tensor):
            if self.density.dim() != 3 or not self.density.numel():
                raise InputError(f"medium {self.name!r}: density must be (D, H, W), got {tuple(self.density.shape)}")
            check_finite(f"medium {self.name!r}: density", self.density)
            if bool((self.density < 0).any()):
                raise InputError(f"medium {self.name!r}: density must not be negative")
            if self.falloff or self.floor is not None:
                raise InputError(
                    f"medium {self.name!r}: falloff and floor go with a number as density, not with a grid"
                )
            return
        check_range(f"medium {self.name!r}: density", self.density, 0.0, 1e30)
        if not math.isfinite(self.ground):
            raise InputError(f"medium {self.name!r}: floor must be finite, got {self.floor}")
        if self.falloff * (self.ground - float(self.low[1])) > LARGEST_RISE:
            raise InputError(
                f"medium {self.name!r}: falloff times the depth of the box below floor must be at most {LARGEST_RISE}, "
                f"got {self.falloff} times {self.ground - float(self.low[1]):g}"
            )

    @property
    def ground(self) -> float:
        """Height y that a density falls off from."""
        return float(self.low[1]) if self.floor is None else float(self.floor)

    @property
    def extinction(self) -> Tensor:
        """(3,) absorption and scattering together, 1/unit."""
        return self.absorption + self.scattering

    @property
    def is_empty(self) -> bool:
        """Nothing in it absorbs, scatters or glows."""
        none = not bool((self.density > 0).any()) if isinstance(self.density, Tensor) else not self.density > 0
        scatters = bool((self.scattering > 0).any()) and (not none or self.density_scales == "absorption")
        return not scatters and (none or not bool((self.absorption > 0).any()))


# ---------------------------------------------------------------- as plain values, for the extras of other formats

EXTRAS = "media"
"""Key of a list of media in the ``extras`` of a glTF scene."""
_VECTORS = ("low", "high", "absorption", "scattering", "emission")
_NUMBERS = ("asymmetry", "falloff", "floor")


def medium_values(medium: Medium) -> dict[str, Any]:
    """The medium as plain values of JSON: keys as the fields; a grid as nested lists, z, y, x."""
    values: dict[str, Any] = {"name": medium.name, "density_scales": medium.density_scales}
    values |= {name: [float(v) for v in getattr(medium, name)] for name in _VECTORS}
    values |= {name: getattr(medium, name) for name in _NUMBERS if getattr(medium, name) is not None}
    grid = isinstance(medium.density, Tensor)
    return values | {"density": medium.density.tolist() if grid else float(medium.density)}  # type: ignore[union-attr]


def medium_from_values(values: Mapping[str, Any]) -> Medium:
    """The medium that :func:`medium_values` wrote, or somebody by hand; missing keys have the fields' defaults.

    Raises:
        InputError: no box, an unknown key, or a value of a wrong kind or out of its range; names it.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"a medium must be an object, got {type(values).__name__}")
    known = {*_VECTORS, *_NUMBERS, "density", "density_scales", "name"}
    for name in values:
        if name not in known:
            raise InputError(f"a medium has no {name!r}; known: {', '.join(sorted(known))}")
    for name in ("low", "high"):
        if name not in values:
            raise InputError(f"a medium needs {name}")
    made: dict[str, Any] = {
        name: as_vector(f"medium: {name}", values[name], dtype=torch.float64) for name in _VECTORS if name in values
    }
    for name in (*_NUMBERS, "density"):
        if name not in values:
            continue
        value = values[name]
        if name == "density" and isinstance(value, list):
            try:
                made[name] = torch.tensor(value, dtype=torch.float32)
            except (TypeError, ValueError) as error:
                raise InputError(f"medium: density must be a number or lists of numbers (D, H, W) ({error})") from error
        elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise InputError(f"medium: {name} must be a finite number, got {value!r}")
        else:
            made[name] = float(value)
    for name in ("density_scales", "name"):
        if name in values:
            if not isinstance(values[name], str):
                raise InputError(f"medium: {name} must be text, got {values[name]!r}")
            made[name] = values[name]
    return Medium(**made)
