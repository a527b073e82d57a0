"""Gradient-enhanced pictures: of a scene's G-buffer, or of any picture with depth.

Source: specification 10.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_class, check_finite, check_no_gradient, check_tensor, options_of
from torchrender.effects.enhancement.creases import bound_overshoot
from torchrender.effects.enhancement.curvature import strength
from torchrender.effects.enhancement.gradient import NEAREST, Gloss, Lighting, shading_gradient
from torchrender.effects.enhancement.lights import harmonic_table, light_table
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.shadow_edges import shadow_edges
from torchrender.effects.enhancement.surface_image import SurfaceImage
from torchrender.kernels.enhancement import gradient as kernels
from torchrender.kernels.enhancement.local_range import limit_to_range
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light

_MAGNITUDES = {"signed_l2": kernels.SIGNED, "sum": kernels.SUM, "l1": kernels.L1, "l2": kernels.L2}

WINDOW = 7
"""Pixels of the neighbourhood whose range limits what enhancement may do."""

ONE_SIDE, JUMP = 0.985, 0.05
"""Cosine between faces, and difference of inverse depth, up to which pixels lie on one side of creases and outlines."""


def enhancement(
    surface: SurfaceImage,
    curvature: Tensor,
    lighting: Lighting,
    options: EnhanceOptions | None = None,
    *,
    gloss: Gloss | None = None,
    normals: Tensor | None = None,
) -> Tensor:
    """``mag(grad I)`` (B,H,W,3) of a white surface; multiply it by the reflectance, whose own changes are no shape.

    Args:
        curvature: (B,H,W) ``k / beta``; see :func:`~.surface_image.curvature_of` and :meth:`SurfaceImage.curvature`.
        gloss: highlights, for the term "specular".
        normals: (B,H,W,3,3) derivative of the normals, 1/unit, for ``curvature="full"``.

    Differentiable in curvature, visibility and lights; where one of them wants a gradient, or a term asks for it, plain
    torch does it, else a compiled loop.

    Raises:
        InputError: shapes that do not fit.
    """
    options = options_of(options, EnhanceOptions)
    check_tensor("curvature", curvature, tuple(surface.depth.shape))
    if lighting.visibility is not None:
        shape = surface.depth.shape
        check_tensor("visibility", lighting.visibility, (shape[0], len(lighting.lights), *shape[1:]))
    fused = set(options.terms) <= {"geometry", "projection"} and options.curvature == "scaled"
    if fused and not _wants_gradient(curvature, lighting):
        return _fused(surface, curvature, lighting, options)
    edges = None
    if "visibility" in options.terms and lighting.visibility is not None:
        edges = shadow_edges(surface, lighting.visibility, options)
    gradient, signed = shading_gradient(
        surface, curvature, lighting, options, gloss=gloss, normals=normals, shadow_edges=edges
    )
    return magnitude(gradient, signed, options).float()


def magnitude(gradient: Tensor, signed: Tensor, options: EnhanceOptions) -> Tensor:
    """``mag`` (...,3) of gradients (...,3,2); "signed_l2" takes the signed size (...,3) and keeps other terms' sums."""
    if options.magnitude == "signed_l2":
        return signed
    if options.magnitude == "sum":
        return gradient.sum(dim=-1)
    return gradient.abs().sum(dim=-1) if options.magnitude == "l1" else gradient.norm(dim=-1)


def enhanced(radiance: Tensor, size: Tensor, surface: SurfaceImage, options: EnhanceOptions) -> Tensor:
    """``plain_weight I + gradient_weight size`` (B,H,W,3) where a surface is; never below zero; elsewhere as it was.

    With ``range_limit`` it stays within the range of ``plain_weight I`` over those of 7 x 7 pixels that lie on the same
    side of creases and outlines, widened by that share on either side: beside edges contrast cannot flip. What the
    limit cuts off has no derivative. With ``overshoot_limit`` what is added beside creases stays within that share of
    the largest that would be; see :func:`~.creases.bound_overshoot`.
    """
    plain = options.plain_weight * radiance
    made = torch.add(plain, size, alpha=options.gradient_weight).clamp_min(0.0)
    if options.range_limit is not None:
        made = _limited(plain, made, surface, options.range_limit).clamp_min(0.0)
    if options.overshoot_limit is not None:
        made = bound_overshoot(plain, made, surface, options.overshoot_limit)
    return torch.where(surface.covered[..., None], made, radiance)


def _limited(plain: Tensor, made: Tensor, surface: SurfaceImage, share: float) -> Tensor:
    held = made.detach().contiguous().clone()
    nearness = torch.where(surface.covered, 1.0 / surface.depth, 0.0)
    for b in range(len(held)):
        views = [view(v, np.float32) for v in (surface.geometric_normal[b], nearness[b], plain[b])]
        limit_to_range(*views, (WINDOW // 2, share, ONE_SIDE, JUMP), held[b].numpy())
    return torch.where(held == made, made, held)


def enhance_picture(
    cameras: Cameras,
    radiance: Tensor,
    depth: Tensor,
    normal: Tensor | None = None,
    *,
    lights: tuple[Light, ...] | None = None,
    environment: Environment | None = None,
    options: EnhanceOptions | None = None,
) -> Tensor:
    """Enhanced radiance (B,H,W,3) of any picture with depth: points, voxels, scans, isosurfaces.

    Args:
        radiance: (B,H,W,3) linear; it is also taken for the surface's reflectance.
        depth: (B,H,W) camera z; not finite or not positive: empty.
        normal: (B,H,W,3) world space; None: from depth.
        lights: None, without an environment: a light that shines along each camera's axis.

    Raises:
        InputError: shapes that do not fit, or light that is not finite. GradientError: depth or normals ask for
            gradients.
    """
    check_class("cameras", cameras, Cameras)
    check_no_gradient("enhance_picture", depth=depth, normal=normal)
    options = options_of(options, EnhanceOptions)
    surface = SurfaceImage.from_depth(cameras, depth, normal)
    check_finite("radiance", check_tensor("radiance", radiance, (*depth.shape, 3)))
    curvature = surface.curvature(options.limit, centred=options.centred)
    size = torch.zeros_like(radiance)
    for b in range(len(cameras)):
        shining = lights
        if shining is None:
            head = DirectionalLight(direction=cameras.forward[b].float(), irradiance=torch.full((3,), torch.pi))
            shining = (head,) if environment is None else ()
        part = _part(surface, b)
        size[b] = enhancement(part, curvature[b : b + 1], Lighting(shining, None, environment), options)[0]
    return enhanced(radiance, size * radiance, surface, options)


def _part(surface: SurfaceImage, b: int) -> SurfaceImage:
    chosen = slice(b, b + 1)
    return SurfaceImage(
        cameras=surface.cameras[b],
        depth=surface.depth[chosen],
        position=surface.position[chosen],
        normal=surface.normal[chosen],
        geometric_normal=surface.geometric_normal[chosen],
        object_id=surface.object_id[chosen],
    )


def _wants_gradient(curvature: Tensor, lighting: Lighting) -> bool:
    tensors = [curvature]
    if lighting.visibility is not None:
        tensors.append(lighting.visibility)
    if lighting.environment is not None:
        tensors.append(lighting.environment.radiance)
    for light in lighting.lights:
        tensors += [value for value in vars(light).values() if isinstance(value, Tensor)]
    return torch.is_grad_enabled() and any(t.requires_grad for t in tensors)


def _fused(surface: SurfaceImage, curvature: Tensor, lighting: Lighting, options: EnhanceOptions) -> Tensor:
    shape, cameras = surface.depth.shape, surface.cameras
    out = torch.zeros(*shape, 3)
    depth = torch.where(surface.covered, surface.depth, torch.inf)
    size = strength(curvature, options.exponent)
    if "geometry" not in options.terms:
        return out
    harmonics = harmonic_table(lighting.environment)
    for b in range(len(cameras)):
        seen = (
            view(surface.position[b].reshape(-1, 3), np.float64),
            view(surface.normal[b].reshape(-1, 3), np.float32),
            view(surface.geometric_normal[b].reshape(-1, 3), np.float32),
            view(depth[b].reshape(-1), np.float32),
            view(surface.reference_depth[b].reshape(-1), np.float32),
            view(size[b].reshape(-1), np.float32),
        )
        eye = cameras.eye[b]
        lens = (
            view(eye, np.float64),
            view(surface.axes[b], np.float64),
            view(cameras.forward[b], np.float64),
            int(cameras.orthographic),
            options.grazing,
            int("projection" in options.terms),
        )
        visibility = np.zeros((0, 0), np.float32)
        if lighting.visibility is not None and len(lighting.lights):
            visibility = view(lighting.visibility[b].reshape(len(lighting.lights), -1), np.float32)
        covered = surface.covered[b]
        middle = float(surface.reference_depth[b][covered].median()) if bool(covered.any()) else 1.0
        light = (light_table(lighting.lights, eye), visibility, harmonics, NEAREST * middle)
        how = (_MAGNITUDES[options.magnitude], int(options.light_gradient))
        kernels.gradient_size(seen, lens, light, how, out[b].reshape(-1, 3).numpy())
    return out
