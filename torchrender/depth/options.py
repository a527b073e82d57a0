"""How depth images are sampled."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.fragment_tests import PIXEL_TESTS

METHODS = ("nonredundant", "conventional", "depth_peeling")
REDUNDANCY = ("pixel", "visibility")
VISIBILITY_TESTS = ("captured", "plain")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SamplingOptions:
    """Options of :func:`torchrender.depth.sample.sample_depth_images` (specification 01, section 5).

    Raises:
        OptionError: a value outside its range or choices; names it.
    """

    method: str = "nonredundant"  # nonredundant, conventional or depth_peeling
    redundancy: str = (
        "pixel"  # pixel: does an earlier image store the triangle there; visibility: did its camera see it
    )
    visibility_test: str = "captured"  # captured: earlier images look behind what they know; plain: first hits only
    pixel_test: str = "identity"  # identity: the pixel holds the triangle; depth_identity: or its depth, or one within
    # 2x2 does; captured: the pixel holds nothing nearer, which finds the repeats of sub-pixel surfaces as rays do
    quality_ratio: float | None = None  # keep a sample whose earlier copy has a footprint this many times larger
    cull_backfaces: bool = True
    size: tuple[int, int] | None = None  # (width, height) of the images; None: those of the cameras
    layers: int | None = None  # images of depth peeling; None: as many as cameras
    relative_tolerance: float = 1e-5  # step past a hit: this share of its depth, and ...
    scene_tolerance: float = 1e-6  # ... this share of the bounding box's diagonal
    visibility_tolerance: float = 1e-4  # relative difference of ray parameters below which two hits are one point
    max_skips: int = 64  # surfaces looked at per pixel before it is given up as truncated
    count_layers: bool = True  # pixel redundancy; False: quicker, layers stay zero, nothing counts as truncated, and a
    # copy in the plane of a known surface counts as new
    shade: bool = False  # store the surface's diffuse colour: albedo, no light

    def __post_init__(self) -> None:
        check_choice("method", self.method, METHODS)
        check_choice("redundancy", self.redundancy, REDUNDANCY)
        check_choice("visibility_test", self.visibility_test, VISIBILITY_TESTS)
        check_choice("pixel_test", self.pixel_test, PIXEL_TESTS)
        if self.quality_ratio is not None:
            check_range("quality_ratio", self.quality_ratio, 1.0)
        if self.size is not None:
            object.__setattr__(self, "size", (self.size[0], self.size[1]))
            check_range("size[0]", self.size[0], 1, 32768)
            check_range("size[1]", self.size[1], 1, 32768)
        if self.layers is not None:
            check_range("layers", self.layers, 1, 512)
        check_range("relative_tolerance", self.relative_tolerance, 1e-7, 1e-3)
        check_range("scene_tolerance", self.scene_tolerance, 0.0, 1e-3)
        check_range("visibility_tolerance", self.visibility_tolerance, 1e-6, 1e-2)
        check_range("max_skips", self.max_skips, 1, 512)

    @property
    def cull(self) -> str:
        """The rasteriser's name for the back-face rule."""
        return "back" if self.cull_backfaces else "none"

    def parameters(self) -> dict[str, Any]:
        """Plain values from which the options can be made again."""
        return asdict(self)
