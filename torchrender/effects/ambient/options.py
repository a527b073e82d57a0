"""How ambient visibility is found."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_range, checked_fields

REACH_SHARE = 0.1
"""Reach of near occluders where none is given, in diagonals of the scene's bounding box."""


@dataclass(frozen=True, kw_only=True)
@checked_fields
class AmbientOptions:
    """How thoroughly, and what counts as near.

    Raises:
        OptionError: a value outside its range; names it.
    """

    slices: int = 2  # planes through the eye in which each point searches
    steps: int = 16  # depths that are looked at to either side in each plane
    spacing: int = 3  # one point for so many pixels and side; those between follow along surfaces
    around: int = 64  # pixels of a side of the six views around the eye, for what the picture does not show; 0: none
    backs: bool = False  # draw where things end behind what is seen, too
    rays: int = 8  # of each point, where rays are cast; at least 16 where each pixel is one for want of an eye
    ray_spacing: int = 4  # as ``spacing``, where rays are cast; parallel and tiny views take every pixel
    share: bool = False  # pixels whose rays are cast take part in what those around them found
    reach: float | None = None  # scene units within which things hide near light; None: a tenth of the scene's diagonal

    def __post_init__(self) -> None:
        check_range("slices", self.slices, 1, 64)
        check_range("steps", self.steps, 2, 256)
        check_range("spacing", self.spacing, 1, 16)
        check_range("ray_spacing", self.ray_spacing, 1, 16)
        check_range("around", self.around, 0, 2048)
        check_range("rays", self.rays, 1, 1 << 16)
        if self.reach is not None:
            check_range("reach", self.reach, 0.0, 1e30)
