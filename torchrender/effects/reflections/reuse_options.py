"""Options of reusing reflections between pictures. Specification 04, section 9."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields

SEARCHES = ("leap", "walk")
SECOND_WARPS = ("reverse", "forward")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ReuseOptions:
    """When an old reflection is good enough.

    Raises:
        OptionError: a value outside its range; names it.
    """

    key_frame_threshold: float = 0.3  # share of pixels traced anew above which the next picture is a key frame
    max_steps: int = 128  # pixels that a match may walk
    search: str = "leap"  # Gauss-Newton steps, and the walk where they fail; or the "walk" over neighbours alone
    ratio: float = 0.75  # of a match's distance to its neighbours' mean; 1: any end of a walk is a match
    refine: bool = True  # matches between pixel centres, by a Gauss-Newton step
    area_ratio: float = 16.0  # growth of a triangle that still counts as seen
    jump: float = 0.25  # relative difference in reflected distance across which nothing is interpolated
    edge: float = 0.01  # relative difference in path length that is an edge of what is mirrored if it stands alone
    contrast: float = 0.06  # difference in the picture between neighbouring key pixels above which is traced
    second_warp: str = "reverse"  # from the key frame to the view: look up, or draw ("forward")
    correction: float = (
        2.0  # key pixels by which a value is moved onto the pixel's own ray; farther off: traced; 0: off
    )

    def __post_init__(self) -> None:
        check_range("key_frame_threshold", self.key_frame_threshold, 0.0, 1.0)
        check_range("max_steps", self.max_steps, 8, 1024)
        check_choice("search", self.search, SEARCHES)
        check_range("ratio", self.ratio, 0.5, 1.0)
        check_range("area_ratio", self.area_ratio, 1.0, 100.0)
        check_range("jump", self.jump, 0.05)
        check_range("edge", self.edge, 0.0)
        check_range("contrast", self.contrast, 0.0)
        check_choice("second_warp", self.second_warp, SECOND_WARPS)
        check_range("correction", self.correction, 0.0, 16.0)
