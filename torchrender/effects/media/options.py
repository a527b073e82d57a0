"""How scattering is computed."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields

WAYS = ("slices", "walk", "march")
SHADOWS = ("maps", "rays", "none")
SCHEMES = ("exact_segment", "source")
GRADIENTS = ("lsq", "nearest", "none")
NORMALS = ("length", "effective")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ScatterOptions:
    """How scattered light is integrated, and which pixels are.

    ``way``: "slices" (where a ray is lit: epipolar slices of the light's depth images), "walk" (a walk through these
    images, exact for their texels), or "march" (steps along every ray with a look-up each, as the source has it).
    With blocks larger than 1 only some pixels are integrated, and the others lie between them; not by slices in a
    single homogeneous medium, where all pixels take no longer.

    Raises:
        OptionError: a value outside its range; names it.
    """

    way: str = "slices"
    shadows: str = "maps"  # of objects in the medium: depth images, "rays" (only way="march"), or "none"
    block: int = 2  # pixels of a block's side, of which one is integrated: 1 to 3
    panels: int = 8  # along a ray, in heights and several media; twice as many in grids
    lattice: int = 8  # with blocks: pixels between rays along which heights and grids are integrated; 0: along all
    slices: tuple[int, int] = (2048, 1024)  # epipolar slices, at most, and entries of each
    sun_texels: int = 4096  # of a side of the image that a sun has of a scene with media; at least that of shadows
    share_tolerance: float = 0.02  # lit shares of neighbours may differ by so much, or they are not mixed
    eps_rel: float = 0.1  # ways through the medium may differ by this share
    halo_guard_px: int = 20  # all pixels as near to a lamp are integrated
    gradient: str = "lsq"  # of integrated pixels: least squares, "nearest" (as printed), or "none"
    normal: str = "length"  # what is interpolated: light per length of the way, or per "effective" length
    falloff: str = "inverse_square"  # of lamps; "none" as the source prints it
    nearest: float = 1e-3  # of the way from eye to lamp, of a diagonal at most: lamps get no brighter below it
    light_steps: int = 16  # through grids, towards a light
    light_cells: int = 32  # of a grid's side, from which the way to a light is known
    environment: bool = True  # ambient light and environment are scattered, too; nothing shadows them in the air
    air: bool = True  # media are seen before what the eye sees; False: they only dim light on other ways
    surfaces: bool = True  # media dim the light of lamps and from everywhere on its way to surfaces
    steps: int = 64  # of way="march"
    scheme: str = "exact_segment"  # of way="march": or "source", which is too bright by what steps scatter away
    equiangular: bool = True  # of way="march": steps of equal angle at lamps; else of equal length
    jitter: bool = True  # of way="march": each ray's steps are shifted by a random part of one
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("way", self.way, WAYS)
        check_choice("shadows", self.shadows, SHADOWS)
        check_choice("scheme", self.scheme, SCHEMES)
        check_choice("gradient", self.gradient, GRADIENTS)
        check_choice("normal", self.normal, NORMALS)
        check_choice("falloff", self.falloff, ("inverse_square", "none"))
        if self.shadows == "rays":
            check_choice('way (with shadows="rays")', self.way, ("march",))
        limits = {"block": (1, 3), "panels": (2, 64), "share_tolerance": (0.0, 1.0), "eps_rel": (0.02, 0.3)}
        limits |= {
            "halo_guard_px": (0, 64),
            "lattice": (0, 32),
            "nearest": (1e-9, 1.0),
            "sun_texels": (64, 8192),
            "light_steps": (4, 128),
            "light_cells": (4, 256),
        }
        limits |= {"steps": (8, 1 << 14), "seed": (0, 2**31 - 1)}
        for name, (low, high) in limits.items():
            check_range(name, getattr(self, name), low, high)
        for side in self.slices:
            check_choice("slices", str(side), [str(2**k) for k in range(5, 14)])
