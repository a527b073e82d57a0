"""Light from infinitely far away: a latitude-longitude picture or one colour.

Latitude-longitude convention: row 0 is the zenith (+y), the last row the nadir; the middle column looks along -z and
columns grow to the right seen from inside (+x a quarter further), as light probes are published.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import ArrayLike, as_vector, check_finite, check_no_gradient, check_picture, check_range
from torchrender.errors import InputError
from torchrender.images.files import as_texture, read_image
from torchrender.scene.light import DirectionalLight
from torchrender.scene.sky.irradiance import BLOCK_ROWS, IrradianceMap, latlong_directions, solid_angles
from torchrender.scene.sky.prefilter import FilteredSky
from torchrender.scene.sky.sun import find_sun, turned

LARGEST = 1e30
"""Radiance that float32 can still add up all around."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Environment:
    """Light from infinitely far away, by direction: ``Scene(environment=Environment.load("studio.hdr"))``.

    Row 0 of the picture is the zenith (+y), the last row the nadir; the middle column looks along -z, columns grow to
    the right seen from inside. :meth:`load` reads a file, :meth:`constant` makes one colour, :meth:`from_cube` takes
    the faces of a cube map; arrays of NumPy are taken as tensors.

    Raises:
        InputError: the picture is not a finite, non-negative float tensor (H,W,3), or too bright for float32.
        OptionError: an intensity or a rotation that is not finite.
    """

    radiance: Tensor  # (H,W,3) linear; kept as float32
    intensity: float = 1.0  # multiplies the radiance
    rotation_deg: float = 0.0  # turns the picture about +y
    name: str = "environment"
    fill: bool = False  # stands for light that finds its way: only what is near hides it, not a roof far above
    shown: Tensor | None = None  # (H,W,3) what cameras see of it, where that is not ``radiance``: with the sun

    __repr__ = brief

    def __post_init__(self) -> None:
        object.__setattr__(self, "radiance", self._checked("radiance", self.radiance))
        if self.shown is not None:
            object.__setattr__(self, "shown", self._checked("shown", self.shown))
        told = f"environment {self.name!r}"
        check_no_gradient("an environment", intensity=self.intensity, rotation_deg=self.rotation_deg)
        check_range(f"{told}: intensity", self.intensity, 0.0, LARGEST)
        check_range(f"{told}: rotation_deg", self.rotation_deg, -LARGEST, LARGEST)
        if float(self.radiance.detach().amax()) * self.intensity > LARGEST:
            raise InputError(f"{told}: radiance times intensity must be at most {LARGEST:g}")

    def _checked(self, name: str, value: object) -> Tensor:
        told = f"environment {self.name!r}: {name}"
        if isinstance(value, str | Path):
            raise InputError(f"{told} must be a picture, for a file take Environment.load({str(value)!r})")
        value = check_picture(told, value, (3,)).float()
        check_finite(told, value)
        if bool((value < 0).any()):
            raise InputError(f"{told} must not be negative")
        return value

    @classmethod
    def load(cls, path: str | Path, *, intensity: float = 1.0, rotation_deg: float = 0.0) -> Environment:
        """From a latitude-longitude picture: Radiance HDR or OpenEXR, or one of 8 bits, which ends at white.

        Raises:
            ImageFileError: missing, damaged, or of an unsupported kind.
        """
        path = Path(path)
        radiance = sky_of(read_image(path))
        return cls(radiance=radiance, intensity=intensity, rotation_deg=rotation_deg, name=path.stem)

    @classmethod
    def constant(cls, color: ArrayLike) -> Environment:
        """The same radiance (3,), or one number for all colours, from everywhere."""
        return cls(radiance=as_vector("color", color).reshape(1, 1, 3), name="constant")

    @classmethod
    def from_cube(cls, faces: Tensor, *, height: int = 256) -> Environment:
        """From six square faces (6,N,N,3) in the order +x, -x, +y, -y, +z, -z (OpenGL cube-map orientation)."""
        if faces.dim() != 4 or faces.shape[0] != 6 or faces.shape[1] != faces.shape[2] or faces.shape[3] != 3:
            raise InputError(f"faces must have shape (6, N, N, 3), got {tuple(faces.shape)}")
        picture = faces.reshape(-1, 3).float()[_cube_texels(height, faces.shape[1])]
        return cls(radiance=picture.reshape(height, 2 * height, 3), name="cube")

    def lookup(self, directions: Tensor) -> Tensor:
        """Radiance (...,3) for unit world directions (...,3): bilinear, periodic in azimuth, clamped at the poles."""
        return self._look_up(self.radiance, directions)

    def background(self, directions: Tensor) -> Tensor:
        """As :meth:`lookup`, with the sun that :meth:`split_sun` took out of the light: what cameras see."""
        return self._look_up(self.radiance if self.shown is None else self.shown, directions)

    def _look_up(self, picture: Tensor, directions: Tensor) -> Tensor:
        height, width, _ = picture.shape
        d = directions.to(picture.dtype)
        azimuth = torch.atan2(d[..., 0], -d[..., 2]) + math.radians(self.rotation_deg)
        column = (azimuth / (2 * math.pi) + 0.5) * width - 0.5
        row = torch.acos(d[..., 1].clamp(-1.0, 1.0)) / math.pi * height - 0.5
        left, top = column.floor(), row.floor()
        a, b = (column - left)[..., None], (row - top)[..., None]
        i0 = left.long() % width
        i1 = (i0 + 1) % width
        j0 = top.long().clamp(0, height - 1)
        j1 = (top.long() + 1).clamp(0, height - 1)
        upper = torch.lerp(picture[j0, i0], picture[j0, i1], a)
        lower = torch.lerp(picture[j1, i0], picture[j1, i1], a)
        return torch.lerp(upper, lower, b) * self.intensity

    def irradiance(self, normals: Tensor) -> Tensor:
        """Cosine-weighted integral (...,3) over the hemisphere about each unit normal (...,3).

        Within 1 % of the integral, however small and bright its lamps are (:mod:`torchrender.scene.sky.irradiance`).
        The integral is made on first use and kept. Differentiable in normals and radiance.
        """
        return self.irradiance_map(turned(normals.float(), self.rotation_deg)).to(normals.dtype) * self.intensity

    def prefiltered(self, directions: Tensor, roughness: Tensor) -> Tensor:
        """Radiance (...,3) that a mirror of roughness (...), the square root of the GGX alpha, shows.

        Args:
            directions: (...,3) unit, mirrored at the normal.
            roughness: (...) broadcast against them, clamped to [0,1]; 0 is :meth:`lookup`.

        The lobe is that of a surface seen along its normal, as the split-sum approximation has it; what it mirrors in
        all is :func:`torchrender.numerics.split_sum.directional_albedo`. Made on first use and kept. Differentiable in
        directions and roughness.

        Raises:
            InputError: the radiance wants a gradient, which filtering does not give.
        """
        if self.radiance.requires_grad and torch.is_grad_enabled():
            raise InputError(f"environment {self.name!r}: radiance: filtering by roughness gives it no gradient")
        roughness = roughness.float().expand(directions.shape[:-1])
        sharp = self.lookup(directions)
        towards = turned(directions.float(), self.rotation_deg)
        return self.filtered(towards, roughness, sharp / max(self.intensity, 1e-30)) * self.intensity

    def split_sun(self) -> tuple[Environment, DirectionalLight | None]:
        """The environment without its sun, and the sun as a light that casts shadows; itself and None without one.

        A small place that gives a good part of all light is a sun, also a lamp in a photograph of a room. No light is
        lost: on a surface that faces it, the light brings what was taken out. :meth:`background` still shows it.
        """
        return self._split

    @cached_property
    def _split(self) -> tuple[Environment, DirectionalLight | None]:
        sun = None if self.shown is not None else find_sun(self.radiance)
        if sun is None:
            return self, None
        light = DirectionalLight(
            direction=-turned(sun.direction, -self.rotation_deg),
            irradiance=sun.irradiance * self.intensity,
            name=f"sun of {self.name}",
        )
        return replace(self, radiance=sun.rest, shown=self.radiance.detach()), light

    @cached_property
    def mean_radiance(self) -> float:
        """Over all directions and colours, without gradient."""
        value = self._fine.detach().double().mean(dim=-1)
        solid = solid_angles(*value.shape)
        return float((value * solid).sum()) / (4.0 * math.pi) * self.intensity

    @property
    def irradiance_map(self) -> IrradianceMap:
        """Irradiance in the picture's own frame, at intensity one."""
        if self.radiance.requires_grad and torch.is_grad_enabled():
            return IrradianceMap.of(self._fine)
        return self._irradiance_map

    @cached_property
    def _irradiance_map(self) -> IrradianceMap:
        with torch.inference_mode(False), torch.no_grad():
            return IrradianceMap.of(self._fine)

    @cached_property
    def filtered(self) -> FilteredSky:
        """The picture as rough mirrors show it, in its own frame, at intensity one."""
        with torch.inference_mode(False), torch.no_grad():
            return FilteredSky.of(self._fine, len(self.radiance))

    @property
    def _fine(self) -> Tensor:
        """The picture with rows enough to be cut into blocks, interpolated as look-ups do."""
        height, width, _ = self.radiance.shape
        rows = BLOCK_ROWS[1]
        if height >= rows and width >= 2 * rows:
            return self.radiance
        plain = Environment(radiance=self.radiance)
        return plain.lookup(latlong_directions(max(height, rows), max(width, 2 * rows)))


def sky_of(picture: Tensor) -> Tensor:
    """Radiance (H,W,3) of a picture (H,W,1 to 4).

    A few negative texels come from filtering in the program that wrote it: they are black.
    """
    return as_texture(picture)[..., :3].clamp_min(0.0).contiguous()


@lru_cache(maxsize=4)
def _cube_texels(height: int, size: int) -> Tensor:
    """Number of the cube map's texel that is seen at each pixel of a latitude-longitude picture, row by row."""
    d = latlong_directions(height, 2 * height)
    axis = d.abs().argmax(dim=-1)
    major = d.gather(-1, axis[..., None])[..., 0]
    face = 2 * axis + (major < 0).long()
    x, y, z = d.unbind(-1)
    sign = major.sign()
    s = torch.where(axis == 0, -sign * z, torch.where(axis == 1, x, sign * x)) / major.abs()
    t = torch.where(axis == 1, sign * z, -y) / major.abs()
    column, row = ((((v + 1) / 2) * size).long().clamp(0, size - 1) for v in (s, t))
    return ((face * size + row) * size + column).reshape(-1)
