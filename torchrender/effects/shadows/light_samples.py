"""The samples of a rectangular light, and the cameras that stand at each of them.

Every camera looks at the centre of the scene's box, all share one up vector, and each has the smallest square opening
angle that contains the box. A sample that would need more than 150 degrees gets the six faces of a cube instead.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.checks import check_finite, check_range, check_tensor
from torchrender.errors import LightWarning
from torchrender.numerics.transforms import pinhole_matrix
from torchrender.scene.camera import Cameras
from torchrender.scene.light import RectLight, check_place

WIDEST_DEG = 150.0
NEAREST = 1e-4
"""Near plane as a share of the box's diagonal."""

_MARGIN = 1e-6  # keeps the box's corners inside the picture


@dataclass(frozen=True, eq=False)
class LightGrid:
    """S samples of one light and the square pictures taken from them. A sample has one face or six."""

    samples: Tensor  # (S,3) float64
    rotations: Tensor  # (S,F,3,3) float64, rows: right, down, forward; zero where a sample has fewer faces
    focal: Tensor  # (S,) float64 pixels
    outline: Tensor  # (3,3) float64 corner and two independent edges of a parallelogram around all samples
    size: int  # pixels of a side
    near: float  # scene units
    note: str  # what was done about a light without area; empty otherwise

    def cameras(self, sample: int) -> Cameras:
        """The one or six cameras of a sample."""
        rotations = self.rotations[sample]
        rotations = rotations[rotations.abs().amax(dim=(1, 2)) > 0]
        matrices = torch.eye(4, dtype=torch.float64).repeat(len(rotations), 1, 1)
        matrices[:, :3, :3] = rotations
        matrices[:, :3, 3] = -(rotations @ self.samples[sample])
        focal, half = float(self.focal[sample]), self.size / 2
        k = pinhole_matrix(focal, focal, half, half).expand(len(rotations), 3, 3)
        near, far = torch.tensor(self.near), torch.tensor(math.inf)
        return Cameras(matrices, k, self.size, self.size, near, far)

    def tiles(self, per_side: int, side: int) -> tuple[Tensor, Tensor]:
        """Parts of a light of ``per_side`` x ``per_side`` samples, with ``side`` x ``side`` samples each.

        Returns the part of each sample (S,) int64, and outlines (G,3,3) float64. A line or a point is one part.
        """
        count = -(-per_side // side)
        if per_side * per_side != len(self.samples) or count == 1:
            return torch.zeros(len(self.samples), dtype=torch.int64), self.outline[None]
        step = torch.arange(per_side) // side
        edges = (torch.arange(count + 1, dtype=torch.float64) * side / per_side).clamp_max(1.0)
        corner, u, v = self.outline
        low, size = edges[:-1], edges.diff()
        parts = torch.zeros(count, count, 3, 3, dtype=torch.float64)
        parts[:, :, 0] = corner + low[:, None, None] * u + low[None, :, None] * v
        parts[:, :, 1] = size[:, None, None] * u
        parts[:, :, 2] = size[None, :, None] * v
        return (step[:, None] * count + step).reshape(-1), parts.reshape(-1, 3, 3)


def light_grid(light: RectLight, bounds: Tensor, *, per_side: int, size: int, staggered: bool = False) -> LightGrid:
    """``per_side`` x ``per_side`` samples of a light; a line has ``per_side``, a point one.

    Args:
        light: edges may be zero or parallel.
        bounds: (2,3) box that the cameras look at, scene units.
        per_side: samples along each edge.
        size: pixels of a picture's side.
        staggered: as in :meth:`~torchrender.scene.light.RectLight.samples`, else the centres of cells.

    Raises:
        InputError, OptionError: a box of another shape or not finite, counts below one.
    """
    check_range("per_side", per_side, 1)
    samples, outline, note = _samples(light, per_side, staggered)
    return _grid(samples, outline, note, bounds, size)


def corner_grid(light: RectLight, bounds: Tensor, *, size: int) -> LightGrid:
    """As :func:`light_grid`, but with the light's corners as samples: four, two of a line, one of a point."""
    corner, u, v = light.corner.double(), light.edge_u.double(), light.edge_v.double()
    corners = torch.stack([corner, corner + u, corner + v, corner + u + v])
    kept: list[Tensor] = []
    for c in corners:
        if not any(bool((c == other).all()) for other in kept):
            kept.append(c)
    _, outline, note = _samples(light, 1, False)
    return _grid(torch.stack(kept), outline, note, bounds, size)


def check_lights(function: str, lights: Sequence[RectLight]) -> None:
    """Warn of lights without area, and refuse gradients to where lights are: GradientError."""
    for light in lights:
        check_place(function, light)
        if light.area == 0.0:
            told = f"light {light.name!r} has no area: it lights nothing in pictures, here it is a line or a point"
            warnings.warn(told, LightWarning, stacklevel=3)


def _samples(light: RectLight, per_side: int, staggered: bool) -> tuple[Tensor, Tensor, str]:
    """Samples (S,3), outline (3,3) and note."""
    corner, u, v = light.corner.double(), light.edge_u.double(), light.edge_v.double()
    lengths = float(u.norm()), float(v.norm())
    area = float(torch.linalg.cross(u, v).norm())
    if area > 1e-9 * lengths[0] * lengths[1]:
        return light.samples(per_side, staggered=staggered), torch.stack([corner, u, v]), ""
    t = (torch.arange(per_side, dtype=torch.float64) + 0.5) / per_side
    # Edges that point against each other: the line runs from one tip to the other.
    start, long = (corner, u + v) if float(u @ v) >= 0 else (corner + v, u - v)
    length = float(long.norm())
    axis = long / length if length > 0 else torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    other = torch.zeros(3, dtype=torch.float64)
    other[int(axis.abs().argmin())] = 1.0
    across = torch.linalg.cross(axis, other)
    across /= across.norm()
    if length > 0:
        note = f"light {light.name!r} has no area: {per_side} samples along its line"
        return start + t[:, None] * long, torch.stack([start, long, across * length]), note
    note = f"light {light.name!r} has no size: hard shadow from a point"
    return corner[None], torch.stack([corner, axis, across]), note


def _grid(samples: Tensor, outline: Tensor, note: str, bounds: Tensor, size: int) -> LightGrid:
    check_range("size", size, 1)
    check_finite("bounds", check_tensor("bounds", bounds, (2, 3)))
    low, high = bounds.to(torch.float64)
    diagonal = float((high - low).norm()) or 1.0
    corners = low + torch.cartesian_prod(*[torch.tensor([0.0, 1.0], dtype=torch.float64)] * 3) * (high - low)
    towards = _towards(samples, (low + high) / 2, outline, diagonal)
    up = _shared_up(towards)
    right = torch.nn.functional.normalize(torch.linalg.cross(towards, up.expand_as(towards)), dim=1)
    rotations = torch.stack([right, torch.linalg.cross(towards, right), towards], dim=1)
    seen = (corners[None] - samples[:, None]) @ rotations.transpose(1, 2)
    depth = seen[..., 2]
    near = NEAREST * diagonal
    tangent = (seen[..., :2].abs().amax(-1) / depth.clamp_min(1e-300)).amax(dim=1) * (1 + _MARGIN)
    wide = (depth.amin(dim=1) <= near) | (tangent > math.tan(math.radians(WIDEST_DEG) / 2))
    tangent = torch.where(wide, 1.0, tangent.clamp_min(1e-6))
    faces = torch.zeros(len(samples), 6 if bool(wide.any()) else 1, 3, 3, dtype=torch.float64)
    faces[:, 0] = rotations
    if bool(wide.any()):
        faces[wide] = torch.einsum("fij,sjk->sfik", _cube(), rotations[wide])
    return LightGrid(samples, faces, size / 2 / tangent, outline, size, near, note)


def _towards(samples: Tensor, centre: Tensor, outline: Tensor, diagonal: float) -> Tensor:
    """(S,3) unit view directions; the light's own where a sample stands in the box's centre."""
    towards = centre - samples
    length = towards.norm(dim=1, keepdim=True)
    own = torch.linalg.cross(outline[1], outline[2])
    return torch.where(length > 1e-6 * diagonal, towards / length.clamp_min(1e-300), own / own.norm())


def _shared_up(towards: Tensor) -> Tensor:
    """The world axis that is least along any of the directions."""
    axes = torch.eye(3, dtype=torch.float64)
    return axes[int(towards.abs().amax(dim=0).argmin())]


def _cube() -> Tensor:
    """(6,3,3) rotations from a camera's frame to those of a cube's faces, the first one its own."""
    x, y, z = torch.eye(3, dtype=torch.float64)
    return torch.stack([torch.stack(rows) for rows in (
        (x, y, z), (-x, y, -z), (-z, y, x), (z, y, -x), (x, -z, y), (x, z, -y),
    )])  # fmt: skip
