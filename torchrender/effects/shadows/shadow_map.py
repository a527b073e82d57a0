"""Shadow maps: depth as a light sees it decides which visible points the light reaches.

Pass 1 draws the scene from the light; pass 2 looks every visible point up in that picture. A map depends on light and
scene only: hand it back in while both stand still. Biases are metric, because depth is linear.
Sources: Williams, Casting curved shadows on curved surfaces, 1978; Reeves et al., 1987; Fernando, 2005.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import GBuffer, RaySurface, ShadowMap
from torchrender.checks import check_choice, check_range, check_tensor
from torchrender.effects.shadows.light_cameras import cascade_cameras, choose_views, light_cameras, light_view
from torchrender.errors import InputError, OptionError
from torchrender.kernels.shadows.shadow_lookup import AVERAGE_DEPTH, DISC, NEAREST_TEXEL, PCSS, WINDOW, shadow_lookup
from torchrender.kernels.shadows.shadow_receiver import CONSTANT, RECEIVER_PLANE, SLOPE, LookupSettings
from torchrender.numerics.shadow_compare import depth_bias, disc_points, project_with_slope, soft_window
from torchrender.raster import rasterize_depth
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, RectLight
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

BIASES = {"constant": CONSTANT, "slope": SLOPE, "receiver_plane": RECEIVER_PLANE}
FILTERS = {
    "none": NEAREST_TEXEL,
    "bilinear": WINDOW,
    "pcf": WINDOW,
    "poisson": DISC,
    "pcss": PCSS,
    "average_depth": AVERAGE_DEPTH,
}


@dataclass(frozen=True, kw_only=True)
class ShadowOptions:
    """How shadow maps are drawn and looked up. Lengths marked as shares are shares of the map's far - near.

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
    constant_bias: float = 1e-4  # share; constant part of the bias, b0
    slope_bias: float = 1.0  # factor k of the slope; 1 is a rigorous bound for planes
    largest_bias: float = 0.02  # share; largest bias, b_max: where slopes ask for more, the receiver plane takes over
    normal_offset: float = 0.0  # texels that points move along their normal at grazing light
    filter: str = "bilinear"
    filter_radius: int = 1  # radius n of "pcf" and "poisson" in texels
    search_taps: int = 16  # "pcss": blocker search
    taps: int = 32  # "poisson", "pcss"
    light_width: float | None = None  # "pcss", scene units; None: the rectangle's side, else 0.1 scene radius
    light_angle_deg: float = 0.53  # "pcss": angular diameter of a directional light; the sun's
    largest_radius: float = 32.0  # "pcss": largest radius rho_max of a penumbra in texels
    outside: str = "lit"  # what lies outside the map: "lit" or "shadow"
    cull: str = "none"  # faces left out of the map: "none", "back", "front" (less acne on closed, thick bodies)
    soft: float | None = None  # share; width tau of a comparison with gradients, sigmoid(b / tau) on lit surfaces
    cascades: int = 1  # maps of a directional light along the view

    def __post_init__(self) -> None:
        for side in self.shape:
            if not isinstance(side, int) or not 64 <= side <= 8192:
                raise OptionError(f"size must be integers in [64, 8192], got {self.size!r}")
        if self.bias is not None:
            check_choice("bias", self.bias, tuple(BIASES))
        check_choice("filter", self.filter, tuple(FILTERS))
        check_choice("outside", self.outside, ("lit", "shadow"))
        check_choice("cull", self.cull, ("none", "back", "front"))
        limits = {"constant_bias": (0.0, 0.01), "slope_bias": (0.0, 4.0), "largest_bias": (0.0, 1.0)}
        limits |= {"normal_offset": (0.0, 3.0), "filter_radius": (0, 7), "largest_radius": (1.0, 128.0)}
        limits |= {"search_taps": (4, 128), "taps": (4, 128), "cascades": (1, 8)}
        for name, (low, high) in limits.items():
            check_range(name, getattr(self, name), low, high)
        check_range("light_angle_deg", self.light_angle_deg, 1e-3, 90.0)
        if self.light_width is not None:
            check_range("light_width", self.light_width, 1e-12)
        if self.soft is not None:
            check_range("soft", self.soft, 1e-9, 1.0)
            if self.filter not in ("none", "bilinear", "pcf") or self.bias_mode == "receiver_plane":
                raise OptionError("soft needs filter none, bilinear or pcf and bias slope or constant")
            check_range("normal_offset (with soft)", self.normal_offset, 0.0, 0.0)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the map in texels."""
        height, width = (self.size, self.size) if isinstance(self.size, int) else self.size
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


# ---------------------------------------------------------------- pass 1


def render_shadow_map(
    scene: Scene | Geometry, light: Light, options: ShadowOptions | None = None, *, camera: Cameras | None = None
) -> ShadowMap:
    """Depth of the nearest surfaces as ``light`` sees them.

    Directional: one map around the scene, or with ``camera`` (B views) ``options.cascades`` maps per view along its
    frustum. Spot: one map (five where its half angle exceeds 65 degrees). Point: six faces. Rectangle: five faces seen
    from its centre. Faces of a cube are a little larger than 90 degrees, so that filters do not meet their borders.
    """
    options = options or ShadowOptions()
    geometry = scene.geometry if isinstance(scene, Scene) else scene
    boxes = geometry.cluster_bounds
    height, width = options.shape
    border = min(math.ceil(options.reach + options.normal_offset) + 1.0, min(height, width) / 8)
    if isinstance(light, DirectionalLight) and camera is not None:
        cameras = cascade_cameras(
            light, boxes, camera, count=options.cascades, width=width, height=height, border=border
        )
    else:
        cameras = light_cameras(light, boxes, width=width, height=height, border=border)
    return ShadowMap(cameras=cameras, depth=rasterize_depth(geometry, cameras, cull=options.cull))


# ---------------------------------------------------------------- pass 2


def shadow_factor(
    points: Tensor, normals: Tensor, light: Light, shadow_map: ShadowMap, options: ShadowOptions | None = None
) -> Tensor:
    """Visibility of a light at surface points.

    A point is lit where its depth in the light's image is at most the stored depth plus the bias. Points that face
    away from the light are 0 without a lookup; points without a surface (zero normal, or not finite) are 1.

    Args:
        points: (B,H,W,3) world positions, float32 or float64.
        normals: (B,H,W,3) unit *geometric* normals that face the viewer.
        shadow_map: from :func:`render_shadow_map`, for all B images or with one set of views for each.

    Returns:
        (B,H,W) float32 in [0,1], 1 = lit, never NaN. With ``options.soft`` differentiable in points and the map's
        depth.

    Raises:
        InputError: shapes that do not fit, or a map whose cameras have skew.
    """
    options = options or ShadowOptions()
    check_tensor("points", points, ("B", "H", "W", 3))
    check_tensor("normals", normals, tuple(points.shape))
    cameras = shadow_map.cameras
    check_tensor("shadow_map.depth", shadow_map.depth, (len(cameras), cameras.height, cameras.width))
    if bool((cameras.intrinsics[:, 0, 1] != 0).any()):
        raise InputError("shadow_map.cameras must not have skew")
    look_up = _look_up if options.soft is None else _look_up_soft
    count, depth = len(points), shadow_map.depth
    if not (cameras.orthographic and count > 1 and len(cameras) == count * options.cascades):
        return look_up(points, normals, light, shadow_map, options)
    images = []
    for index in range(count):
        views = slice(index * options.cascades, (index + 1) * options.cascades)
        own = ShadowMap(cameras=cameras[views], depth=depth[views])
        images.append(look_up(points[index : index + 1], normals[index : index + 1], light, own, options))
    return torch.cat(images)


def options_for(light: Light, scene: Scene, options: ShadowOptions | None = None) -> ShadowOptions:
    """The options with the size that a light without one has in this scene."""
    options = options or ShadowOptions()
    if options.light_width is None and not isinstance(light, RectLight):
        options = replace(options, light_width=max(0.05 * scene.diagonal, 1e-12))
    return options


def light_visibility(
    scene: Scene,
    light: Light,
    gbuffer: GBuffer | RaySurface,
    options: ShadowOptions | None = None,
    shadow_map: ShadowMap | None = None,
) -> Tensor:
    """Shadow factor (B,H,W) of one light at a G-buffer's points, or at those of an image of ray hits; empty ones are 1.

    A rectangle is seen from its centre: its shadows are hard, or with filter "pcss" as wide as a square of its area
    makes them. Pass the map of an earlier call while scene and light stand still.
    """
    options = options_for(light, scene, options)
    if shadow_map is None:
        view = gbuffer.cameras if options.cascades > 1 and isinstance(gbuffer, GBuffer) else None
        shadow_map = render_shadow_map(scene, light, options, camera=view)
    return shadow_factor(gbuffer.position, gbuffer.geometric_normal, light, shadow_map, options)


def lights_visibility(
    scene: Scene,
    gbuffer: GBuffer,
    options: ShadowOptions | None = None,
    shadow_maps: Sequence[ShadowMap | None] | None = None,
) -> Tensor:
    """Shadow factors (B,L,H,W) of all lights of a scene, in their order."""
    maps = [None] * len(scene.lights) if shadow_maps is None else list(shadow_maps)
    if len(maps) != len(scene.lights):
        raise InputError(f"shadow_maps must have {len(scene.lights)} entries, one per light, got {len(maps)}")
    if not maps:
        batch, height, width = gbuffer.triangle.shape
        return torch.ones(batch, 0, height, width)
    pairs = zip(scene.lights, maps)
    return torch.stack([light_visibility(scene, light, gbuffer, options, m) for light, m in pairs], dim=1)


# ---------------------------------------------------------------- private


def _look_up(points: Tensor, normals: Tensor, light: Light, part: ShadowMap, options: ShadowOptions) -> Tensor:
    cameras = part.cameras
    k, size = cameras.intrinsics, len(cameras)
    columns = [k[:, 0, 0], k[:, 1, 1], k[:, 0, 2], k[:, 1, 2], cameras.near, cameras.far]
    table = torch.cat([cameras.camera_from_world[:, :3].reshape(size, 12), torch.stack(columns, dim=1)], dim=1)
    taps = torch.cat([disc_points(options.search_taps, 1), disc_points(options.taps)])
    out = torch.zeros(points.shape[:-1])
    shadow_lookup(
        numpy_view(points.reshape(-1, 3), np.float64 if points.dtype == torch.float64 else np.float32),
        numpy_view(normals.reshape(-1, 3), np.float32),
        numpy_view(_source(light), np.float64),
        numpy_view(table, np.float64),
        numpy_view(part.depth, np.float32),
        numpy_view(taps, np.float64),
        _settings(light, part, options, exact=points.dtype == torch.float64),
        out.view(-1).numpy(),
    )
    return out


def _source(light: Light) -> Tensor:
    """(4,) float64: position and 1, or the direction towards parallel light and 0."""
    if isinstance(light, DirectionalLight):
        return torch.cat([-light.direction.double(), torch.zeros(1, dtype=torch.float64)])
    place = light.centre if isinstance(light, RectLight) else light.position
    return torch.cat([place.double(), torch.ones(1, dtype=torch.float64)])


def _settings(light: Light, part: ShadowMap, options: ShadowOptions, *, exact: bool) -> LookupSettings:
    cameras = part.cameras
    near, size = float(cameras.near.min()), 0.0
    if options.filter == "pcss":
        near = max(near, float(part.depth.min().clamp_max(cameras.far.max())))
        size = _light_size(light, cameras, options)
    return LookupSettings(
        orthographic=cameras.orthographic,
        cube=len(cameras) > 1 and not cameras.orthographic,
        bias=BIASES[options.bias_mode],
        filter=FILTERS[options.filter],
        n=options.window,
        radius=options.filter_radius + 0.5,
        reach=float(options.reach) + 0.5,
        b0=float(options.constant_bias),
        k=float(options.slope_bias),
        b_max=float(options.largest_bias),
        k_n=float(options.normal_offset),
        outside=1.0 if options.outside == "lit" else 0.0,
        light_size=size,
        rho_max=float(options.largest_radius),
        search_near=near,
        search_taps=options.search_taps,
        exact=exact,
    )


def _light_size(light: Light, cameras: Cameras, options: ShadowOptions) -> float:
    if isinstance(light, DirectionalLight):
        return 2.0 * math.tan(math.radians(options.light_angle_deg) / 2)
    if options.light_width is not None:
        return float(options.light_width)
    if isinstance(light, RectLight) and light.area > 0:
        return math.sqrt(light.area)
    return 0.05 * float((cameras.far - cameras.near).max())  # the light sees the scene's diameter as far - near


def _look_up_soft(points: Tensor, normals: Tensor, light: Light, part: ShadowMap, options: ShadowOptions) -> Tensor:
    cameras, source, shape = part.cameras, _source(light), points.shape[:-1]
    points, normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    tau = options.soft or 0.0
    normals = torch.nn.functional.normalize(normals.double(), dim=-1, eps=1e-30)
    surface = (normals.detach().abs().sum(-1) > 0) & torch.isfinite(points.detach()).all(-1)
    points = torch.where(surface[:, None], points, 0.0).double()
    to_light = source[:3] - source[3] * points
    facing = (normals * to_light).sum(-1) > 0
    result = torch.ones(len(points), dtype=torch.float64)
    chosen = choose_views(points.detach(), cameras, options.reach + 0.5)
    outside = 1.0 if options.outside == "lit" else 0.0
    for index in range(len(cameras)):
        rows = (chosen == index).nonzero().reshape(-1)
        view = light_view(cameras, index)
        at = project_with_slope(points[rows], normals[rows], view)
        span = view.far - view.near
        slope = options.slope_bias if options.bias_mode == "slope" else 0.0
        reach = 0.0 if options.filter == "none" else options.window + 0.5
        bias = depth_bias(at, span, (options.constant_bias, slope, options.largest_bias), reach)
        window = None if options.filter == "none" else options.window
        clamped = None if len(cameras) > 1 and not cameras.orthographic else outside
        factor = soft_window(part.depth[index], at, bias, tau * span, window, clamped, cameras.orthographic)
        inside = (at.z > view.near) & (at.z <= view.far) & (at.u >= 0) & (at.v >= 0)
        inside &= (at.u < cameras.width) & (at.v < cameras.height)
        result = result.index_copy(0, rows, torch.where(inside, factor, outside))
    return torch.where(surface, torch.where(facing, result, 0.0), 1.0).float().reshape(shape)
