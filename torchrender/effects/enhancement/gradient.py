"""How shaded colour changes across the picture: the gradient, term by term, in plain torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.effects.enhancement.curvature import strength
from torchrender.effects.enhancement.derivatives import (
    barycentric_gradients,
    cosine_gradient,
    direction_gradient,
    irradiance_gradient,
    normal_gradient,
    phong_gradient,
    projection_gradient,
    row_times,
)
from torchrender.effects.enhancement.lights import at_points, environment_harmonics
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.surface_image import SurfaceImage
from torchrender.scene.environment import Environment
from torchrender.scene.light import Light
from torchrender.scene.mesh import Geometry

NEAREST = 1e-4
"""Least distance to a light that counts, in median distances of what is seen."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """What shines on a surface."""

    lights: Sequence[Light] = ()
    visibility: Tensor | None = None  # (B,L,H,W) in [0,1]; None: all is lit
    environment: Environment | None = None


@dataclass(frozen=True, eq=False)
class Gloss:
    """Highlights of the pixels, for the specular term."""

    color: Tensor  # (B,H,W,3) mirrored share
    exponent: Tensor  # (B,H,W) of Phong's lobe
    relative_to: Tensor  # (B,H,W,3) diffuse reflectance that results are divided by


@dataclass(frozen=True, eq=False)
class _Rows:
    """Covered pixels of one camera."""

    eye: Tensor  # (3,) world space
    position: Tensor  # (N,3) from the eye
    normal: Tensor  # (N,3)
    to_eye: Tensor  # (N,3)
    eye_distance: Tensor  # (N,)
    relative: Tensor  # (N,3,2) A / reference depth
    reference: Tensor  # (N,)
    slope: Tensor  # (N,3,3) that stands for the normal's derivative, for moves in reference depths


def shading_gradient(
    surface: SurfaceImage,
    curvature: Tensor,
    lighting: Lighting,
    options: EnhanceOptions,
    *,
    gloss: Gloss | None = None,
    normals: Tensor | None = None,
    shadow_edges: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """Gradient (B,H,W,3 channels,2) of a white surface's radiance over the picture, and its signed size (B,H,W,3).

    Steps in the picture are in focal lengths, steps on the surface in reference depths, so that nothing depends on
    units. True derivatives, of ``curvature="full"`` and of visibility, are multiplied by ``step``. The signed size is
    that of "signed_l2": ``S |w A|`` for each light.

    Args:
        curvature: (B,H,W) ``k / beta``.
        normals: (B,H,W,3,3) derivative of the normal, 1/unit, for full curvature.
        shadow_edges: (B,L,H,W,2) derivative of visibility over the picture, where asked for.
    """
    shape = surface.depth.shape
    gradient = torch.zeros(*shape, 3, 2, dtype=torch.float64)
    signed = torch.zeros(*shape, 3, dtype=torch.float64)
    for b in range(len(surface.cameras)):
        chosen = surface.covered[b]
        if not bool(chosen.any()):
            continue
        rows = _rows(surface, b, curvature, options, normals)
        parts = _of_rows(rows, lighting, options, b, chosen, gloss, shadow_edges)
        gradient[b] = gradient[b].masked_scatter(chosen[..., None, None], parts[0])
        signed[b] = signed[b].masked_scatter(chosen[..., None], parts[1])
    return gradient, signed


def _rows(surface: SurfaceImage, b: int, curvature: Tensor, options: EnhanceOptions, normals: Tensor | None) -> _Rows:
    chosen = surface.covered[b]
    axes, eye = surface.axes[b], surface.cameras.eye[b]
    position = surface.position[b][chosen] - eye
    depth, reference = (v[b][chosen].double() for v in (surface.depth, surface.reference_depth))
    if surface.cameras.orthographic:
        rays, depth = surface.cameras.forward[b].expand_as(position), torch.ones_like(depth)
        to_eye, distance = -rays, torch.full_like(depth, torch.inf)
    else:
        rays, distance = position / depth[:, None], position.norm(dim=-1)
        to_eye = -position / distance[:, None]
    if "projection" in options.terms:
        moves = projection_gradient(rays, surface.geometric_normal[b][chosen].double(), depth, axes, options.grazing)
        moves = moves / reference[:, None, None]
    else:
        moves = axes.T.expand(len(position), 3, 2)
    if normals is not None:
        slope = normals[b][chosen].double() * reference[:, None, None]
    else:
        size = strength(curvature[b][chosen].double(), options.exponent)
        slope = size[:, None, None] * torch.eye(3, dtype=torch.float64)
    normal = surface.normal[b][chosen].double()
    return _Rows(eye, position, normal, to_eye, distance, moves, reference, slope)


def _of_rows(
    rows: _Rows,
    lighting: Lighting,
    options: EnhanceOptions,
    b: int,
    chosen: Tensor,
    gloss: Gloss | None,
    shadow_edges: Tensor | None,
) -> tuple[Tensor, Tensor]:
    gradient = torch.zeros(len(rows.normal), 3, 2, dtype=torch.float64)
    signed = torch.zeros(len(rows.normal), 3, dtype=torch.float64)
    nearest = NEAREST * float(rows.reference.median())
    sign = rows.slope[:, 0, 0].sign()
    carried = options.step if options.curvature == "full" else 1.0
    for number, light in enumerate(lighting.lights):
        direction, distance, color = at_points(light, rows.position, rows.eye, nearest)
        share = torch.ones(len(direction), dtype=torch.float64)
        if lighting.visibility is not None:
            share = lighting.visibility[b, number][chosen].double()
        color = color.double() / torch.pi
        change = torch.zeros(len(direction), 2, dtype=torch.float64)
        cosine = (rows.normal * direction).sum(dim=-1)
        turning = direction_gradient(direction, distance / rows.reference)
        if not options.light_gradient:
            turning = torch.zeros_like(turning)
        if "geometry" in options.terms:
            slope = cosine_gradient(rows.normal, direction, rows.slope, turning)
            change = change + carried * row_times(slope, rows.relative)
            length = row_times(row_times(direction, rows.slope), rows.relative).norm(dim=-1)
            signed = signed + color * (torch.where(cosine > 0, length * sign, 0.0) * share)[:, None]
        gradient = gradient + (color * share[:, None])[..., None] * change[:, None]
        if gloss is not None and "specular" in options.terms:
            shine = carried * _highlights(rows, direction, turning, gloss, (b, chosen))
            gradient = gradient + (color * share[:, None])[..., None] * shine
        if shadow_edges is not None and "visibility" in options.terms:
            lit = (color * cosine.clamp_min(0.0)[:, None])[..., None]
            gradient = gradient + lit * options.step * shadow_edges[b, number][chosen].double()[:, None]
    if lighting.environment is not None and "geometry" in options.terms:
        turned = irradiance_gradient(environment_harmonics(lighting.environment), rows.normal) / torch.pi
        change = carried * (turned @ rows.slope @ rows.relative)
        gradient = gradient + change
        signed = signed + change.norm(dim=-1) * sign[:, None]
    return gradient, signed


def _highlights(rows: _Rows, direction: Tensor, turning: Tensor, gloss: Gloss, where: tuple[int, Tensor]) -> Tensor:
    """(N,3,2) of Phong's lobe, relative to the diffuse reflectance."""
    b, chosen = where
    exponent = gloss.exponent[b][chosen].double().clamp_min(1.0)
    eye_turning = direction_gradient(rows.to_eye, rows.eye_distance / rows.reference)
    slope = phong_gradient(rows.normal, direction, rows.to_eye, (rows.slope, turning, eye_turning), exponent)
    change = row_times(slope, rows.relative) * ((exponent + 2.0) / 2.0)[:, None]
    share = gloss.color[b][chosen].double() / gloss.relative_to[b][chosen].double().clamp_min(1e-3)
    return share[..., None] * change[:, None]


def mesh_normal_gradient(surface: SurfaceImage, geometry: Geometry, triangle: Tensor, barycentric: Tensor) -> Tensor:
    """(B,H,W,3,3) derivative of the interpolated normal, 1/unit, of what pixels see; 0 where the mesh has none."""
    out = torch.zeros(*triangle.shape, 3, 3, dtype=torch.float64)
    seen = triangle >= 0
    if geometry.normals is None or not bool(seen.any()):
        return out
    corners = geometry.faces[triangle[seen]].long()
    weights = barycentric[seen].double()
    weights = torch.cat([1.0 - weights.sum(dim=-1, keepdim=True), weights], dim=-1)
    facing = surface.normal[seen].double()
    slopes = barycentric_gradients(geometry.vertices[corners])
    normal, slope = normal_gradient(geometry.normals[corners].double(), weights, slopes, facing)
    turned = torch.where((normal * facing).sum(dim=-1) < 0, -1.0, 1.0)
    out[seen] = slope * turned[:, None, None]
    return out
