"""Lights as enhancement takes them: direction, distance and brightness at points of a surface."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from torch import Tensor

from torchrender.effects.enhancement.derivatives import DERIVATIVES
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight, window
from torchrender.scene.sky.harmonics import environment_bands

POINT, PARALLEL, SPOT, RECTANGLE = range(4)
WIDTH = 14
FADE = 12
"""Numbers of a light in :func:`light_table`, and where one over its squared range stands."""

GRID = 64
"""Rows of the picture that an environment's harmonics are taken from."""


def light_table(lights: Sequence[Light], origin: Tensor) -> np.ndarray:
    """(L,14) float64: kind, position from the origin or direction to the light, axis, colour, cone or area.

    Rectangles count as small lights at their centre.
    """
    table = np.zeros((len(lights), WIDTH))
    for row, light in zip(table, lights):
        row[FADE] = light.range**-2 if isinstance(light, PointLight | SpotLight) else 0.0
        if isinstance(light, DirectionalLight):
            row[0], row[1:4], row[7:10] = PARALLEL, -light.direction.double(), light.irradiance
        elif isinstance(light, SpotLight):
            row[0], row[1:4], row[4:7] = SPOT, light.position.double() - origin, light.direction
            row[7:10] = light.intensity.detach()
            row[10:12] = [math.cos(math.radians(a)) for a in (light.inner_deg, light.outer_deg)]
        elif isinstance(light, RectLight):
            row[0], row[1:4], row[4:7] = RECTANGLE, light.centre.double() - origin, light.normal
            row[7:10], row[10] = light.radiance.detach(), light.area
        else:
            row[0], row[1:4], row[7:10] = POINT, light.position.double() - origin, light.intensity.detach()
    return table


def at_points(light: Light, points: Tensor, origin: Tensor, nearest: float) -> tuple[Tensor, Tensor, Tensor]:
    """Direction to the light (N,3), distance (N,) (+inf: parallel), and light colour (N,3) on a facing surface.

    Points (N,3) are given from ``origin`` (3,), world space; ``nearest`` is the least distance that counts.
    """
    if isinstance(light, DirectionalLight):
        direction = -light.direction.to(points.dtype).expand_as(points)
        return direction, points.new_full(points.shape[:1], math.inf), light.irradiance.expand(len(points), 3)
    position = light.centre if isinstance(light, RectLight) else light.position
    offset = position.to(points.dtype) - origin - points
    distance = offset.norm(dim=-1).clamp_min(nearest)
    direction = offset / distance[:, None]
    return direction, distance, _brightness(light, direction, distance)


def _brightness(light: PointLight | SpotLight | RectLight, direction: Tensor, distance: Tensor) -> Tensor:
    falloff = 1.0 / distance.square()
    if isinstance(light, RectLight):
        emitted = -(direction * light.normal.to(direction.dtype)).sum(dim=-1)
        return light.radiance * (falloff * emitted.clamp_min(0.0) * light.area)[:, None]
    falloff = falloff * window(distance.square(), light.range)
    if isinstance(light, SpotLight):
        falloff = falloff * light.cone(-(direction * light.direction.to(direction.dtype)).sum(dim=-1))
    return light.intensity * falloff[:, None]


def environment_harmonics(environment: Environment) -> Tensor:
    """(9,3) float64 order-2 harmonics of an environment's radiance."""
    return environment_bands(environment, GRID)


def harmonic_table(environment: Environment | None) -> np.ndarray:
    """(9,3) float64 harmonics of irradiance with the factors of their derivatives, as the kernel reads them."""
    if environment is None:
        return np.zeros((9, 3))
    table: np.ndarray = (environment_harmonics(environment) * DERIVATIVES[:, None]).numpy()
    return table
