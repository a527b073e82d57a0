"""Light from all around, prepared for shadows: a cube map of 32 x 32 texels, and its wavelets.

Source: specification 08, sections 3 and 8.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_finite, check_tensor, options_of
from torchrender.effects.sky_shadows.options import SkyLightOptions
from torchrender.errors import InputError
from torchrender.kernels.sky_shadows.light import Light
from torchrender.kernels.sky_shadows.resample import texel_means, weigh_blocks
from torchrender.numerics.wavelets.haar import Haar, first, inverse, square_levels, transform
from torchrender.scene.environment import Environment
from torchrender.scene.sky.cube_map import face_directions, node_directions, solid_angles, texel_directions

SIDE, BLOCK_SIDE = 32, 8
FINEST = 512
"""Rows of a picture of the sky from which on it is averaged first."""
FEW, MANY = 4, 8
"""Places in a texel, per side, where the sky is looked up: few where a texel is no more than a few pixels of it."""
NORMALS_AT_ONCE = 64
"""Stored normals whose truncated cosines are multiplied with the light at a time: 10 MB each step."""


@dataclass(frozen=True, eq=False)
class SkyLight:
    """Light prepared by :func:`prepare_light`."""

    texels: (
        Tensor  # (6,32,32,3) float64 radiance times solid angle times 32^2: the mean of what it meets is an integral
    )
    options: SkyLightOptions
    kept: (
        Tensor  # (T,4) int64 wavelets that are kept: face, square, kind, and whether it is one of the two finest levels
    )
    record: Light  # what the kernel reads

    @property
    def haar(self) -> Haar:
        """Of the texels: means (3,6,341), wavelets (3,6,341,3)."""
        return transform(self.texels.permute(3, 0, 1, 2))


def cube_radiance(environment: Environment) -> Tensor:
    """Mean radiance (6,32,32,3) float64 of an environment over the texels of a cube map."""
    picture = environment.radiance.detach()
    step = max(1, -(-picture.shape[0] // FINEST))
    if step > 1:
        planes = picture.permute(2, 0, 1)[None]
        picture = torch.nn.functional.avg_pool2d(planes, step, ceil_mode=True)[0].permute(1, 2, 0)
    azimuth, height = _places(FEW if picture.shape[0] <= 8 * SIDE else MANY)
    out = np.empty((6 * SIDE * SIDE, 3))
    turn = environment.rotation_deg / 360.0
    texel_means(picture.contiguous().numpy(), azimuth, height, turn % 1.0, out)
    return torch.from_numpy(out).reshape(6, SIDE, SIDE, 3) * environment.intensity


@cache
def _places(taken: int) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """(6144,K) azimuth in turns and height of places in every texel, ``taken`` to its side."""
    fine = SIDE * taken
    line = 2.0 * (torch.arange(fine, dtype=torch.float64) + 0.5) / fine - 1.0
    v, u = torch.meshgrid(line, line, indexing="ij")
    d = torch.nn.functional.normalize(face_directions(u, v), dim=-1)
    azimuth = torch.atan2(d[..., 0], -d[..., 2]) / (2 * math.pi)
    height = torch.acos(d[..., 1].clamp(-1.0, 1.0)) / math.pi

    def grouped(value: Tensor) -> np.ndarray[Any, Any]:
        parts = value.reshape(6, SIDE, taken, SIDE, taken).transpose(2, 3).reshape(-1, taken * taken)
        return parts.float().contiguous().numpy()

    return grouped(azimuth), grouped(height)


def prepare_light(sky: Environment | Tensor, options: SkyLightOptions | None = None) -> SkyLight:
    """Prepare an environment, or radiance (6,32,32,3) of a cube map in world axes, for :func:`shade`.

    Raises:
        InputError: radiance of another shape, negative, or not finite.
    """
    options = options_of(options, SkyLightOptions)
    radiance = cube_radiance(sky) if isinstance(sky, Environment) else sky.detach().double()
    check_tensor("radiance", radiance, (6, SIDE, SIDE, 3))
    check_finite("radiance", radiance)
    if bool((radiance < 0).any()):
        raise InputError("radiance must not be negative")
    texels = radiance * (solid_angles(SIDE) * SIDE**2)[None, :, :, None]
    wavelets = transform(texels.permute(3, 0, 1, 2)).wavelets
    kept = _largest(wavelets, options.terms, options.ranking)
    return SkyLight(texels, options, kept, _record(texels, wavelets, kept, options))


def _largest(wavelets: Tensor, terms: int, ranking: str) -> Tensor:
    """The largest wavelets (C,6,N,3) over all channels: (T,4) face, square, kind, is fine; none that is zero."""
    level = square_levels(5)
    flat = _sizes(wavelets.square().sum(0), ranking).reshape(-1)
    best = flat.topk(min(terms, flat.numel())).indices
    best = best[flat[best] > 0].sort().values
    face, square, kind = best // (341 * 3), best // 3 % 341, best % 3
    return torch.stack([face, square, kind, (level[square] >= 3).long()], dim=1)


def _sizes(squares: Tensor, ranking: str) -> Tensor:
    """What wavelets are ranked by, of their squares (...,6,N,3)."""
    if ranking != "area":
        return squares
    return squares * torch.pow(0.25, square_levels(5).double())[:, None]


def _largest_of_each(wavelets: Tensor, terms: int, ranking: str) -> Tensor:
    """(n,6,N,3) float64: one where a wavelet is among the largest of its image, zero elsewhere."""
    flat = _sizes(wavelets.square(), ranking).reshape(len(wavelets), -1)
    best = flat.topk(min(terms, flat.shape[1])).indices
    return torch.zeros_like(flat).scatter_(1, best, 1.0).reshape(wavelets.shape)


@cache
def stored_normals(cells: int, blend: bool) -> Tensor:
    """(N,3) float64: corners of C x C cells of every face, or the middles of 8 x 8 for the nearest one."""
    made = node_directions(cells) if blend else texel_directions(cells)
    return made.reshape(-1, 3)


def cosines(normals: Tensor) -> Tensor:
    """(N,6,32,32) float64: cosine over pi, zero behind, at texel centres; scaled so that its integral is one.

    Texels that the horizon cuts make it differ from one by up to 3e-4.
    """
    flat = texel_directions(SIDE).reshape(-1, 3)
    cosine = (normals.double() @ flat.T).clamp_min(0.0)
    whole = cosine @ solid_angles(SIDE).expand(6, -1, -1).reshape(-1, 1)
    return (cosine / whole.clamp_min(1e-300)).reshape(-1, 6, SIDE, SIDE)


class _Facing:
    """What does not depend on the light: cosines of the stored normals, by blocks of texels and by squares."""

    def __init__(self, cells: int, blend: bool) -> None:
        images = cosines(stored_normals(cells, blend))
        self.images = images
        blocks = images.reshape(-1, 6, 8, 4, 8, 4).transpose(3, 4).reshape(len(images), 384, 16)
        self.blocks = blocks.float().contiguous()  # (N,384,16)
        even = solid_angles(SIDE).expand(6, -1, -1).reshape(6, 8, 4, 8, 4).transpose(2, 3)
        self.even = (even.reshape(384, 16, 1) / 16.0).float()  # light of radiance one
        self.haar = transform(images)
        self.means = self.haar.means.float()


@cache
def _facing(cells: int, blend: bool) -> _Facing:
    with torch.inference_mode(False), torch.no_grad():
        return _Facing(cells, blend)


def _record(texels: Tensor, wavelets: Tensor, kept: Tensor, options: SkyLightOptions) -> Light:
    blend = options.blend == "blend"
    facing = _facing(options.normals, blend)
    light = texels.reshape(6, 8, 4, 8, 4, 3).transpose(2, 3).reshape(384, 16, 3) / (16.0 * SIDE**2)
    block = torch.zeros(len(facing.blocks), 384, 4)
    weighed = torch.cat([light.float(), facing.even], dim=2).contiguous()
    weigh_blocks(facing.blocks.numpy(), weighed.numpy(), block.numpy())
    if options.cosine_terms is not None:
        block[..., :3] = _truncated(texels, kept, facing, options).float() / 16.0
    fine = kept[kept[:, 3] == 1] if options.levels == 2 else kept[:0]
    face, square, kind = fine[:, 0], fine[:, 1], fine[:, 2]
    number, column = _fine_places(square, kind)
    number = face * 64 + number
    order = number.argsort(stable=True)
    value = wavelets[:, face, square, kind].T[order]
    mean = facing.means.reshape(len(block), -1)[:, (face * facing.means.shape[2] + square)[order]]
    start = torch.searchsorted(number[order].contiguous(), torch.arange(385))
    return Light(
        whole=(16.0 * block.sum(1)).numpy(),
        block=block.numpy(),
        mean=mean.contiguous().numpy(),
        value=torch.nn.functional.pad(value, (0, 1)).float().contiguous().numpy(),
        column=column[order].int().contiguous().numpy(),
        start=start.int().numpy(),
        cells=options.normals if blend else -options.normals,
    )


def _fine_places(square: Tensor, kind: Tensor) -> tuple[Tensor, Tensor]:
    """Block of its face, and column in the table of codes, of wavelets of the two finest levels."""
    middle = square < first(4)
    inner = torch.where(middle, square - first(3), square - first(4))
    row, column = inner // 16, inner % 16
    block = torch.where(middle, inner, row // 2 * 8 + column // 2)
    quarter = row % 2 * 2 + column % 2
    return block, torch.where(middle, 1 + kind, 4 + 3 * quarter + kind)


def _truncated(texels: Tensor, kept: Tensor, facing: _Facing, options: SkyLightOptions) -> Tensor:
    """(N,384,3) weights of blocks where the cosine is truncated, too: section 8 of the specification to the letter.

    All is linear in visibility, of which these sums know means of blocks only. The sum over the cosine's wavelets is
    the product of light and truncated cosine, less what pairs of the same wavelet of light and visibility add: of these
    only the kept ones count, with the whole cosine's mean.
    """
    assert options.cosine_terms is not None
    light = transform(texels.permute(3, 0, 1, 2))
    chosen = torch.zeros(6, 341, 3, dtype=torch.bool)
    chosen[kept[:, 0], kept[:, 1], kept[:, 2]] = True
    coarse = first(3)
    made = torch.zeros(len(facing.images), 384, 3, dtype=torch.float64)
    for part in torch.arange(len(made)).split(NORMALS_AT_ONCE):
        wavelets, means = facing.haar.wavelets[part], facing.haar.means[part]
        mask = _largest_of_each(wavelets, options.cosine_terms, options.ranking)
        image = inverse(means[..., 0], wavelets * mask)
        known = transform(image).means[:, None, :, :coarse, None]  # (n,1,6,21,1)
        whole = means[:, None, :, :coarse, None]
        pairs = light.wavelets[:, :, :coarse] * (torch.where(chosen[:, :coarse], whole, 0.0) - known)
        product = (image[..., None] * texels).reshape(-1, 6, 8, 4, 8, 4, 3).mean((3, 5))
        change = inverse(torch.zeros(len(part), 3, 6, dtype=torch.float64), pairs).permute(0, 2, 3, 4, 1)
        made[part] = ((product + change) / 64.0).reshape(len(part), 384, 3)
    return made
