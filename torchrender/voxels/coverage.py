"""What a texture and the opacity of a material say at points on a surface: colour, and how much of it is there."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.numerics.ggx import refraction
from torchrender.numerics.split_sum import dielectric_albedo
from torchrender.numerics.texture import build_pyramid, channels_of, color_pyramid, sample_texture
from torchrender.scene.material import Material, Sampler
from torchrender.scene.mesh import Geometry
from torchrender.scene.model import Scene


def surface_uv(geometry: Geometry, sampler: Sampler, triangle: Tensor, weights: Tensor) -> Tensor | None:
    """(N,2) float64 texture coordinates of points on triangles (N,) with corner weights (N,3), as a sampler reads them.

    None where the geometry has not the set that the sampler asks for.
    """
    values = geometry.uv if sampler.uv_set == 0 else geometry.uv1
    if values is None:
        return None
    corners = values[geometry.faces[triangle].long()].double()
    return placed_uv((weights.double()[:, :, None] * corners).sum(dim=1), sampler)


def placed_uv(uv: Tensor, sampler: Sampler) -> Tensor:
    """Coordinates (N,2) after a sampler's transform, wrapped as it says; what repeats is left as it is."""
    transform = sampler.transform.to(uv.dtype)
    moved = uv @ transform[:, :2].T + transform[:, 2]
    columns = []
    for k, wrap in enumerate((sampler.wrap_u, sampler.wrap_v)):
        value = moved[:, k]
        if wrap == "clamp":
            # The last texel's value goes on; its centre lies half a texel inside, which a look-up that repeats needs.
            value = value.clamp(1e-6, 1.0 - 1e-6)
        elif wrap == "mirror":
            value = 1.0 - (value % 2.0 - 1.0).abs()
        columns.append(value)
    return torch.stack(columns, dim=1)


def uv_per_unit(geometry: Geometry, sampler: Sampler, triangle: Tensor) -> Tensor:
    """(N,) texture lengths per scene unit: the square root of the ratio of areas."""
    values = geometry.uv if sampler.uv_set == 0 else geometry.uv1
    assert values is not None
    faces = geometry.faces[triangle].long()
    a = values[faces].double() @ sampler.transform[:, :2].double().T
    b = geometry.vertices[faces].double()
    u, v = a[:, 1] - a[:, 0], a[:, 2] - a[:, 0]
    flat = (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).abs()
    area = torch.linalg.cross(b[:, 1] - b[:, 0], b[:, 2] - b[:, 0]).norm(dim=1)
    return (flat / area.clamp_min(1e-300)).sqrt()


def surface_colors(scene: Scene, triangle: Tensor, weights: Tensor, spacing: float) -> Tensor:
    """(N,3) float64 diffuse reflectance; textures are filtered to ``spacing``, scene units."""
    geometry = scene.geometry
    material = geometry.material[triangle]
    color = scene.material_table.diffuse[material].double()
    if geometry.colors is not None:
        corners = geometry.colors[geometry.faces[triangle].long()].double()
        color = color * (weights.double()[:, :, None] * corners).sum(dim=1)
    for number in torch.unique(material).tolist():
        one = scene.materials[number]
        sampler = one.sampler("diffuse_texture")
        rows = (material == number).nonzero().reshape(-1)
        uv = surface_uv(geometry, sampler, triangle[rows], weights[rows])
        if one.diffuse_texture is None or uv is None:
            continue
        footprint = uv_per_unit(geometry, sampler, triangle[rows]) * spacing
        color[rows] *= sample_texture(color_pyramid(one.diffuse_texture), uv, footprint)[..., :3]
    return color


def surface_alpha(scene: Scene, triangle: Tensor, weights: Tensor, spacing: float) -> Tensor | None:
    """(N,) float64 share of the surface that is there around points on it, in [0,1]; None where all of it is.

    Of a material with holes the share that is solid within ``spacing`` scene units, of one that blends its opacity,
    of a thin wall what it keeps of light that comes straight at it, mean over the colours.
    """
    if all(m.alpha_cutoff is None and not m.is_see_through for m in scene.materials):
        return None
    geometry = scene.geometry
    material = geometry.material[triangle]
    alpha = torch.ones(len(triangle), dtype=torch.float64)
    for number in torch.unique(material).tolist():
        one = scene.materials[number]
        if one.alpha_cutoff is None and not one.is_see_through:
            continue
        rows = (material == number).nonzero().reshape(-1)
        part = triangle[rows], weights[rows]
        if one.alpha_cutoff is not None or one.blend:
            alpha[rows] = _alpha_of(geometry, one, *part, spacing)
        if one.transmission > 0.0 and not one.unlit:
            passing = _passing(geometry, one, *part, spacing) * surface_colors(scene, *part, spacing).mean(dim=1)
            alpha[rows] *= 1.0 - passing.clamp(0.0, 1.0)
    return alpha


def _passing(geometry: Geometry, material: Material, triangle: Tensor, weights: Tensor, spacing: float) -> Tensor:
    """(N,) share of light that a white thin wall of the material would let pass, straight through."""
    bent = torch.tensor([material.specular_weight, *refraction(float(material.ior)).excess])
    along = torch.as_tensor(material.f0 * material.specular_color.max())
    mirrored = float(dielectric_albedo(along, bent, torch.tensor(1.0), torch.tensor(material.roughness)))
    share = material.transmission * (1.0 - (material.metallic or 0.0)) * (1.0 - mirrored)
    sampler, texture = material.sampler("transmission_texture"), material.transmission_texture
    uv = None if texture is None else surface_uv(geometry, sampler, triangle, weights)
    if texture is None or uv is None:
        return torch.full((len(triangle),), share, dtype=torch.float64)
    footprint = uv_per_unit(geometry, sampler, triangle) * spacing
    return share * sample_texture(build_pyramid(channels_of(texture, 0, 1)), uv, footprint)[:, 0].double()


def _alpha_of(geometry: Geometry, material: Material, triangle: Tensor, weights: Tensor, spacing: float) -> Tensor:
    own = torch.full((len(triangle),), float(material.opacity), dtype=torch.float64)
    if geometry.alpha is not None:
        corners = geometry.alpha[geometry.faces[triangle].long()].double()
        own = own * (weights.double() * corners).sum(dim=1)
    cutoff, texture = material.alpha_cutoff, material.diffuse_texture
    sampler = material.sampler("diffuse_texture")
    uv = surface_uv(geometry, sampler, triangle, weights)
    if texture is None or texture.shape[2] != 4 or uv is None:
        return own if cutoff is None else (own >= cutoff).double()
    values = channels_of(texture, 3, 4).float()
    if cutoff is not None:
        # The opacity beside the texture moves the limit that its texels are held against.
        factor = float(own.mean()) if len(own) else 1.0
        values = (values * factor >= cutoff).float()
    footprint = uv_per_unit(geometry, sampler, triangle) * spacing
    found = sample_texture(build_pyramid(values), uv, footprint)[:, 0].double()
    return found if cutoff is not None else own * found
