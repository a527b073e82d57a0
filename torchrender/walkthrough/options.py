"""Options of building and drawing walkthroughs."""

from __future__ import annotations

import math
from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.errors import OptionError

FILLS = ("exemplar", "inpaint", "off")
REPAIRS = ("auto", "off")
EDGES = ("safe", "source")
SPLATS = ("squares", "ewa")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class WalkthroughOptions:
    """How photos become planes and points. Names and ranges: specification 13, section 9.

    Raises:
        OptionError: a value outside its range; names it.
    """

    tau_step: float = 0.03  # depth step between neighbours that is an edge, share of depth
    tau_crease: float = 0.08  # jump of the surface's slope that is an edge
    n_min: int = 400  # pixels of a plane in one photo
    tau_max: float | None = None  # distance of pixels to their plane, share of the diagonal; None: from the noise
    tau_avg: float | None = None  # its mean
    merge_angle_deg: float = 3.0
    tau_z: float = 0.01  # share of depth within which two photos see one surface
    eta: float = 0.02  # step of log density
    rho_scale: float = 1.0  # texels per unit over those that keep the number of pixels
    blend_power: float = 2.0  # of the density, as weight of a photo in a texel or point
    fill: str = "exemplar"
    fill_window: int = 9
    min_votes: int | None = None  # photos that make a hole by seeing through; None: 1, with noisy depth 2
    epsilon: float = 4.0  # distance within which points form one object, in footprints
    exact_objects: bool = True  # False: the source's grid
    edge: str = "safe"  # of the grid's cubes; "source": sqrt(2)/4 epsilon
    leaf_size: int = 256
    exposure: str = "auto"  # one gain for each photo
    registration: str = "auto"  # poses, and a shift between colour and depth
    view_detail: int = 4  # each photo's difference is kept at this fraction of its size; 0: not at all
    size_share: float | None = None  # of the photos' raw size, kept to; None: 0.25 as far as it hardly shows
    compare: bool = True  # False: every photo's samples are kept
    upright: bool = True  # turn the scene so that the cameras' mean up is +y
    max_frames: int = 200  # photos to build from, chosen over the whole sequence, sharp ones first
    max_partners: int = 24  # photos that a photo is compared with, most overlap first
    memory_mb: int = 1024  # beyond it pictures are kept in a temporary file
    max_points: int = 4_000_000
    seed: int = 0

    def __post_init__(self) -> None:
        check_range("tau_step", self.tau_step, 0.005, 0.2)
        check_range("tau_crease", self.tau_crease, 0.01, 0.5)
        check_range("n_min", self.n_min, 50, 5000)
        if self.tau_max is not None:
            check_range("tau_max", self.tau_max, 0.0005, 0.02)
        if self.tau_avg is not None:
            check_range("tau_avg", self.tau_avg, 0.0001, 0.005)
        check_range("merge_angle_deg", self.merge_angle_deg, 0.5, 10.0)
        check_range("tau_z", self.tau_z, 0.002, 0.05)
        check_range("eta", self.eta, 0.0, 0.2)
        check_range("rho_scale", self.rho_scale, 0.25, 2.0)
        check_range("blend_power", self.blend_power, 0.0, 16.0)
        check_choice("fill", self.fill, FILLS)
        check_range("fill_window", self.fill_window, 5, 21)
        if self.fill_window % 2 == 0:
            raise OptionError(f"fill_window must be odd, got {self.fill_window}")
        if self.min_votes is not None:
            check_range("min_votes", self.min_votes, 1, 64)
        check_range("epsilon", self.epsilon, 1.0, 20.0)
        check_choice("edge", self.edge, EDGES)
        check_range("leaf_size", self.leaf_size, 16, 65536)
        check_choice("exposure", self.exposure, REPAIRS)
        check_choice("registration", self.registration, REPAIRS)
        check_range("view_detail", self.view_detail, 0, 64)
        if self.size_share is not None:
            check_range("size_share", self.size_share, 0.01, 100.0)
        check_range("max_frames", self.max_frames, 1, 100_000)
        check_range("max_partners", self.max_partners, 1, 1000)
        check_range("memory_mb", self.memory_mb, 16, 2**24)
        check_range("max_points", self.max_points, 1000, 10**9)
        check_range("seed", self.seed, 0, 2**63)


@dataclass(frozen=True, kw_only=True)
@checked_fields
class DrawOptions:
    """How a walkthrough is drawn.

    Raises:
        OptionError: a value outside its range; names it.
    """

    cull: bool = True  # leave out points outside the view or behind planes
    occluders: int = 8  # planes that hide points, 0 to 32
    splats: str = "squares"  # or the EWA splats of :mod:`torchrender.points`
    splat_cap: float = 5.0  # greatest side of a point, pixels
    splat_grow: float = 1.0  # factor of the side
    view_colors: bool = True  # add what the photos near the camera saw differently
    gap_pixels: int = 0  # fill gaps up to about this many pixels from their borders; 0: they stay empty
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear colour where nothing is

    def __post_init__(self) -> None:
        check_range("occluders", self.occluders, 0, 32)
        check_choice("splats", self.splats, SPLATS)
        check_range("splat_cap", self.splat_cap, 1.0, 32.0)
        check_range("splat_grow", self.splat_grow, 0.5, 4.0)
        check_range("gap_pixels", self.gap_pixels, 0, 64)
        if len(self.background) != 3 or not all(math.isfinite(v) for v in self.background):
            raise OptionError(f"background must be three finite numbers, got {self.background}")
