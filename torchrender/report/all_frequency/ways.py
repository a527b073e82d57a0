"""Other ways to the same light: sums over texels, all wavelets, spherical harmonics.

Source: specification 08, section 10.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import torch
from scipy.special import sph_harm_y
from torch import Tensor

from torchrender.effects.sky_shadows.light import SkyLight, cosines
from torchrender.numerics.wavelets.haar import Haar, transform, triple_product
from torchrender.rays import RayCaster
from torchrender.scene.sky.cube_map import solid_angles, texel_directions

SIDE, TEXELS = 32, 6 * 32 * 32
ORDER = 6
"""Bands of spherical harmonics: 36 functions."""

LEAST_EIGENVALUE = 0.02
PART = 256
"""Points at a time."""


def mesh_bits(caster: RayCaster, points: Tensor, normals: Tensor, offset: float) -> Tensor:
    """(P,6,32,32) bool: the mesh hides the texel's centre from points (P,3); not asked behind their surfaces."""
    directions = texel_directions(SIDE).reshape(-1, 3)
    out = torch.zeros(len(points), TEXELS, dtype=torch.bool)
    for first in range(0, len(points), PART):
        chosen = slice(first, first + PART)
        facing = normals[chosen].double() @ directions.T > 0
        row, texel = facing.nonzero().unbind(1)
        begin = points[chosen].double()[row] + offset * normals[chosen].double()[row]
        hit = caster.occluded(begin, directions[texel].contiguous(), t_max=torch.inf)
        out[first + row, texel] = hit
    return out.reshape(-1, 6, SIDE, SIDE)


def texel_sum(hidden: Tensor, normals: Tensor, light: SkyLight) -> Tensor:
    """(P,3) float64 what is left where ``hidden`` (P,6,32,32): the plain sum over all texels."""
    parts = []
    for bits, some in zip(hidden.split(PART), normals.split(PART)):
        weight = cosines(some).masked_fill(bits, 0.0).reshape(len(some), TEXELS)
        parts.append(weight @ light.texels.reshape(TEXELS, 3) / SIDE**2)
    return torch.cat(parts) if parts else torch.zeros(0, 3, dtype=torch.float64)


def wavelet_sum(hidden: Tensor, normals: Tensor, light: SkyLight) -> Tensor:
    """(P,3) float64 the same by all wavelets of light, visibility and cosine."""
    sky = light.haar
    parts = []
    for bits, some in zip(hidden.split(PART), normals.split(PART)):
        seen, facing = transform((~bits).double()), transform(cosines(some))
        channels = [triple_product(Haar(sky.means[c], sky.wavelets[c]), seen, facing).sum(-1) for c in range(3)]
        parts.append(torch.stack(channels, dim=-1))
    return torch.cat(parts)


@cache
def harmonics(order: int = ORDER) -> Tensor:
    """(6144,order^2) float64 real spherical harmonics at texel centres."""
    return harmonics_at(texel_directions(SIDE).reshape(-1, 3), order)


def best_harmonics(hidden: Tensor, normals: Tensor, light: SkyLight, order: int = ORDER) -> Tensor:
    """(P,3) visibility projected to spherical harmonics: the best that they can do."""
    basis, solid = harmonics(order), solid_angles(SIDE).expand(6, -1, -1).reshape(-1, 1)
    seen = (~hidden).reshape(len(hidden), TEXELS).double() @ (basis * solid)
    return _from_coefficients(seen, normals, light, order)


def exponentiated_harmonics(
    points: Tensor, normals: Tensor, spheres: Tensor, light: SkyLight, own: Tensor | None = None, order: int = ORDER
) -> Tensor:
    """(P,3) by logarithms of every sphere's visibility, summed and exponentiated (SHEXP).

    A sphere's visibility is a matrix M of products of basis functions; its logarithm, eigenvalues clamped from below,
    applied to the constant 1 gives coefficients that add up. For spheres about one axis M depends on their size alone;
    coefficients turn to the sphere's direction by the zonal rule.
    """
    basis, solid = harmonics(order), solid_angles(SIDE).expand(6, -1, -1).reshape(-1, 1)
    table = _zonal_logarithms(order)
    bands = torch.cat([torch.full((2 * band + 1,), band) for band in range(order)])
    scale = torch.sqrt(4 * math.pi / (2 * bands.double() + 1))
    one = torch.zeros(order * order, dtype=torch.float64)
    one[0] = math.sqrt(4 * math.pi)
    made = torch.zeros(len(points), order * order, dtype=torch.float64)
    for p in range(len(points)):
        towards = spheres[:, :3].double() - points[p].double()
        distance = towards.norm(dim=-1)
        size = spheres[:, 3].double() / distance
        unit = towards / distance[:, None]
        counts = (size < 1.0) & (unit @ normals[p].double() > -size)
        if own is not None and int(own[p]) >= 0:
            counts[int(own[p])] = False
        unit, size = unit[counts], size[counts]
        place = (size * (len(table) - 1)).round().long()
        zonal = table[place][:, bands]  # (S,N)
        logarithm = (zonal * scale * harmonics_at(unit, order)).sum(0)
        values = basis @ logarithm
        matrix = basis.T @ (basis * (values[:, None] * solid))
        eigenvalues, vectors = torch.linalg.eigh(0.5 * (matrix + matrix.T))
        made[p] = vectors @ (eigenvalues.exp() * (vectors.T @ one))
    return _from_coefficients(made, normals, light, order)


def harmonics_at(directions: Tensor, order: int) -> Tensor:
    """(N,order^2) real spherical harmonics at unit directions (N,3)."""
    d = directions.numpy()
    polar, azimuth = np.arccos(np.clip(d[:, 2], -1, 1)), np.arctan2(d[:, 1], d[:, 0])
    columns = []
    for band in range(order):
        for m in range(-band, band + 1):
            value = sph_harm_y(band, abs(m), polar, azimuth)
            columns.append(value.real if m == 0 else math.sqrt(2) * (value.imag if m < 0 else value.real))
    return torch.from_numpy(np.stack(columns, axis=1).reshape(len(d), order * order))


@cache
def _zonal_logarithms(order: int, sizes: int = 65) -> Tensor:
    """(sizes,order) coefficients by band of log(M) 1 for caps about +z, of relative radius 0 to 1."""
    basis, solid = harmonics(order), solid_angles(SIDE).expand(6, -1, -1).reshape(-1, 1)
    height = texel_directions(SIDE).reshape(-1, 3)[:, 2:]
    one = torch.zeros(order * order, dtype=torch.float64)
    one[0] = math.sqrt(4 * math.pi)
    zonal = [band * band + band for band in range(order)]
    rows = []
    for k in range(sizes):
        size = k / (sizes - 1)
        seen = (height < math.sqrt(1.0 - size * size)).double()
        matrix = basis.T @ (basis * seen * solid)
        eigenvalues, vectors = torch.linalg.eigh(0.5 * (matrix + matrix.T))
        logarithm = vectors @ (eigenvalues.clamp_min(LEAST_EIGENVALUE).log() * (vectors.T @ one))
        rows.append(logarithm[zonal])
    made = torch.stack(rows)
    made[0] = 0.0
    return made


def _from_coefficients(seen: Tensor, normals: Tensor, light: SkyLight, order: int) -> Tensor:
    values = seen @ harmonics(order).T  # (P,6144)
    parts = []
    for some, value in zip(normals.split(PART), values.split(PART)):
        weight = cosines(some).reshape(len(some), TEXELS) * value
        parts.append(weight @ light.texels.reshape(TEXELS, 3) / SIDE**2)
    return torch.cat(parts)
