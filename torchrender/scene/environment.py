"""Light from infinitely far away: a latitude-longitude picture or one colour.

Latitude-longitude convention: row 0 is the zenith (+y), the last row the nadir; the middle column looks along -z and
columns grow to the right seen from inside (+x a quarter further), as light probes are published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_finite
from torchrender.errors import InputError


@dataclass(frozen=True, eq=False, kw_only=True)
class Environment:
    """Radiance by direction.

    Raises:
        InputError: the picture is not a finite, non-negative (H,W,3) tensor.
    """

    radiance: Tensor  # (H,W,3) float32 linear
    intensity: float = 1.0  # multiplies the radiance
    rotation_deg: float = 0.0  # turns the picture about +y
    name: str = "environment"

    def __post_init__(self) -> None:
        value = self.radiance
        if value.dim() != 3 or value.shape[2] != 3 or value.numel() == 0:
            raise InputError(f"environment {self.name!r}: radiance must have shape (H, W, 3), got {tuple(value.shape)}")
        check_finite(f"environment {self.name!r}: radiance", value)
        if bool((value < 0).any()):
            raise InputError(f"environment {self.name!r}: radiance must not be negative")

    @classmethod
    def constant(cls, color: Tensor) -> Environment:
        """The same radiance (3,) from everywhere."""
        return cls(radiance=color.float().reshape(1, 1, 3), name="constant")

    @classmethod
    def from_cube(cls, faces: Tensor, *, height: int = 256) -> Environment:
        """From six square faces (6,N,N,3) in the order +x, -x, +y, -y, +z, -z (OpenGL cube-map orientation)."""
        if faces.dim() != 4 or faces.shape[0] != 6 or faces.shape[1] != faces.shape[2] or faces.shape[3] != 3:
            raise InputError(f"faces must have shape (6, N, N, 3), got {tuple(faces.shape)}")
        d = latlong_directions(height, 2 * height)
        axis = d.abs().argmax(dim=-1)
        major = d.gather(-1, axis[..., None])[..., 0]
        face = 2 * axis + (major < 0).long()
        x, y, z = d.unbind(-1)
        sign = major.sign()
        s = torch.where(axis == 0, -sign * z, torch.where(axis == 1, x, sign * x)) / major.abs()
        t = torch.where(axis == 1, sign * z, -y) / major.abs()
        n = faces.shape[1]
        column, row = ((((v + 1) / 2) * n).long().clamp(0, n - 1) for v in (s, t))
        return cls(radiance=faces[face, row, column].float(), name="cube")

    def lookup(self, directions: Tensor) -> Tensor:
        """Radiance (...,3) for unit world directions (...,3): bilinear, periodic in azimuth, clamped at the poles."""
        height, width, _ = self.radiance.shape
        d = directions.to(self.radiance.dtype)
        azimuth = torch.atan2(d[..., 0], -d[..., 2]) + math.radians(self.rotation_deg)
        column = (azimuth / (2 * math.pi) + 0.5) * width - 0.5
        row = torch.acos(d[..., 1].clamp(-1.0, 1.0)) / math.pi * height - 0.5
        left, top = column.floor(), row.floor()
        a, b = (column - left)[..., None], (row - top)[..., None]
        i0 = left.long() % width
        i1 = (i0 + 1) % width
        j0 = top.long().clamp(0, height - 1)
        j1 = (top.long() + 1).clamp(0, height - 1)
        upper = torch.lerp(self.radiance[j0, i0], self.radiance[j0, i1], a)
        lower = torch.lerp(self.radiance[j1, i0], self.radiance[j1, i1], a)
        return torch.lerp(upper, lower, b) * self.intensity

    def irradiance(self, normals: Tensor) -> Tensor:
        """Cosine-weighted integral (...,3) over the hemisphere about each unit normal (...,3).

        From second-order spherical harmonics (Ramamoorthi and Hanrahan 2001): about 1 % for smooth environments.
        """
        c = self._harmonics.to(normals.dtype)
        basis = harmonics_2(normals)
        band = torch.tensor([math.pi] + [2 * math.pi / 3] * 3 + [math.pi / 4] * 5, dtype=normals.dtype)
        return ((basis * band) @ c).clamp_min(0.0) * self.intensity

    @property
    def _harmonics(self) -> Tensor:
        cached = self.__dict__.get("_sh")
        if cached is None:
            height, width = max(self.radiance.shape[0], 32), max(self.radiance.shape[1], 64)
            d = latlong_directions(height, width)
            value = self.lookup(d).double() / max(self.intensity, 1e-30)
            polar = (torch.arange(height, dtype=torch.float64) + 0.5) * math.pi / height
            weight = torch.sin(polar)[:, None] * (math.pi / height) * (2 * math.pi / width)
            cached = torch.einsum("hwk,hwc,hw->kc", harmonics_2(d.double()), value, weight.expand(height, width))
            object.__setattr__(self, "_sh", cached)
        return cached


def latlong_directions(height: int, width: int) -> Tensor:
    """(H,W,3) unit world directions of the pixel centres of a latitude-longitude picture."""
    polar = (torch.arange(height) + 0.5) * math.pi / height
    azimuth = ((torch.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
    sine = torch.sin(polar)[:, None]
    x, z = sine * torch.sin(azimuth), -sine * torch.cos(azimuth)
    return torch.stack([x, torch.cos(polar)[:, None].expand(height, width), z], dim=-1)


def harmonics_2(d: Tensor) -> Tensor:
    """The nine real spherical harmonics up to band 2 (...,9) of unit directions (...,3)."""
    x, y, z = d.unbind(-1)
    one = torch.ones_like(x)
    return torch.stack(
        [
            0.282095 * one,
            0.488603 * y,
            0.488603 * z,
            0.488603 * x,
            1.092548 * x * y,
            1.092548 * y * z,
            0.315392 * (3 * z * z - 1),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ],
        dim=-1,
    )
