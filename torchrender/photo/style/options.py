"""What a caller may choose about a style transfer."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError

MAX_VIEWS = 15
CUTS = ("object", "mesh", "material")
NEUTRAL = (0.1, 0.1, 0.1, 0.5, 0.5, 0.5, 0.0, 20.0)
"""Ambient (3), diffuse (3), specular, exponent of an object that no view shows."""


def check_options(options: object) -> None:
    """Refuse what is no :class:`StyleOptions`.

    Raises:
        OptionError: says what it is.
    """
    if not isinstance(options, StyleOptions):
        raise OptionError(f"options must be StyleOptions, got {type(options).__name__}")


class StyleWarning(UserWarning):
    """Something asked for could not be done for a part of the scene; names it."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class FitOptions:
    """How a material is fitted to the pixels of a photo.

    Raises:
        OptionError: a value outside its range.
    """

    seeds: int = 4  # clusters of one object's pixels; the largest is kept; 1: no clustering
    alpha0: float = 20.0  # Phong exponent that the expansion starts from
    refine: int = 8  # times that the expansion moves to the exponent found; 0: one solve, as published
    ridge: float = 1e-4  # weight of the prior, per pixel
    specular: bool = True  # False: ambient and diffuse alone
    spec_color: bool = False  # True: highlights have a colour, the channels are fitted apart
    glossy_walls: bool = False  # False: walls and ceilings are matt; light varies over them in a photo, not gloss
    max_pixels: int = 5000  # of one object in one view; more are thinned evenly

    def __post_init__(self) -> None:
        check_range("seeds", self.seeds, 1, 8)
        check_range("alpha0", self.alpha0, 5.0, 100.0)
        check_range("refine", self.refine, 0, 8)
        check_range("ridge", self.ridge, 0.0, 1e-2)
        check_range("max_pixels", self.max_pixels, 100, 10**7)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SearchOptions:
    """How one candidate per object is chosen.

    Raises:
        OptionError: a value outside its range.
    """

    tabu: str = "solution"  # what the list holds: "solution" (choices made), or "move" (object and what it left)
    tabu_length: int = 10
    stagnation: int = 50  # iterations without a better solution before the search ends
    stop_at: float = 0.0  # cost at which it ends at once
    smooth: str = "laplacian"  # "laplacian": the sum of differences to neighbours; "tv": sum of their lengths
    smooth_weight: float | None = None  # None: 0.05 views / objects
    prior_weight: float = 1.0  # ceiling and walls light, floor middle, furniture darker; 0: any lightness
    fit_weight: float = 1.0  # of candidates' misfit to the photo, times views / objects; 0: as published
    bins: int = 32  # of the (a,b) histogram, per side
    units: str = "normalized"  # "raw": means and deviations in Lab units, as printed
    cluster: int | None = None  # candidates an object keeps at most, medoids of clusters; None: all

    def __post_init__(self) -> None:
        check_choice("tabu", self.tabu, ("solution", "move"))
        check_choice("smooth", self.smooth, ("laplacian", "tv"))
        check_choice("units", self.units, ("normalized", "raw"))
        check_range("tabu_length", self.tabu_length, 1, 50)
        check_range("stagnation", self.stagnation, 10, 500)
        check_range("stop_at", self.stop_at, 0.0)
        check_range("prior_weight", self.prior_weight, 0.0, 100.0)
        check_range("fit_weight", self.fit_weight, 0.0, 100.0)
        check_range("bins", self.bins, 8, 64)
        if self.smooth_weight is not None:
            check_range("smooth_weight", self.smooth_weight, 0.0, 1.0)
        if self.cluster is not None:
            check_range("cluster", self.cluster, 1, MAX_VIEWS)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class StyleOptions:
    """How a scene takes the style of a photo.

    Raises:
        OptionError: a value outside its range.
    """

    views: int = 10  # generated ones, before those that objects seen nowhere ask for; at most 15 in all
    width: int = 400  # of each view, pixels
    height: int = 300
    visible_share: float = 0.003  # of a view's pixels that an object must cover to be fitted there
    place: str = "stretch"  # how the photo is laid over a view: "stretch", or "crop" to its shape
    cut: str = "object"  # what gets one material: "object", "mesh", or all that shares a "material" now
    keep_textures: bool = False  # True: textures and vertex colours keep their pattern and take the new mean colour
    seed: int = 0  # of surface samples and starting clusters
    fit: FitOptions = FitOptions()
    search: SearchOptions = SearchOptions()

    def __post_init__(self) -> None:
        check_range("views", self.views, 8, MAX_VIEWS)
        check_range("width", self.width, 16, 4096)
        check_range("height", self.height, 16, 4096)
        check_range("visible_share", self.visible_share, 0.0005, 0.05)
        check_choice("place", self.place, ("stretch", "crop"))
        check_choice("cut", self.cut, CUTS)
        check_range("seed", self.seed, 0, 2**31 - 1)
