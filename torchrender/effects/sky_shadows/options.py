"""How shadows under the sky are made."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError

LEVELS = (1, 2)
RANKINGS = ("area", "magnitude")
INSIDE = ("skip", "block", "half")
"""What a sphere does to a point inside it: nothing; hide everything; hide the half-space towards its centre, as it does
to a point on its surface."""

BLENDS = ("blend", "nearest")
WAVELETS = 6138
"""Wavelets of a cube map of 6 x 32 x 32 texels."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SkyLightOptions:
    """How light from all around is prepared, and how exactly its shadows are summed.

    Raises:
        OptionError: a value outside its range; names it.
    """

    terms: int = 200  # wavelets of the light that are kept, of 6138
    cosine_terms: int | None = None  # wavelets of the cosine that are kept; None: all (it costs nothing per point)
    levels: int = 2  # of visibility: 1: blocks of 4 x 4 texels, 2: texels
    ranking: str = "area"  # which wavelets are kept: largest integral of the square ("area"), or "magnitude"
    normals: int = 8  # cells of a cube face's side between stored normals
    blend: str = "blend"  # light of the four nearest stored normals blended, or that of the "nearest" one
    radii: int = 32  # relative radii in the table of caps
    direct_bits: bool = False  # no table: every cap where it really is, at more time
    inside: str = "skip"  # what a sphere does to points inside: see INSIDE
    smallest: float = 0.0  # relative radius (sine of the angle) of spheres that are left out
    chunk: int = 64  # points that a thread takes at a time

    def __post_init__(self) -> None:
        check_range("terms", self.terms, 1, WAVELETS)
        if self.cosine_terms is not None:
            check_range("cosine_terms", self.cosine_terms, 1, WAVELETS)
        if self.levels not in LEVELS:
            raise OptionError(f"levels must be 1 or 2, got {self.levels}")
        check_choice("ranking", self.ranking, RANKINGS)
        check_range("normals", self.normals, 4, 16)
        check_choice("blend", self.blend, BLENDS)
        check_range("radii", self.radii, 16, 64)
        check_choice("inside", self.inside, INSIDE)
        check_range("smallest", self.smallest, 0.0, 1.0)
        check_range("chunk", self.chunk, 1, 1 << 20)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SphereOptions:
    """How spheres are fitted to a mesh.

    Raises:
        OptionError: a value outside its range; names it.
    """

    spheres: int = 64
    resolution: int = 64  # cells of the solid along its longest side
    starts: int = 3  # every other one spread evenly, the others at random; the best is kept
    teleports: int = 20  # spheres moved to where they serve better, at most
    seed: int = 0

    def __post_init__(self) -> None:
        check_range("spheres", self.spheres, 1, 256)
        check_range("resolution", self.resolution, 8, 256)
        check_range("starts", self.starts, 1, 64)
        check_range("teleports", self.teleports, 0, 1000)
        check_range("seed", self.seed, 0, 2**31 - 1)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SkyShadowOptions:
    """Shadows that objects cast under the environment's light.

    Raises:
        OptionError: a value outside its range; names it.
    """

    occluders: tuple[str, ...] | str = "moving"  # names of meshes, or "moving": all that animations move; "none"
    spacing: int = 2  # pixels between shaded points, per side; those between follow along surfaces; 1: every pixel
    sphere: SphereOptions = SphereOptions(starts=4, teleports=0)
    light: SkyLightOptions = SkyLightOptions()

    def __post_init__(self) -> None:
        if isinstance(self.occluders, str):
            check_choice("occluders", self.occluders, ("moving", "none"))
        elif not all(isinstance(name, str) for name in self.occluders):
            raise OptionError(f"occluders must be names of meshes, got {self.occluders!r}")
        check_range("spacing", self.spacing, 1, 16)
