"""Light sources. Intensities are linear RGB; directions point the way the light travels.

Positions are float64: a lamp on a map with coordinates of millions of metres still stands where it stands. Numbers are
read when a light is made: another intensity is another light, ``dataclasses.replace(light, intensity=...)``, in another
scene, ``scene.replace(lights=...)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, cast

import torch
from torch import Tensor

from torchrender.checks import as_vector, check_no_gradient, check_not_negative, check_range
from torchrender.errors import InputError
from torchrender.scene.parts.places import check_near

NARROWEST_DEG, WIDEST_DEG = 0.001, 90.0
"""Half angles of a spot's cone."""
SHORTEST_RANGE = 1e-12
"""Of a light, scene units: its square must not vanish."""
PLACES = ("position", "direction", "corner", "edge_u", "edge_v")
"""Fields that say where a light is."""


def usual_inner_deg(outer_deg: float) -> float:
    """Half angle of a spot's full light, where nobody says it."""
    return min(20.0, 2.0 / 3.0 * outer_deg)


def _white() -> Tensor:
    return torch.ones(3)


def _vectors(light: Any, *names: str, dtype: torch.dtype = torch.float32) -> None:
    for name in names:
        told = f"{type(light).__name__}.{name}"
        object.__setattr__(light, name, as_vector(told, getattr(light, name), dtype=dtype))
        if name in ("position", "corner", "edge_u", "edge_v"):
            check_near(f"light {light.name!r}: {told}", getattr(light, name))


def _colors(light: object, name: str) -> None:
    _vectors(light, name)
    check_not_negative(f"{type(light).__name__}.{name}", getattr(light, name))


def _unit(light: object, name: str) -> None:
    value = getattr(light, name)
    length = value.double().norm()
    if not length > 0:
        raise InputError(f"{type(light).__name__}.{name} must not be zero")
    object.__setattr__(light, name, (value.double() / length).float())


def window(square: Tensor, limit: float) -> Tensor:
    """Share in [0,1] of an inverse square that a light's ``range`` leaves at squared distances: 1 - (d / range)^4.

    It falls to 0 at the range and stays there. Source: the glTF extension KHR_lights_punctual.
    """
    if math.isinf(limit):
        return torch.ones_like(square)
    return 1.0 - (square / limit**2).clamp_max(1.0).square()


@dataclass(frozen=True, eq=False, kw_only=True)
class PointLight:
    """Irradiance at distance r is ``intensity cos(theta) / r^2``, times :func:`window` where the light has a range."""

    position: Tensor  # (3,) float64, scene units
    intensity: Tensor = field(default_factory=_white)  # (3,) power per solid angle
    name: str = "point"
    range: float = math.inf  # scene units; beyond it the light lights nothing

    def __post_init__(self) -> None:
        _vectors(self, "position", dtype=torch.float64)
        _colors(self, "intensity")
        check_range("PointLight.range", self.range, SHORTEST_RANGE)


@dataclass(frozen=True, eq=False, kw_only=True)
class DirectionalLight:
    """Parallel light; irradiance on a facing surface is ``irradiance``."""

    direction: Tensor  # (3,) the way the light travels; normalised
    irradiance: Tensor = field(default_factory=_white)  # (3,)
    name: str = "directional"

    def __post_init__(self) -> None:
        _vectors(self, "direction")
        _colors(self, "irradiance")
        _unit(self, "direction")


@dataclass(frozen=True, eq=False, kw_only=True)
class SpotLight:
    """A point light within a cone; full inside ``inner_deg``, none outside ``outer_deg`` (half angles).

    Between them it is the square of a share that is linear in the cosine. Source: glTF extension KHR_lights_punctual.
    An inner angle that is not given, or None, is two thirds of the outer one, 20 at most.
    """

    position: Tensor  # (3,) float64
    direction: Tensor  # (3,) normalised
    intensity: Tensor = field(default_factory=_white)  # (3,)
    inner_deg: float = cast("float", None)  # none only until the light is made
    outer_deg: float = 30.0
    name: str = "spot"
    range: float = math.inf  # as of a point light

    def __post_init__(self) -> None:
        _vectors(self, "position", dtype=torch.float64)
        _vectors(self, "direction")
        _colors(self, "intensity")
        _unit(self, "direction")
        check_no_gradient("a light", outer_deg=self.outer_deg, inner_deg=self.inner_deg)
        check_range("SpotLight.outer_deg", self.outer_deg, NARROWEST_DEG, WIDEST_DEG)
        if self.inner_deg is None:
            object.__setattr__(self, "inner_deg", usual_inner_deg(self.outer_deg))
        check_range("SpotLight.inner_deg", self.inner_deg, 0.0, self.outer_deg)
        check_range("SpotLight.range", self.range, SHORTEST_RANGE)

    @property
    def axis(self) -> Tensor:
        """(3,) ``direction`` as a unit vector of float64."""
        return torch.nn.functional.normalize(self.direction.double(), dim=0)

    @property
    def versines(self) -> tuple[float, float]:
        """One minus the cosine of either half angle, inner and outer, to all digits; the cone never ends at once."""
        inner, outer = (2.0 * math.sin(math.radians(a) / 2) ** 2 for a in (self.inner_deg, self.outer_deg))
        return min(inner, outer * (1.0 - 1e-6)), outer

    def cone(self, cosine: Tensor) -> Tensor:
        """Share of the intensity for the cosine between the cone's axis and the direction to the point, in [0,1]."""
        return self.cone_about(1.0 - cosine)

    def cone_about(self, versine: Tensor) -> Tensor:
        """The same for one minus the cosine: half the squared difference of unit vectors, exact in narrow cones."""
        inner, outer = self.versines
        share = ((outer - versine) / (outer - inner)).clamp(0.0, 1.0)
        return share * share


@dataclass(frozen=True, eq=False, kw_only=True)
class RectLight:
    """A parallelogram that emits ``radiance`` to the side of ``edge_u x edge_v``.

    An edge of length zero is allowed: the light is then a line or a point, and passes that need an area say so.
    """

    corner: Tensor  # (3,) float64
    edge_u: Tensor  # (3,)
    edge_v: Tensor  # (3,)
    radiance: Tensor = field(default_factory=_white)  # (3,)
    name: str = "area"

    def __post_init__(self) -> None:
        _vectors(self, "corner", dtype=torch.float64)
        _vectors(self, "edge_u", "edge_v")
        _colors(self, "radiance")

    @property
    def area(self) -> float:
        """Area in square scene units."""
        return float(torch.linalg.cross(self.edge_u.double(), self.edge_v.double()).norm())

    @property
    def normal(self) -> Tensor:
        """(3,) unit normal of the emitting side; zero if the light has no area."""
        cross = torch.linalg.cross(self.edge_u.double(), self.edge_v.double())
        return (cross / cross.norm().clamp_min(1e-300)).float()

    @property
    def centre(self) -> Tensor:
        """(3,) float64 centre of the parallelogram."""
        return self.corner + (self.edge_u + self.edge_v) / 2

    def samples(self, per_side: int, *, staggered: bool = False) -> Tensor:
        """(per_side^2, 3) float64 points ``corner + s edge_u + t edge_v``, one in each of n x n cells; b runs fastest.

        Cell centres ``s = (a+0.5)/n, t = (b+0.5)/n``; or staggered, as in :func:`cell_shares`.
        """
        s, t = cell_shares(per_side, staggered=staggered)[..., None].unbind(2)
        return (self.corner.double() + (s * self.edge_u.double() + t * self.edge_v.double())).reshape(-1, 3)


def cell_shares(n: int, *, staggered: bool = False) -> Tensor:
    """(n,n,2) float64 shares of a square's edges, one point in each of n x n cells: its centre, or staggered.

    Staggered points have n^2 different shares of either edge, one in each of n^2 equal steps: a shadow's edge that runs
    along the light's covers them one by one, where it would cover n cell centres at once. Source: Chiu, Shirley and
    Wang, Multi-jittered sampling, 1994; the order within cells makes both edges lattices, which share out what an edge
    in any direction hides a fifth more evenly than van der Corput's order does.
    """
    cell = torch.arange(n, dtype=torch.float64)
    along = across = torch.full((n,), 0.5, dtype=torch.float64)
    if staggered:
        along, across = ((torch.arange(n) * step % n + 0.5) / n for step in (_step(n, 0.3), n - _step(n, 0.2)))
    return torch.stack([cell[:, None] + along[None, :], cell[None, :] + across[:, None]], dim=-1) / n


def _step(n: int, share: float) -> int:
    """The number next to a share of n that has no divisor in common with n."""
    return min((k for k in range(1, n + 1) if math.gcd(k, n) == 1), key=lambda k: abs(k - share * n))


Light = PointLight | DirectionalLight | SpotLight | RectLight


def light_color(light: Light) -> Tensor:
    """(3,) intensity, irradiance or radiance, whichever the kind has."""
    if isinstance(light, DirectionalLight):
        return light.irradiance
    return light.radiance if isinstance(light, RectLight) else light.intensity


def check_place(function: str, light: Light, *, moves: bool = False) -> None:
    """Refuse gradients to where a light is; ``moves``: its position may have one, as where there are no shadows.

    Raises:
        GradientError: names the function and the light.
    """
    for name in ("direction", "corner", "edge_u", "edge_v") if moves else PLACES:
        told = f"{name} of light {light.name!r}" + (" with shadows" if name == "position" else "")
        check_no_gradient(function, **{told: getattr(light, name, None)})


def vectors_to(light: Light, points: Tensor, target: Tensor | None = None) -> Tensor:
    """Vectors (N,3) float64 from points (N,3) to a light: to ``target`` (3,) on a rectangle, or to its centre.

    Of parallel light the unit direction it comes from.
    """
    if isinstance(light, DirectionalLight):
        return -light.direction.double().expand_as(points)
    if isinstance(light, RectLight):
        return (light.centre if target is None else target).double() - points
    return light.position.double() - points
