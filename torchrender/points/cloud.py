"""Point clouds: surfaces sampled by discs with a position, a normal, a radius and a colour."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import in_single_precision
from torchrender.brief import brief, brief_html
from torchrender.checks import (
    as_array,
    check_finite,
    check_flag,
    check_name,
    check_no_gradient,
    check_not_negative,
    check_tensor,
)
from torchrender.errors import InputError
from torchrender.scene.camera import Cameras, framing_camera
from torchrender.scene.parts.places import check_near

RADIUS_NEIGHBOUR = 6
RADIUS_SCALE = 0.75
NORMAL_NEIGHBOURS = 16


ROUNDING = 1e-4
"""By which opacities may miss their range: they come from sums and from numbers of 8 bits."""
COVARIANCE_ROUNDING = 1e-5
"""Of a covariance's trace, by which it may miss being one: float32 products of scales and rotations do."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PointCloud:
    """P points; lists and arrays of NumPy are taken as tensors. What is missing may be estimated: :meth:`completed`.

    A normal that is zero or not finite is unknown: such a point is drawn as a disc that faces the eye. A radius that
    is not finite, zero or negative is unknown.

    Raises:
        InputError: wrong shapes, no points, positions or colours that are not finite, negative colours, opacities
            outside [0, 1], a ``spread`` that is no covariance: not symmetric, or negative in some direction.
        OptionError: ``two_sided`` neither True nor False.
        GradientError: a value asks for gradients, which drawing points does not give.
    """

    position: Tensor  # (P,3) float64, scene units
    normal: Tensor | None = None  # (P,3) float32 unit; zero: unknown
    radius: Tensor | None = None  # (P,) float32 scene units; zero: unknown
    color: Tensor | None = None  # (P,3) float32 linear; None: light grey
    opacity: Tensor | None = None  # (P,) float32 in [0,1]; None: opaque
    spread: Tensor | None = None  # (P,3,3) float32 covariance of 3D Gaussians, square scene units; None: discs
    two_sided: bool = False  # the sides of the normals are not known
    name: str = "points"

    __repr__ = brief
    _repr_html_ = brief_html

    def __post_init__(self) -> None:
        check_flag("two_sided", self.two_sided)
        check_name("name of a point cloud", self.name)
        for name in ("position", "normal", "radius", "color", "opacity", "spread"):
            if (value := getattr(self, name)) is not None:
                kind = torch.float64 if name == "position" else torch.float32
                object.__setattr__(self, name, as_array(name, value, kind))
                check_no_gradient("a point cloud", **{name: getattr(self, name)})
        count = check_tensor("position", self.position, ("P", 3)).shape[0]
        if not count:
            raise InputError("position must hold at least one point")
        place = check_finite("position", self.position.detach().double().contiguous())
        object.__setattr__(self, "position", check_near("position", place))
        if self.normal is not None:
            normal = check_tensor("normal", self.normal, (count, 3)).detach().double()
            normal = torch.where(torch.isfinite(normal).all(1, keepdim=True), normal, 0.0)
            # Scaled first: the square of a very long or very short vector does not fit its type.
            normal = normal / normal.abs().amax(1, keepdim=True).clamp_min(1e-300)
            object.__setattr__(self, "normal", torch.nn.functional.normalize(normal, dim=1).float().contiguous())
        if self.radius is not None:
            radius = check_tensor("radius", self.radius, (count,)).detach().float()
            radius = torch.where(torch.isfinite(radius) & (radius > 0), radius, 0.0)
            object.__setattr__(self, "radius", radius.contiguous())
        if self.color is not None:
            color = check_tensor("color", self.color, (count, 3)).detach()
            if not color.is_floating_point():
                raise InputError(f"color must hold floats in linear light, got {color.dtype}")
            color = check_not_negative("color", check_finite("color", color.float()))
            object.__setattr__(self, "color", color.contiguous())
        if self.opacity is not None:
            opacity = check_finite("opacity", check_tensor("opacity", self.opacity, (count,)).detach().float())
            if bool(((opacity < -ROUNDING) | (opacity > 1.0 + ROUNDING)).any()):
                low, high = opacity.aminmax()
                raise InputError(f"opacity must lie in [0, 1], got {float(low):g} to {float(high):g}")
            object.__setattr__(self, "opacity", opacity.clamp(0.0, 1.0).contiguous())
        if self.spread is not None:
            spread = check_finite("spread", check_tensor("spread", self.spread, (count, 3, 3)).detach().float())
            _check_covariance(spread)
            object.__setattr__(self, "spread", spread.contiguous())

    def __len__(self) -> int:
        return int(self.position.shape[0])

    @property
    def bounds(self) -> Tensor:
        """(2,3) float64 bounding box of the centres."""
        return torch.stack([self.position.amin(0), self.position.amax(0)])

    @property
    def diagonal(self) -> float:
        """Length of the bounding-box diagonal, scene units."""
        low, high = self.bounds
        return float((high - low).norm())

    def camera(self, name: str | None = None, *, width: int, height: int) -> Cameras:
        """A camera that frames the points with their discs, of Gaussians two standard deviations around them."""
        bounds = self.bounds
        if self.radius is not None:
            reach = self.radius.double()[:, None]
            bounds = torch.stack([(self.position - reach).amin(0), (self.position + reach).amax(0)])
        if self.spread is not None:
            reach = 2.0 * self.spread.diagonal(dim1=1, dim2=2).double().clamp_min(0.0).sqrt()
            bounds = torch.stack([(self.position - reach).amin(0), (self.position + reach).amax(0)])
        return framing_cloud(bounds, name, width, height)

    @in_single_precision
    def completed(self) -> PointCloud:
        """This cloud with a normal and a radius at every point, estimated where there is none.

        Radius: 0.75 times the distance to the 6th nearest neighbour. Normal: smallest eigenvector of the covariance of
        the 16 nearest neighbours, turned to the side of the normals that are given; where none is given, outwards,
        side by side along a minimum spanning tree, and ``two_sided`` is set where that is not sure. Points that all
        lie at one place get a radius of 1e-3 and keep a normal of zero. Source: specification 06, section 2.
        """
        if self.spread is not None:  # ellipsoids have their own size and need no normal
            return self
        missing_radius = torch.ones(len(self), dtype=torch.bool) if self.radius is None else self.radius == 0
        missing_normal = torch.ones(len(self), dtype=torch.bool) if self.normal is None else (self.normal == 0).all(1)
        if not bool(missing_radius.any() | missing_normal.any()):
            return self
        from torchrender.points.normals import estimate_normals, estimate_radii

        radius = torch.zeros(len(self)) if self.radius is None else self.radius
        if bool(missing_radius.any()):
            rows = missing_radius.numpy()
            estimate = estimate_radii(self.position.numpy(), rows, RADIUS_NEIGHBOUR, RADIUS_SCALE)
            radius = radius.clone()
            radius[missing_radius] = torch.from_numpy(estimate.astype(np.float32))
            positive = radius[radius > 0]
            usual = float(positive.median()) if len(positive) else 1e-3
            radius = torch.where(radius > 0, radius, usual)
        normal, two_sided = self.normal, self.two_sided
        if bool(missing_normal.any()):
            known = None if bool(missing_normal.all()) or normal is None else normal.numpy()
            found, sure = estimate_normals(self.position.numpy(), known, NORMAL_NEIGHBOURS)
            estimated = torch.from_numpy(found.astype(np.float32))
            normal = estimated if normal is None else torch.where(missing_normal[:, None], estimated, normal)
            two_sided = two_sided or not sure
        return replace(self, normal=normal, radius=radius, two_sided=two_sided)


def _check_covariance(spread: Tensor) -> None:
    """Refuse matrices (P,3,3) that no Gaussian has.

    A symmetric matrix is positive semidefinite where its diagonal, its three minors of two rows and its determinant
    are not negative. Each is compared with the trace, to whose power it grows.

    Raises:
        InputError: counts them and names the first.
    """
    wide = spread.double()
    size = wide.diagonal(dim1=1, dim2=2).abs().sum(1)
    crooked = (wide - wide.transpose(1, 2)).abs().amax((1, 2)) > COVARIANCE_ROUNDING * size
    _refuse("spread must be symmetric", crooked)
    scaled = wide / size.clamp_min(1e-300)[:, None, None]
    a, b, c = scaled[:, 0, 0], scaled[:, 1, 1], scaled[:, 2, 2]
    d, e, f = scaled[:, 0, 1], scaled[:, 0, 2], scaled[:, 1, 2]
    minors = [a, b, c, a * b - d * d, a * c - e * e, b * c - f * f]
    whole = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    least = torch.stack([*minors, whole]).amin(0)
    _refuse("spread must be a covariance, not negative in any direction", least < -COVARIANCE_ROUNDING)


def _refuse(what: str, wrong: Tensor) -> None:
    if bool(wrong.any()):
        first = int(wrong.int().argmax())
        raise InputError(f"{what}: {int(wrong.sum())} of {len(wrong)} points' are not, first at {first}")


def framing_cloud(bounds: Tensor, name: str | None, width: int, height: int) -> Cameras:
    """A camera that frames a box; points bring no cameras of their own, so a ``name`` is an error."""
    if name is not None:
        raise InputError(f"points have no camera {name!r}; describe one as eye=x,y,z")
    return framing_camera(bounds[None], width=width, height=height)
