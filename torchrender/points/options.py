"""Options of point splatting, and what it gives back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError
from torchrender.images.files import numbered, png_bytes, side_by_side, write_image
from torchrender.points.select import SelectionOptions

FILTERS = ("adaptive", "full", "reconstruction", "low_pass", "squares")
CHOICES = ("patch", "point")
TESTS = ("area", "eigen")
SHADING = ("point", "pixel", "none")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SplatOptions:
    """How points are drawn.

    ``filter``: "adaptive" takes for each patch (``choice`` "patch") or point the cheapest of the three EWA filters that
    is good enough; "full", "reconstruction" and "low_pass" always take one; "squares" draws opaque squares, the nearest
    wins. ``test`` "area" compares projected areas as published; "eigen" both axes of the ellipse, which is right for
    grazing points, too. ``shading``: light each point before blending, each pixel from its blended normal, or not.
    """

    filter: str = "adaptive"
    choice: str = "patch"
    test: str = "area"
    shading: str = "point"
    selection: SelectionOptions = field(default_factory=SelectionOptions)
    low_pass_below: float = 0.3  # c_min, 0 to 1: below this ratio of areas the low-pass alone is used; 0: never
    reconstruction_above: float = 3.0  # c_max, at least 1: above it the reconstruction alone; inf: never
    low_pass_radius: float = 1.0  # r_h: cut-off radius of the low-pass, pixels, 0.5 to 2
    gaussian_width: float = 0.5  # kappa: standard deviation over cut-off radius, 0.35 to 1
    depth_tolerance: float = 2.0  # over radius and pixel, 0.5 to 6
    two_sided: bool | None = None  # None: as the points say
    light: tuple[float, float, float] | None = None  # direction to the light, world space; None: from the eye
    ambient: float = 0.25  # share of the light that comes from everywhere, 0 to 1
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear colour where nothing is

    def __post_init__(self) -> None:
        for name, choices in (("filter", FILTERS), ("choice", CHOICES), ("test", TESTS), ("shading", SHADING)):
            check_choice(name, getattr(self, name), choices)
        check_range("low_pass_below", self.low_pass_below, 0.0, 1.0)
        check_range("reconstruction_above", self.reconstruction_above, 1.0, math.inf)
        check_range("low_pass_radius", self.low_pass_radius, 0.5, 2.0)
        check_range("gaussian_width", self.gaussian_width, 0.35, 1.0)
        check_range("depth_tolerance", self.depth_tolerance, 0.5, 6.0)
        check_range("ambient", self.ambient, 0.0, 1.0)
        for name in ("light", "background"):
            value = getattr(self, name)
            if value is not None and (len(value) != 3 or not all(math.isfinite(v) for v in value)):
                raise OptionError(f"{name} must be three finite numbers, got {value}")
        if self.light is not None and not any(self.light):
            raise OptionError("light must not be zero")


@dataclass(frozen=True)
class SplatStatistics:
    """What one camera drew."""

    patches: int
    patches_outside: int
    patches_back: int
    points: int  # of the model
    nodes: int  # points and inner nodes that were considered, at the levels chosen
    drawn: int  # of these, drawn
    full: int  # drawn with both filters
    reconstruction: int
    low_pass: int
    squares: int
    behind: int  # left out: not between the near and the far plane
    back: int  # left out: seen from behind
    degenerate: int  # left out: no area on screen
    large: int  # drawn, but wider than a fifth of their depth: the affine projection is off
    capped: int  # reaching far beyond the image
    evaluations: int  # kernel weights computed
    bytes_read: int  # bytes of nodes, colour left out
    ms: Mapping[str, float]  # wall time of each pass


@dataclass(frozen=True, eq=False)
class PointImage:
    """Pictures of points from B cameras."""

    image: Tensor  # (B,H,W,3) linear
    depth: Tensor  # (B,H,W) camera z, weighted mean of what was blended; +inf where nothing is
    weight: Tensor  # (B,H,W) sum of weights
    statistics: tuple[SplatStatistics, ...]  # one per camera

    __repr__ = brief

    def __len__(self) -> int:
        return int(self.image.shape[0])

    def _repr_png_(self) -> bytes:
        """In notebooks."""
        return png_bytes(side_by_side(self.image))

    def save(self, path: str | Path) -> list[Path]:
        """Write the pictures and return the files written, for several views numbered ``name_000``, ``name_001`` …

        ``.png``: 8-bit sRGB. ``.exr``: linear colour and depth as R, G, B, Z.

        Raises:
            ImageFileError: another suffix, a missing folder, or a file that cannot be written.
        """
        path = Path(path)
        deep = path.suffix.lower() == ".exr"
        pictures = torch.cat([self.image, self.depth[..., None]], dim=-1) if deep else self.image
        files = [numbered(path, number, len(self)) for number in range(len(self))]
        for file, picture in zip(files, pictures, strict=True):
            write_image(file, picture, channels=("R", "G", "B", "Z") if deep else None)
        return files

    @property
    def mask(self) -> Tensor:
        """(B,H,W) bool: something is there."""
        return self.weight > 0
