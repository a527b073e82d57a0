"""How shadow maps are drawn and looked up. Lengths are texels: none grows with the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields, is_whole
from torchrender.errors import OptionError
from torchrender.kernels.shadows.shadow_lookup import AVERAGE_DEPTH, DISC, NEAREST_TEXEL, PCSS, WINDOW
from torchrender.kernels.shadows.shadow_receiver import CONSTANT, RECEIVER_PLANE, SLOPE

BIASES = {"constant": CONSTANT, "slope": SLOPE, "receiver_plane": RECEIVER_PLANE}
FILTERS = {
    "none": NEAREST_TEXEL,
    "bilinear": WINDOW,
    "pcf": WINDOW,
    "poisson": DISC,
    "pcss": PCSS,
    "average_depth": AVERAGE_DEPTH,
}
COVERAGES = ("view", "scene")
EDGES = ("map", "exact")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ShadowOptions:
    """How shadow maps are drawn and looked up.

    A texel's length is its width where the receiver lies. ``coverage`` "view" fits the maps to what the picture sees,
    as finely as they allow: cascades of a directional or spot light one behind the other, and only those faces of a
    cube in which something is seen. "scene" draws everything once: coarser, but it lasts while the camera moves.

    ``filter``: "none", "bilinear", "pcf" ((2n+1)^2 bilinear taps, n = ``filter_radius``), "poisson" (a disc of
    n + 1/2 texels, turned per pixel), "pcss" (penumbrae from the size of the light), or "average_depth": the mistake of
    averaging depths before comparing, kept for comparison only. ``bias``: "slope", "receiver_plane", "constant"; None
    takes "slope" for filters that reach at most 1.5 texels; wider ones would need a slope bias that lifts contact
    shadows, and take the receiver plane (with ``soft``: always "slope").

    Raises:
        OptionError: a value outside its range, or a combination that does not exist; names the option.
    """

    size: int | tuple[int, int] = 1024  # texels of a side, or (height, width)
    bias: str | None = None
    constant_bias: float = 0.05  # texels; constant part of the bias, b0
    slope_bias: float = 1.0  # factor k of the slope; 1 is a rigorous bound for planes
    largest_bias: float = 4.0  # texels; largest bias, b_max: where slopes ask for more, the receiver plane takes over
    normal_offset: float = 0.0  # texels that points move along their normal at grazing light
    filter: str = "bilinear"
    filter_radius: int = 1  # radius n of "pcf" and "poisson" in texels
    edges: str = "exact"  # where a map cannot tell: "exact", by the triangles themselves, or as the "map" says
    search_taps: int = 16  # "pcss": blocker search
    taps: int = 32  # "poisson", "pcss"
    light_width: float | None = None  # "pcss", scene units; None: the rectangle's side, else 0.1 scene radius
    light_angle_deg: float = 0.53  # "pcss": angular diameter of a directional light; the sun's
    largest_radius: float = 32.0  # "pcss": largest radius rho_max of a penumbra in texels
    outside: str = "lit"  # what lies outside the map: "lit" or "shadow"
    cull: str = "none"  # faces left out of the map: "none", "back", "front" (less acne on closed, thick bodies)
    soft: float | None = None  # texels; width tau of a comparison with gradients, sigmoid(b / tau) on lit surfaces
    coverage: str = "view"  # what maps show: what the "view" sees, or the whole "scene"
    cascades: int | None = None  # maps along the view; None: as many as make texels about as small as pixels, at most 4

    def __post_init__(self) -> None:
        for side in self.shape:
            if not is_whole(side) or not 64 <= side <= 8192:
                raise OptionError(f"size must be integers in [64, 8192], got {self.size!r}")
        if self.bias is not None:
            check_choice("bias", self.bias, tuple(BIASES))
        check_choice("filter", self.filter, tuple(FILTERS))
        check_choice("outside", self.outside, ("lit", "shadow"))
        check_choice("cull", self.cull, ("none", "back", "front"))
        check_choice("edges", self.edges, EDGES)
        check_choice("coverage", self.coverage, COVERAGES)
        limits = {"constant_bias": (0.0, 64.0), "slope_bias": (0.0, 4.0), "largest_bias": (0.0, 1024.0)}
        limits |= {"normal_offset": (0.0, 3.0), "filter_radius": (0, 7), "largest_radius": (1.0, 128.0)}
        limits |= {"search_taps": (4, 128), "taps": (4, 128)}
        for name, (low, high) in limits.items():
            check_range(name, getattr(self, name), low, high)
        check_range("light_angle_deg", self.light_angle_deg, 1e-3, 90.0)
        if self.light_width is not None:
            check_range("light_width", self.light_width, 1e-12)
        if self.cascades is not None:
            check_range("cascades", self.cascades, 1, 8)
        if self.soft is not None:
            check_range("soft", self.soft, 1e-6, 1024.0)
            if self.filter not in ("none", "bilinear", "pcf") or self.bias_mode == "receiver_plane":
                raise OptionError("soft needs filter none, bilinear or pcf and bias slope or constant")
            check_range("normal_offset (with soft)", self.normal_offset, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the map in texels."""
        height, width = self.size if isinstance(self.size, tuple) else (self.size, self.size)
        return height, width

    @property
    def bias_mode(self) -> str:
        """The bias that ``bias`` stands for."""
        return self.bias or ("slope" if self.soft is not None or self.reach <= 1.5 else "receiver_plane")

    @property
    def window(self) -> int:
        """Radius in texels of the window of bilinear taps."""
        return self.filter_radius if self.filter == "pcf" else 0

    @property
    def reach(self) -> float:
        """Texels beyond its own that a lookup may touch."""
        widest = {"none": 0.0, "poisson": self.filter_radius + 0.5, "pcss": self.largest_radius}
        return widest.get(self.filter, self.window + 0.5)

    @property
    def border(self) -> float:
        """Texels that are kept free at each side of a map, so that a look-up at its edge stays inside."""
        return min(math.ceil(self.reach + self.normal_offset) + 1.0, min(self.shape) / 8)
