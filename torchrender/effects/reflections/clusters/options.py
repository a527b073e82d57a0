"""Options of reflections from clustered depth images. Specification 03, section 8."""

from __future__ import annotations

from dataclasses import dataclass

from torchrender.checks import check_choice, check_range, checked_fields
from torchrender.effects.reflections.clusters.cameras import AIMS, CENTRES, CameraOptions
from torchrender.effects.reflections.reflectors import LOBES
from torchrender.errors import OptionError

SCALE_RULES = ("sqrt_share", "literal", "mean")
SEARCHES = ("intersect", "secant")


@dataclass(frozen=True, kw_only=True)
@checked_fields
class ClusterOptions:
    """How pixels are grouped, and how their depth images are drawn and asked.

    Raises:
        OptionError: a value outside its range; names it.
    """

    bins: tuple[int, int] = (13, 8)  # of azimuth and polar angle, for a reflector that fills the view by itself
    scale_rule: str = "sqrt_share"  # how a reflector's share of the view scales its bins
    bin_factor: float = 1.0  # factor m on the number of bins: fewer clusters are faster and miss more
    plane_share: float = 5e-4  # planes with this share of a picture are clusters of their own; inf: bins alone
    camera_share: float = 2e-4  # curved clusters with a smaller share of a picture join another one; 0: bins alone
    centre: str = "best"  # of projection: "thesis", "least_squares", or for each cluster the better one
    aim: str = "rays"  # view axis of curved clusters: mean direction of the "rays", or "normal" of the fitting plane
    deviation_deg: float = 5.0  # curved clusters whose rays lie farther off their camera's, on average, are parted
    most_clusters: int = 512  # from which on none is parted for that
    layers: int = 4  # surfaces that depth images of curved clusters hold one behind the other
    search: str = "intersect"  # rays with the triangles that images name; "secant": depths and colours of one layer
    image_scale: float = 2.0  # sides of the depth images of curved clusters; less loses what is finer than texels
    depth_tolerance: float = 1e-4  # share epsilon of the depth that a ray must be behind the image
    glossy_rays: int = 8  # per glossy pixel; mirrors take one
    fade: bool = False  # glossy reflections give way to the pixel's own colour with distance, as published
    min_cluster_pixels: int = 1  # smaller clusters take what ``missing`` says
    missing: str = "environment"  # rays that no depth image answers: "environment", or "trace"
    trace_below: float = 0.1  # with "trace": curved clusters with fewer rays than this share of the scene's triangles
    # get no depth image; drawing one costs more than tracing them
    lobe: str = "ggx"  # of glossy pixels: of facets, or an even "cone" as published
    share_rays: bool = True  # neighbouring glossy pixels see what each other's rays see
    self_reflection: str = (
        "mirror"  # concave reflectors that see themselves: "mirror" as others, or own "diffuse" colour
    )
    cull: str = "back"  # faces left out of depth images with search "secant": "none" lets convex reflectors hide things

    @property
    def cameras(self) -> CameraOptions:
        """How the cameras of the clusters are placed."""
        return CameraOptions(
            centre=self.centre,
            scale=self.image_scale,
            shorten=self.fade,
            aim=self.aim,
            deviation_deg=self.deviation_deg,
            most=self.most_clusters,
            lobe=self.lobe,
        )

    def __post_init__(self) -> None:
        for number, sides in enumerate(self.bins):
            check_range(f"bins[{number}]", sides, 1, 64)
        if len(self.bins) != 2:
            raise OptionError(f"bins must be two numbers, got {self.bins}")
        check_choice("lobe", self.lobe, LOBES)
        check_choice("scale_rule", self.scale_rule, SCALE_RULES)
        check_choice("centre", self.centre, CENTRES)
        check_choice("aim", self.aim, AIMS)
        check_choice("missing", self.missing, ("environment", "trace"))
        check_choice("search", self.search, SEARCHES)
        check_choice("cull", self.cull, ("none", "back"))
        check_choice("self_reflection", self.self_reflection, ("mirror", "diffuse"))
        check_range("plane_share", self.plane_share, 0.0)
        check_range("camera_share", self.camera_share, 0.0, 1.0)
        check_range("bin_factor", self.bin_factor, 0.01, 16.0)
        check_range("deviation_deg", self.deviation_deg, 0.1, 180.0)
        check_range("most_clusters", self.most_clusters, 1, 1 << 20)
        check_range("layers", self.layers, 1, 16)
        check_range("image_scale", self.image_scale, 0.1, 4.0)
        check_range("depth_tolerance", self.depth_tolerance, 0.0, 1e-2)
        check_range("glossy_rays", self.glossy_rays, 1, 1024)
        check_range("trace_below", self.trace_below, 0.0)
        check_range("min_cluster_pixels", self.min_cluster_pixels, 1, 1 << 20)
