"""Shadow maps: depth as a light sees it decides which visible points the light reaches.

Pass 1 draws the scene from the light; pass 2 looks every visible point up in that picture. A map depends on light and
scene only: hand it back in while both stand still. Biases are metric, because depth is linear.
Sources: Williams, Casting curved shadows on curved surfaces, 1978; Reeves et al., 1987; Fernando, 2005.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import GBuffer, RaySurface, ShadowMap, position_error
from torchrender.checks import check_tensor, options_of
from torchrender.effects.shadows.exact_edges import folded, hidden_points, view_rows
from torchrender.effects.shadows.light_cameras import choose_views, light_cameras, light_view
from torchrender.effects.shadows.options import BIASES as BIASES
from torchrender.effects.shadows.options import FILTERS as FILTERS
from torchrender.effects.shadows.options import ShadowOptions as ShadowOptions
from torchrender.effects.shadows.receivers import shadow_receivers
from torchrender.effects.shadows.view_cameras import view_cameras
from torchrender.errors import InputError
from torchrender.kernels.shadows.shadow_lookup import shadow_lookup
from torchrender.kernels.shadows.shadow_receiver import LookupSettings
from torchrender.numerics.shadow_compare import depth_bias, disc_points, project_with_slope, soft_window, texel_width
from torchrender.raster import rasterize_depth
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, RectLight
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene

# ---------------------------------------------------------------- pass 1


def render_shadow_map(
    scene: Scene | Geometry, light: Light, options: ShadowOptions | None = None, *, gbuffer: GBuffer | None = None
) -> ShadowMap:
    """Depth of the nearest surfaces as ``light`` sees them.

    Without a G-buffer, of everything that the light can see. Directional: one map around the scene. Spot: one map (five
    where its half angle exceeds 65 degrees). Point: six faces. Rectangle: five faces seen from its centre. Faces of a
    cube are a little larger than 90 degrees, so that filters do not meet their borders. With a G-buffer of the scene,
    of what can cast shadows on what B pictures see: :func:`~torchrender.effects.shadows.view_cameras.view_cameras`.
    """
    options = options_of(options, ShadowOptions)
    geometry = scene.geometry if isinstance(scene, Scene) else scene
    if gbuffer is not None and isinstance(scene, Scene):
        return draw_shadow_map(geometry, *view_cameras(scene, light, gbuffer, options), options)
    return draw_shadow_map(geometry, light_views(geometry, light, options), None, options)


def light_views(geometry: Geometry, light: Light, options: ShadowOptions) -> Cameras:
    """The views of a light that show everything it can light."""
    height, width = options.shape
    return light_cameras(light, geometry.cluster_bounds, width=width, height=height, border=options.border)


def draw_shadow_map(
    geometry: Geometry, cameras: Cameras, starts: tuple[int, ...] | None, options: ShadowOptions
) -> ShadowMap:
    """The map of given views; ``starts`` as in :class:`~torchrender.buffers.ShadowMap`."""
    return ShadowMap(cameras=cameras, depth=rasterize_depth(geometry, cameras, cull=options.cull), starts=starts)


# ---------------------------------------------------------------- pass 2


def shadow_factor(
    points: Tensor, normals: Tensor, light: Light, shadow_map: ShadowMap, options: ShadowOptions | None = None
) -> Tensor:
    """Visibility of a light at surface points.

    A point is lit where its depth in the light's image is at most the stored depth plus the bias, whatever
    ``options.edges`` says: :func:`light_visibility` settles them by the scene's triangles. Points that face
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
    # Without triangles nothing else can settle what the map leaves open.
    return _factors(points, normals, light, shadow_map, replace(options_of(options, ShadowOptions), edges="map"))[0]


def options_for(light: Light, scene: Scene, options: ShadowOptions | None = None) -> ShadowOptions:
    """The options with the size that a light without one has in this scene."""
    options = options_of(options, ShadowOptions)
    if options.light_width is None and not isinstance(light, RectLight):
        options = replace(options, light_width=max(0.05 * scene.diagonal, 1e-12))
    return options


def light_visibility(
    scene: Scene,
    light: Light,
    gbuffer: GBuffer | RaySurface,
    options: ShadowOptions | None = None,
    shadow_map: ShadowMap | None = None,
    known: tuple[Tensor, Tensor] | None = None,
) -> Tensor:
    """Shadow factor (B,H,W) of one light at a G-buffer's points, or at those of an image of ray hits; empty ones are 1.

    A rectangle is seen from its centre: its shadows are hard, or with filter "pcss" as wide as a square of its area
    makes them. Pass the map of an earlier call while scene and light stand still. ``known``: factors (B,H,W), and where
    these hold already (B,H,W) bool: nothing is looked up there.
    """
    options = options_for(light, scene, options)
    if shadow_map is None:
        seen = gbuffer if options.coverage == "view" and isinstance(gbuffer, GBuffer) else None
        shadow_map = render_shadow_map(scene, light, options, gbuffer=seen)
    points, normals = shadow_receivers(gbuffer)
    if known is None:
        return _settled(scene, light, gbuffer, (points, normals), options, shadow_map)
    if bool(known[1].all()):
        return known[0]
    wanted = torch.where(known[1][..., None], 0.0, normals)  # points without a normal are not looked up
    found = _settled(scene, light, gbuffer, (points, wanted), options, shadow_map)
    return torch.where(known[1], known[0], found)


def _settled(
    scene: Scene,
    light: Light,
    gbuffer: GBuffer | RaySurface,
    surface: tuple[Tensor, Tensor],
    options: ShadowOptions,
    shadow_map: ShadowMap,
) -> Tensor:
    """Factors of points and normals, with exact edges where the options ask for them."""
    points, normals = surface
    if not (settles(options) and isinstance(gbuffer, GBuffer)):
        return shadow_factor(points, normals, light, shadow_map, options)
    found, doubt = _factors(points, normals, light, shadow_map, options)
    rows = (doubt >= 0).reshape(-1).nonzero().reshape(-1)
    if not len(rows):
        return found
    at, facing = points.reshape(-1, 3).index_select(0, rows), normals.reshape(-1, 3).index_select(0, rows)
    lifted = at + facing * position_error(gbuffer, rows)[:, None]
    size = _light_size(light, shadow_map.cameras, options) if options.filter == "pcss" else 0.0
    hidden = hidden_points(scene.geometry, shadow_map.cameras, doubt.reshape(-1)[rows], lifted, size)
    flat = found.reshape(-1)
    return flat.index_copy(0, rows, folded(flat[rows], hidden)).reshape(found.shape)


def settles(options: ShadowOptions) -> bool:
    """Edges are exact: of filters that soften an edge, and of penumbrae no wider than texels."""
    return options.edges == "exact" and options.soft is None and options.filter != "average_depth"


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


def _factors(
    points: Tensor, normals: Tensor, light: Light, shadow_map: ShadowMap, options: ShadowOptions
) -> tuple[Tensor, Tensor]:
    """Visibility (B,H,W), and the view in which a point is in doubt (B,H,W) int32, or -1."""
    check_tensor("points", points, ("B", "H", "W", 3))
    check_tensor("normals", normals, tuple(points.shape))
    cameras = shadow_map.cameras
    check_tensor("shadow_map.depth", shadow_map.depth, (len(cameras), cameras.height, cameras.width))
    if bool((cameras.intrinsics[:, 0, 1] != 0).any()):
        raise InputError("shadow_map.cameras must not have skew")
    look_up = _look_up if options.soft is None else _look_up_soft
    if shadow_map.starts is None:
        return look_up(points, normals, light, shadow_map, options)
    if len(shadow_map.starts) != len(points) + 1:
        raise InputError(f"shadow_map is of {len(shadow_map.starts) - 1} pictures, points are of {len(points)}")
    if shadow_map.starts == (0, len(cameras)) and len(cameras):
        return look_up(points, normals, light, shadow_map, options)
    images, doubts = [], []
    for index, (begin, end) in enumerate(pairwise(shadow_map.starts)):
        part = points[index : index + 1], normals[index : index + 1]
        found, doubt = torch.ones(part[0].shape[:-1]), torch.full(part[0].shape[:-1], -1, dtype=torch.int32)
        if end > begin:
            own = ShadowMap(cameras=cameras[begin:end], depth=shadow_map.depth[begin:end], starts=(0, end - begin))
            found, doubt = look_up(*part, light, own, options)
        images.append(found)
        doubts.append(torch.where(doubt >= 0, doubt + begin, doubt))
    return torch.cat(images), torch.cat(doubts)


def _look_up(
    points: Tensor, normals: Tensor, light: Light, part: ShadowMap, options: ShadowOptions
) -> tuple[Tensor, Tensor]:
    taps = torch.cat([disc_points(options.search_taps, 1), disc_points(options.taps)])
    out = torch.zeros(points.shape[:-1])
    doubt = torch.full(out.shape, -1, dtype=torch.int32)
    shadow_lookup(
        numpy_view(points.reshape(-1, 3), np.float64 if points.dtype == torch.float64 else np.float32),
        numpy_view(normals.reshape(-1, 3), np.float32),
        numpy_view(_source(light), np.float64),
        view_rows(part.cameras),
        numpy_view(part.depth, np.float32),
        numpy_view(taps, np.float64),
        _settings(light, part, options, exact=points.dtype == torch.float64),
        (out.view(-1).numpy(), doubt.view(-1).numpy()),
    )
    return out, doubt


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
        near = max(near, min(part.nearest, float(cameras.far.max())))
        size = _light_size(light, cameras, options)
    return LookupSettings(
        orthographic=cameras.orthographic,
        cube=part.starts is None and len(cameras) > 1 and not cameras.orthographic,
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
        **_edges(light),
        settles=settles(options),
        exact=exact,
    )


def _edges(light: Light) -> dict[str, float]:
    """Edges of a rectangle by component; zeros for other lights."""
    edges = torch.cat([light.edge_u, light.edge_v]).tolist() if isinstance(light, RectLight) else [0.0] * 6
    return dict(zip(("ux", "uy", "uz", "vx", "vy", "vz"), edges, strict=True))


def _light_size(light: Light, cameras: Cameras, options: ShadowOptions) -> float:
    if isinstance(light, DirectionalLight):
        return 2.0 * math.tan(math.radians(options.light_angle_deg) / 2)
    if options.light_width is not None:
        return float(options.light_width)
    if isinstance(light, RectLight) and light.area > 0:
        return math.sqrt(light.area)
    return 0.05 * float((cameras.far - cameras.near).max())  # the light sees the scene's diameter as far - near


def _look_up_soft(
    points: Tensor, normals: Tensor, light: Light, part: ShadowMap, options: ShadowOptions
) -> tuple[Tensor, Tensor]:
    cameras, source, shape = part.cameras, _source(light), points.shape[:-1]
    points, normals = points.reshape(-1, 3), normals.reshape(-1, 3)
    normals = torch.nn.functional.normalize(normals.double(), dim=-1, eps=1e-30)
    surface = (normals.detach().abs().sum(-1) > 0) & torch.isfinite(points.detach()).all(-1)
    points = torch.where(surface[:, None], points, 0.0).double()
    to_light = source[:3] - source[3] * points
    facing = (normals * to_light).sum(-1) > 0
    result = torch.ones(len(points), dtype=torch.float64)
    chosen = choose_views(points.detach(), cameras, options.reach + 0.5, part.starts is not None)
    outside = 1.0 if options.outside == "lit" else 0.0
    for index in range(len(cameras)):
        rows = (chosen == index).nonzero().reshape(-1)
        view = light_view(cameras, index)
        at = project_with_slope(points[rows], normals[rows], view)
        tau = (options.soft or 0.0) * texel_width(at, view).clamp_min(1e-300)
        slope = options.slope_bias if options.bias_mode == "slope" else 0.0
        reach = 0.0 if options.filter == "none" else options.window + 0.5
        bias = depth_bias(at, view, (options.constant_bias, slope, options.largest_bias), reach)
        window = None if options.filter == "none" else options.window
        clamped = None if part.starts is None and len(cameras) > 1 and not cameras.orthographic else outside
        factor = soft_window(part.depth[index], at, bias, tau, window, clamped, cameras.orthographic)
        inside = (at.z > view.near) & (at.z <= view.far) & (at.u >= 0) & (at.v >= 0)
        inside &= (at.u < cameras.width) & (at.v < cameras.height)
        result = result.index_copy(0, rows, torch.where(inside, factor, outside))
    found = torch.where(surface, torch.where(facing, result, 0.0), 1.0).float().reshape(shape)
    return found, torch.full(shape, -1, dtype=torch.int32)
