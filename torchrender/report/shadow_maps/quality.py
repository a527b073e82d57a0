"""How good a shadow map is: texel density, detached contact shadows, and wrong pixels against ray-cast shadows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ShadowMap, position_error
from torchrender.checks import check_tensor
from torchrender.effects.shadows.light_cameras import choose_views, light_view
from torchrender.effects.shadows.shadow_map import ShadowOptions
from torchrender.numerics.shadow_compare import depth_bias, project_with_slope
from torchrender.rays import RayCaster
from torchrender.scene.light import DirectionalLight, Light, RectLight, SpotLight, vectors_to
from torchrender.scene.model import Scene
from torchrender.shade import shade


@dataclass(frozen=True, kw_only=True)
class ShadowErrors:
    """Shares of the covered pixels that face the light."""

    false_shadow: float  # dark by more than a half although lit
    false_light: float
    mean_error: float  # mean absolute difference of the shadow factors
    acne: float  # false shadow farther than two pixels from any edge of the reference
    kept: float  # share of the reference's dark pixels that are dark, too; 1 where there are none
    penumbra: float  # mean absolute difference where the reference is neither lit nor dark; 0 where it nowhere is


def shadow_errors(visibility: Tensor, reference: Tensor, counted: Tensor) -> ShadowErrors:
    """Compare shadow factors (B,H,W) over the ``counted`` pixels (B,H,W) bool; all zero if there are none."""
    for name, value in (("reference", reference), ("counted", counted)):
        check_tensor(name, value, tuple(visibility.shape))
    difference, wanted = (visibility - reference)[counted].double(), reference[counted]
    total = max(len(difference), 1)
    dark, half = wanted < 0.5, (wanted > 0.02) & (wanted < 0.98)
    far = (visibility - reference < -0.5) & counted & ~_near_edges(reference > 0.5)
    return ShadowErrors(
        false_shadow=float((difference < -0.5).sum()) / total,
        false_light=float((difference > 0.5).sum()) / total,
        mean_error=float(difference.abs().sum()) / total,
        acne=float(far.sum()) / total,
        kept=1.0 - float((difference > 0.5)[dark].sum()) / max(int(dark.sum()), 1),
        penumbra=float(difference[half].abs().mean()) if bool(half.any()) else 0.0,
    )


def _near_edges(lit: Tensor) -> Tensor:
    """(B,H,W) bool: some pixel within two of it differs."""
    value = lit.float()[:, None]
    high = torch.nn.functional.max_pool2d(value, 5, 1, 2)
    low = -torch.nn.functional.max_pool2d(-value, 5, 1, 2)
    return (high != low)[:, 0]


def faces(light: Light, gbuffer: GBuffer) -> Tensor:
    """(B,H,W) bool: pixels that the light would shine on if nothing were in the way.

    Their surface is not turned away from the light's centre; it lies on the side to which a rectangle sends, in the
    cone of a spot, and in range.
    """
    normals = gbuffer.geometric_normal.double()
    if isinstance(light, DirectionalLight):
        return (normals @ -light.direction.double()) > 0
    toward = (light.centre if isinstance(light, RectLight) else light.position).double() - gbuffer.position
    facing = (toward * normals).sum(-1) > 0
    if isinstance(light, RectLight):
        return facing & ((toward @ -light.normal.double()) > 0)
    length = toward.norm(dim=-1)
    if isinstance(light, SpotLight):
        facing &= -(toward @ light.direction.double()) > math.cos(math.radians(light.outer_deg)) * length
    return facing & (length < light.range)


def disc_visibility(caster: RayCaster, light: Light, gbuffer: GBuffer, width: float, points: Tensor) -> Tensor:
    """Share (B,H,W) that rays find of a light without area, taken as a disc that faces each pixel's surface point.

    Args:
        width: of the disc, scene units; of parallel light twice the tangent of the half angle that it fills.
        points: (N,2) places in the unit disc.
    """
    covered = gbuffer.covered
    rows = covered.reshape(-1).nonzero().reshape(-1)
    normals = gbuffer.geometric_normal[covered].double()
    start = gbuffer.position[covered].double() + normals * position_error(gbuffer, rows)[:, None]
    middle, seen = vectors_to(light, start), torch.zeros(len(start))
    facing = torch.nn.functional.normalize(middle, dim=-1, eps=1e-300)
    axis = torch.nn.functional.one_hot(facing.abs().argmin(dim=-1), 3).double()
    u = torch.nn.functional.normalize(torch.linalg.cross(facing, axis), dim=-1)
    v = torch.linalg.cross(facing, u)
    limit = math.inf if isinstance(light, DirectionalLight) else 1.0 - 1e-6
    for a, b in (0.5 * width * points.double()).tolist():
        toward = middle + a * u + b * v
        seen += ((toward * normals).sum(-1) > 0) & ~caster.occluded(start, toward, t_max=limit)
    image = torch.ones(gbuffer.triangle.shape)
    image[covered] = seen / len(points)
    return image


def naive_shading(scene: Scene, gbuffer: GBuffer, visibility: Tensor) -> Tensor:
    """The baseline of specification 07, section 5: the shadow factors (B,L,H,W) darken everything, ambient light too.

    Radiance (B,H,W,3) where :func:`torchrender.shade.shade` keeps the ambient part. Several lights count by their mean.
    """
    check_tensor("visibility", visibility, (len(gbuffer.cameras), len(scene.lights), *gbuffer.depth.shape[1:]))
    return shade(scene, gbuffer, None) * visibility.mean(dim=1)[..., None]


def aliasing_ratio(gbuffer: GBuffer, shadow_map: ShadowMap) -> Tensor:
    """Pixels per texel (B,H,W): ``1 / |det d(u,v)/d(pixel)|`` along the visible surface; 0 where empty.

    Above one, several pixels share a texel and stairs show; no filter cures that, only a larger or tighter map. The
    derivative is exact for the tangent plane of each pixel. Texels seen edge-on count 1e6 at most.
    """
    cameras, covered = gbuffer.cameras, gbuffer.covered
    result = torch.zeros(gbuffer.triangle.shape)
    centres = cameras.pixel_centres()
    for index in range(len(cameras)):
        rows = covered[index]
        if not bool(rows.any()):
            continue
        view = cameras[index]
        step = torch.zeros(3, int(rows.sum()), 2, dtype=torch.float64)
        step[1, :, 0] = step[2, :, 1] = 1e-3
        pixels = centres[rows] + step
        origins, directions = (x.reshape(3, -1, 3) for x in view.rays(pixels.reshape(1, -1, 2)))
        point = gbuffer.position[index][rows].double()
        normal = gbuffer.geometric_normal[index][rows].double()
        slant = (directions * normal).sum(-1)
        slant = torch.where(slant.abs() > 1e-12, slant, 1e-12)
        hit = origins + directions * (((point - origins) * normal).sum(-1) / slant)[..., None]
        uv = _texels(hit, choose_views(point, shadow_map.cameras, 0.0), shadow_map) / 1e-3
        along, down = uv[1] - uv[0], uv[2] - uv[0]
        area = (along[:, 0] * down[:, 1] - along[:, 1] * down[:, 0]).abs()
        result[index][rows] = (1.0 / area.nan_to_num(0.0).clamp_min(1e-6)).float()
    return result


def contact_displacement(gbuffer: GBuffer, light: Light, shadow_map: ShadowMap, options: ShadowOptions) -> Tensor:
    """How far the bias can push a contact shadow along the receiver, scene units (B,H,W); 0 where nothing is lit.

    A caster closer than the bias b along the light's ray is missed; on a surface at angle theta to the light that
    leaves a lit strip of width ``b sin(theta)``.
    """
    covered = gbuffer.covered
    points, normals = gbuffer.position[covered].double(), gbuffer.geometric_normal[covered].double()
    chosen = choose_views(points, shadow_map.cameras, options.reach + 0.5)
    to_light = torch.nn.functional.normalize(vectors_to(light, points), dim=-1, eps=1e-30)
    cosine = (to_light * normals).sum(-1)
    sine = (1.0 - cosine.square()).clamp_min(0.0).sqrt()
    slope = options.slope_bias if options.bias_mode == "slope" else 0.0
    moved = torch.zeros(len(points), dtype=torch.float64)
    for index in range(len(shadow_map.cameras)):
        rows, view = chosen == index, light_view(shadow_map.cameras, index)
        at = project_with_slope(points[rows], normals[rows], view)
        limits = (options.constant_bias, slope, options.largest_bias)
        bias, _ = depth_bias(at, view, limits, options.reach)
        moved[rows] = bias * sine[rows]
    image = torch.zeros(gbuffer.triangle.shape)
    image[covered] = torch.where(cosine > 0, moved, 0.0).float()
    return image


def _texels(points: Tensor, chosen: Tensor, shadow_map: ShadowMap) -> Tensor:
    """Texel coordinates (K,N,2) of points (K,N,3), each in the view ``chosen`` (N,) for it; NaN behind the light."""
    uv = torch.full((*points.shape[:2], 2), torch.nan, dtype=torch.float64)
    for index in range(len(shadow_map.cameras)):
        rows = chosen == index
        found, _ = shadow_map.cameras[index].project(points[:, rows].reshape(1, -1, 3))
        uv[:, rows] = found.reshape(len(points), -1, 2)
    return uv
