"""Participating media, as data: a box with absorption, scattering and a density."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchrender.checks import as_vector, check_range
from torchrender.errors import InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class Medium:
    """A medium inside an axis-aligned box; coefficients are per scene unit at density 1.

    Raises:
        InputError: box corners out of order, negative coefficients, or a grid that is not (D,H,W).
        OptionError: ``asymmetry`` outside [-0.99, 0.99].
    """

    low: Tensor  # (3,) smallest corner
    high: Tensor  # (3,) largest corner
    absorption: Tensor = field(default_factory=lambda: torch.zeros(3))  # (3,) 1/unit
    scattering: Tensor = field(default_factory=lambda: torch.full((3,), 0.1))  # (3,) 1/unit
    emission: Tensor = field(default_factory=lambda: torch.zeros(3))  # (3,) radiance
    asymmetry: float = 0.0  # Henyey-Greenstein g
    density: Tensor | float = 1.0  # a number, or a grid (D,H,W) over the box: z, y, x
    name: str = "medium"

    def __post_init__(self) -> None:
        for name in ("low", "high", "absorption", "scattering", "emission"):
            object.__setattr__(self, name, as_vector(f"medium {self.name!r}: {name}", getattr(self, name)))
        if not bool((self.high > self.low).all()):
            raise InputError(f"medium {self.name!r}: high must exceed low, got {self.low} and {self.high}")
        for name in ("absorption", "scattering", "emission"):
            if bool((getattr(self, name) < 0).any()):
                raise InputError(f"medium {self.name!r}: {name} must not be negative")
        check_range(f"medium {self.name!r}: asymmetry", self.asymmetry, -0.99, 0.99)
        if isinstance(self.density, Tensor) and self.density.dim() != 3:
            raise InputError(f"medium {self.name!r}: density must be (D, H, W), got {tuple(self.density.shape)}")
