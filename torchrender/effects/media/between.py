"""Sampling in the picture: some rays are integrated, the others lie between these.

Source: specification 09, section 4.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.media.eye_rays import EyeRays
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import MediaTable
from torchrender.kernels.media.blocks import (
    LSQ,
    NEAREST,
    NONE,
    fill_between,
    find_gradients,
    mark_blocks,
    mark_doubtful,
)
from torchrender.kernels.media.records import HEIGHT, Scattered

DEEP = 4.0
"""Times a ray may climb the way in which density falls to a part of 1/e, for the density at its middle to stand for
that along it."""
GRADIENTS = {"lsq": LSQ, "nearest": NEAREST, "none": NONE}
Integrate = Callable[[np.ndarray, Scattered], None]
"""Fills rows of what becomes of rays."""


@dataclass(frozen=True, eq=False)
class Guard:
    """Where a lamp is in the picture; all pixels around it are integrated."""

    column: float
    row: float
    radius: float

    @classmethod
    def of(cls, place: Tensor | None, rays: EyeRays, radius: float) -> Guard:
        """Around a place (3,) relative to the eye; None, or one behind the eye, for nowhere."""
        if place is None or radius <= 0 or rays.camera is None:
            return NOWHERE
        camera = rays.camera[0]
        uv, z = camera.project((place.double() + camera.eye[0])[None])
        near = float(z[0, 0]) > 0 or camera.orthographic
        return cls(float(uv[0, 0, 0]), float(uv[0, 0, 1]), float(radius)) if near else NOWHERE


NOWHERE = Guard(0.0, 0.0, 0.0)


def normaliser(rays: EyeRays, table: MediaTable, ways: Tensor, options: ScatterOptions) -> Tensor:
    """(H,W) what scattered light is divided by before it is interpolated.

    The length of the way; in a medium that falls off with height, the density at the middle of the way times that
    (specification 09, section 4). "effective", and where rays climb many of its layers, so that the middle says nothing
    of the way: the length of a way through as much of the medium along which nothing would be lost,
    ``(1 - exp(-tau)) / extinction``.

    Args:
        ways: (H W,M) integrals of the densities.
    """
    length = rays.length
    arrays = table.arrays

    def effective() -> Tensor:
        tau = (ways @ table.extinction.mean(dim=1)).reshape(rays.shape)
        return torch.where(length > 0, -torch.expm1(-tau), 0.0)

    if options.normal == "effective":
        return effective()
    if len(table) == 1 and int(arrays.kind[0]) == HEIGHT:
        direction = torch.from_numpy(rays.beams.direction)[:, 1].reshape(rays.shape)
        span = torch.from_numpy(rays.beams.span).reshape(*rays.shape, 2)
        _, falloff, ground, _ = (float(v) for v in arrays.numbers[0])
        if falloff * float((direction * length).abs().max()) > DEEP:
            return effective()
        height = direction * span.mean(dim=-1).clamp_max(1e15) - ground
        return length * torch.exp((-falloff * height).clamp(-60.0, 60.0))
    return length


def every_ray(integrate: Integrate, rays: EyeRays, channels: int) -> np.ndarray:
    """Radiance (H W,C) of rays that are all integrated."""
    count = len(rays.beams.direction)
    out = Scattered(np.empty((count, channels), np.float32), np.empty((count, 3), np.float32))
    integrate(np.arange(count), out)
    return out.radiance


def between(
    integrate: Integrate, rays: EyeRays, norm: Tensor, guard: Guard, channels: int, options: ScatterOptions
) -> tuple[np.ndarray, np.ndarray]:
    """Radiance (H W,C) of all rays, and which of them were integrated (H,W) bool.

    Args:
        integrate: told rows of rays, fills those of what becomes of them.
        norm: from :func:`normaliser`.
    """
    block, (height, width) = options.block, rays.shape
    if block == 1:
        return every_ray(integrate, rays, channels), np.ones(rays.shape, bool)
    count = height * width
    out = Scattered(np.empty((count, channels), np.float32), np.zeros((count, 3), np.float32))
    length, divisor = view(rays.length, np.float32), view(norm, np.float32)
    cells = (-(-height // block), -(-width // block))
    samples, marked, more = np.empty((*cells, 2), np.int32), np.empty(rays.shape, bool), np.empty(rays.shape, bool)
    around = np.array([guard.column, guard.row, guard.radius], np.float32)
    eps = np.float32(options.eps_rel)
    limits = (block, eps, np.float32(options.share_tolerance))
    mark_blocks(length, block, eps, around, options.seed, marked, samples)
    marked |= (divisor < 1e-8) & (length > 0)
    integrate(np.flatnonzero(marked), out)
    mark_doubtful(length, marked, samples, out.told, limits, more)
    rest = np.flatnonzero(more)
    if len(rest):
        integrate(rest, out)
        marked |= more
    found = np.empty((*cells, 3, channels), np.float32)
    find_gradients(length, divisor, samples, out.told, limits, GRADIENTS[options.gradient], out.radiance, found)
    fill_between(length, divisor, marked, samples, limits, found, out.radiance)
    return out.radiance, marked
