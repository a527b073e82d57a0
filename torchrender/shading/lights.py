"""What each light brings to points: irradiance, direction, and where it comes from; and lights as kernels read them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.kernels.shading.records import CENTRE, LIGHT, PARALLEL, POINT, RECT
from torchrender.kernels.shading.simd import LEVEL, MOST_BENT
from torchrender.numerics.polygon_light import polygon_irradiance
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight, window
from torchrender.shading.linear_cosines import mirrored_share
from torchrender.shading.surface import Surface

Array = np.ndarray[Any, Any]
NEAREST_SQUARE = 1e-18
"""Square of the closest distance to a small light that counts, scene units: keeps inverse squares finite."""


class LightLists(NamedTuple):
    """The lights that may reach each block of ``side`` x ``side`` pixels of B images.

    Blocks go row by row, image after image; block t has ``lights[starts[t]:starts[t + 1]]``.
    """

    starts: Tensor  # (B*T+1,) int64
    lights: Tensor  # (K,) int32 numbers in the scene
    side: int
    shaded: tuple[int, ...] | None = None  # the lights that there are shadow factors of; None: all


@dataclass(frozen=True, eq=False)
class Arrival:
    """What one light brings to N points, for shadow factor one."""

    irradiance: Tensor  # (N,) cosine-weighted, to be multiplied by ``color``
    direction: Tensor  # (3,N) unit, towards the light (its centre, if it has an area)
    color: Tensor  # (3,)
    corners: Tensor | None = None  # (4,3,N) from the points to those of a rectangle that highlights show as it is

    def select(self, rows: Tensor) -> Arrival:
        """At some of the points."""
        corners = None if self.corners is None else self.corners[..., rows]
        return Arrival(self.irradiance[rows], self.direction[:, rows], self.color, corners)


class Lit(NamedTuple):
    """One light at N points, and how much of it arrives."""

    light: Arrival
    visibility: Tensor | None  # (N,) share in [0,1]; None: all

    @property
    def amount(self) -> Tensor:
        """Irradiance (N,) that the shadow leaves."""
        return self.light.irradiance if self.visibility is None else self.light.irradiance * self.visibility

    def mirrored(self, normal: Tensor, to_eye: Tensor, roughness: Tensor) -> Tensor:
        """Share (N,) of a GGX lobe that the visible rectangle fills; see :func:`mirrored_share`."""
        assert self.light.corners is not None
        share = mirrored_share(self.light.corners, normal, to_eye, roughness)
        share = torch.where(self.light.irradiance > 0, share, 0.0)
        return share if self.visibility is None else share * self.visibility

    def select(self, rows: Tensor) -> Lit:
        """At some of the points."""
        return Lit(self.light.select(rows), None if self.visibility is None else self.visibility[rows])


def arrival(light: Light, surface: Surface, origin: Tensor, area_light: str) -> Arrival:
    """Light at the points, whose positions are counted from ``origin`` (3,) float64."""
    if isinstance(light, RectLight):
        return _from_rectangle(light, surface, origin, area_light == "centre")
    if isinstance(light, DirectionalLight):
        direction = -light.direction[:, None].expand_as(surface.position)
        level = float(LEVEL) * light.direction.abs().sum()
        return Arrival(_cosine(surface, direction, level), direction, light.irradiance)
    direction, falloff, level = _towards(light, surface, origin)
    amount = _cosine(surface, direction, level) * falloff
    if isinstance(light, SpotLight):
        amount = amount * light.cone_about(0.5 * (direction + light.direction[:, None]).square().sum(0))
    return Arrival(amount, direction, light.intensity)


def _cosine(surface: Surface, direction: Tensor, level: Tensor) -> Tensor:
    """Cosine (N,) at the shading normal; 0 where the light lies behind the smooth surface, or in it: see LEVEL."""
    above = (_horizon(surface) * direction).sum(0) > level
    return torch.where(above, (surface.normal * direction).sum(0).clamp_min(0.0), 0.0)


def _horizon(surface: Surface) -> Tensor:
    """Normals (3,N) of the smooth surface that vertex normals stand for, or of triangles where these lean too far."""
    return torch.where(
        (surface.smooth * surface.geometric).sum(0) > float(MOST_BENT), surface.smooth, surface.geometric
    )


def _level(surface: Surface, place: Tensor) -> Tensor:
    """Heights (N,) that float32 cannot tell from zero, between the points and a place (3,)."""
    return float(LEVEL) * (place.abs().sum() + surface.position.detach().abs().sum(0))


def _towards(light: PointLight | SpotLight, surface: Surface, origin: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Unit direction to the light (3,N), inverse squared distance (N,) in its range, and cosine (N,) that is none."""
    place = (light.position.double() - origin).float()
    offset = place[:, None] - surface.position
    square = offset.square().sum(0)
    length = square.sqrt().clamp_min(1e-18)
    falloff = window(square, light.range) / square.clamp_min(NEAREST_SQUARE)
    return offset / length, falloff, _level(surface, place) / length.detach()


def _from_rectangle(light: RectLight, surface: Surface, origin: Tensor, from_centre: bool) -> Arrival:
    """The exact irradiance, or that of a small light at the centre, no closer than the rectangle is wide."""
    corner, u, v = (light.corner.double() - origin).float(), light.edge_u, light.edge_v
    corners = torch.stack([corner, corner + u, corner + u + v, corner + v])
    # Plane tests as differences of two numbers per point: cheaper than vectors to each corner.
    along = light.normal @ surface.position - light.normal @ corner
    horizon = _horizon(surface)
    height = (corners @ horizon) - (surface.position * horizon).sum(0)
    level = torch.stack([_level(surface, one) for one in corners]).amax(0)
    sees = (along > level) & (height > level).any(0)
    offset = (corner + (u + v) / 2)[:, None] - surface.position
    square = offset.square().sum(0)
    length = square.sqrt().clamp_min(1e-18)
    direction = offset / length
    if from_centre:
        emitted = -(light.normal[:, None] * direction).sum(0).clamp_max(0.0) * light.area
        falloff = emitted / square.clamp_min(max(light.area / math.pi, NEAREST_SQUARE))
        centre = _level(surface, corner + (u + v) / 2) / length.detach()
        amount = torch.where(along > level, _cosine(surface, direction, centre) * falloff, 0.0)
        return Arrival(amount, direction, light.radiance)
    amount = torch.zeros_like(along)
    chosen = sees.nonzero().reshape(-1)
    if len(chosen):
        amount[chosen] = polygon_irradiance(corners, surface.position[:, chosen], surface.normal[:, chosen])
    return Arrival(amount, direction, light.radiance, corners[:, :, None] - surface.position)


# ---------------------------------------------------------------- as the compiled kernel reads them


def _numbers(value: Tensor) -> Array:
    """Of a light: torch takes ten times as long for three of them."""
    numbers: Array = value.detach().numpy()
    return numbers


def light_table(lights: tuple[Light, ...], origin: Array, area_light: str) -> Array:
    """(L,32) float32, see :data:`LIGHT`; places are counted from ``origin`` (3,) float64."""
    table, c = np.zeros((len(lights), 32), np.float32), LIGHT
    for row, light in zip(table, lights):
        row[c["cone"] : c["cone"] + 2] = 3.0, 1.0  # a cone that holds everything
        row[c["nearest"]] = NEAREST_SQUARE
        place = slice(c["place"], c["place"] + 3)
        color = slice(c["color"], c["color"] + 3)
        axis = slice(c["axis"], c["axis"] + 3)
        if isinstance(light, RectLight):
            corner, u, v = (
                (_numbers(light.corner) - origin).astype(np.float32),
                _numbers(light.edge_u),
                _numbers(light.edge_v),
            )
            exact = area_light == "polygon"
            row[0], row[place], row[color] = (RECT if exact else CENTRE), corner + (u + v) / 2, _numbers(light.radiance)
            across = _cross(u.astype(np.float64), v.astype(np.float64))
            area = math.sqrt(across @ across)
            normal = (across / max(area, 1e-300)).astype(np.float32)
            row[c["normal"] : c["normal"] + 3], row[c["offset"]] = normal, normal @ corner
            row[c["corners"] : c["corners"] + 12] = np.concatenate([corner, corner + u, corner + u + v, corner + v])
            row[c["area"]] = area
            row[c["nearest"]] = max(area / math.pi, NEAREST_SQUARE)
        elif isinstance(light, DirectionalLight):
            row[0], row[axis], row[color] = PARALLEL, _numbers(light.direction), _numbers(light.irradiance)
        else:
            row[0], row[place] = POINT, _numbers(light.position) - origin
            row[color], row[c["fade"]] = _numbers(light.intensity), light.range**-2
            if isinstance(light, SpotLight):
                inner, outer = light.versines
                row[axis] = _numbers(light.direction)
                row[c["cone"] : c["cone"] + 2] = outer, 1.0 / (outer - inner)
    return table


def _cross(u: Array, v: Array) -> Array:
    """As ``np.cross`` of two vectors, in a tenth of its time."""
    return np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
