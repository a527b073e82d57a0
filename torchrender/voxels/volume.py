"""Transparent pictures of voxel grids and density volumes, alone or mixed. Source: specification 05, section 8.

Layers of cells with a colour and an opacity are blended front to back along each pixel's ray. Light is put into the
colours beforehand, from the stored normals or from the gradient of the densities, so it does not depend on the view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import ArrayLike, as_vector, check_finite, check_range, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.voxels.volume_march import BRICK, Cells, Layers, march
from torchrender.numerics.color import srgb_from_linear, srgb_table
from torchrender.scene.camera import Cameras
from torchrender.scene.parts.kinds import several
from torchrender.voxels.attributes import SurfaceVoxels, spread
from torchrender.voxels.grid import Voxels

DENSEST = 1.0 - 1e-6  # opacity of a cell that lets nothing through


@dataclass(frozen=True, eq=False, kw_only=True)
class VolumeLayer:
    """A box of cells with colour and opacity.

    Raises:
        InputError: wrong shapes or types, or cells without size.
    """

    rgba: Tensor  # (nz,ny,nx,4) uint8: sRGB colour, and opacity over one reference length
    origin: Tensor  # (3,) lowest corner, scene units
    spacing: Tensor  # (3,) edges of a cell, scene units
    smooth: bool = True  # trilinear between centres of cells; False: cells are cubes of one colour

    def __post_init__(self) -> None:
        check_tensor("rgba", self.rgba, ("nz", "ny", "nx", 4))
        if self.rgba.dtype != torch.uint8 or self.rgba.numel() == 0:
            raise InputError(f"rgba must be uint8 and not empty, got {self.rgba.dtype} {tuple(self.rgba.shape)}")
        for name in ("origin", "spacing"):
            object.__setattr__(self, name, as_vector(name, getattr(self, name), dtype=torch.float64))
        if not bool((self.spacing > 0).all()):
            raise InputError(f"spacing must be > 0, got {self.spacing.tolist()}")

    @property
    def reference(self) -> float:
        """Length over which a cell has its opacity: the shortest edge of a cell."""
        return float(self.spacing.min())

    @property
    def dims(self) -> tuple[int, int, int]:
        """nx, ny, nz."""
        nz, ny, nx = self.rgba.shape[:3]
        return nx, ny, nz


@dataclass(frozen=True, kw_only=True)
class VolumeLight:
    """Light on translucent cells: ``ambient`` from everywhere, the rest from one direction, on both sides of surfaces.

    Raises:
        InputError: a direction without length.
        OptionError: ``ambient`` outside [0, 1].
    """

    toward: tuple[float, float, float] = (-0.4, 0.8, 0.6)  # to the light, world space
    ambient: float = 0.35

    def __post_init__(self) -> None:
        check_range("ambient", self.ambient, 0.0, 1.0)
        if not bool((as_vector("toward", self.toward) != 0).any()):
            raise InputError("toward must not be zero")

    def on(self, normals: Tensor) -> Tensor:
        """(...,1) share of light on unit normals (...,3); where there is none, half of the directed light."""
        toward = torch.nn.functional.normalize(as_vector("toward", self.toward), dim=0)
        facing = (normals.float() @ toward).abs()[..., None]
        facing = torch.where((normals == 0).all(dim=-1, keepdim=True), torch.tensor(0.5), facing)
        return self.ambient + (1.0 - self.ambient) * facing


def surface_layer(
    surface: SurfaceVoxels, opacity: float = 0.3, *, color: ArrayLike | None = None, light: VolumeLight | None = None
) -> VolumeLayer:
    """Surface voxels with their own colours (or one) and normals; a cell's opacity follows its density.

    A surface as large as a side of its cell gets ``opacity``, times its own where it blends: a pane stays a pane,
    however opaque walls are. Smaller ones let more through, as if cells held pieces of such surfaces.

    Raises:
        OptionError: ``opacity`` outside [0, 1].
    """
    check_range("opacity", opacity, 0.0, 1.0)
    own = surface.color if color is None else as_vector("color", color).expand(len(surface.cells), 3)
    lit = own * (light or VolumeLight()).on(surface.normal)
    own_opacity = torch.ones_like(surface.density) if surface.opacity is None else surface.opacity
    area = (surface.density / own_opacity).clamp_max(1.0)
    alpha = (1.0 - (1.0 - min(opacity, DENSEST) * own_opacity) ** area)[:, None]
    rgba = spread(_codes(lit, alpha), surface.cells, surface.grid)
    grid = surface.grid
    return VolumeLayer(rgba=rgba, origin=grid.origin[0], spacing=grid.cell[0].expand(3), smooth=False)


def voxel_layer(voxels: Voxels, color: ArrayLike = (0.8, 0.8, 0.8), opacity: float = 0.05) -> VolumeLayer:
    """Cells of one colour, without directed light.

    Raises:
        InputError: several grids.
        OptionError: ``opacity`` outside [0, 1].
    """
    check_range("opacity", opacity, 0.0, 1.0)
    if len(voxels.grid) != 1:
        raise InputError(f"voxels must be of one grid, got {len(voxels.grid)}")
    code = _codes(as_vector("color", color), torch.tensor([opacity]))
    rgba = voxels.dense()[0][..., None] * code
    return VolumeLayer(rgba=rgba, origin=voxels.grid.origin[0], spacing=voxels.grid.cell[0].expand(3), smooth=False)


def density_layer(
    density: Tensor,
    transfer: Sequence[tuple[float, ArrayLike, float]],
    *,
    origin: ArrayLike = 0.0,
    spacing: ArrayLike = 1.0,
    light: VolumeLight | None = None,
) -> VolumeLayer:
    """A volume of numbers, coloured by a transfer function and lit by its gradient.

    Args:
        density: (nz,ny,nx) float.
        transfer: (value, linear colour, opacity over the shortest edge of a cell), ascending in value; linear between.
        origin, spacing: of the layer, scene units.

    Raises:
        InputError: another shape, values that are not finite, or an empty or unordered transfer function.
    """
    check_tensor("density", density, ("nz", "ny", "nx"))
    check_finite("density", density)
    knots = [float(k[0]) for k in transfer]
    if not knots or any(b <= a for a, b in pairwise(knots)):
        raise InputError(f"transfer must have ascending values, got {knots}")
    table = torch.stack(
        [torch.cat([as_vector("transfer colour", c), torch.tensor([float(a)])]) for _, c, a in transfer]
    )
    values = density.detach().float().contiguous()
    at = torch.tensor(knots)
    upper = torch.searchsorted(at, values).clamp(1, max(len(knots) - 1, 1)).clamp_max(len(knots) - 1)
    lower = (upper - 1).clamp_min(0)
    width = (at[upper] - at[lower]).clamp_min(1e-30)
    share = ((values - at[lower]) / width).clamp(0.0, 1.0)[..., None]
    coloured = torch.lerp(table[lower], table[upper], share)
    normals = _gradient(values, as_vector("spacing", spacing))
    lit = coloured[..., :3] * (light or VolumeLight()).on(normals)
    rgba = _codes(lit, coloured[..., 3:])
    return VolumeLayer(rgba=rgba, origin=as_vector("origin", origin), spacing=as_vector("spacing", spacing))


def _gradient(values: Tensor, spacing: Tensor) -> Tensor:
    """(nz,ny,nx,3) unit gradient by central differences, zero where the values do not change."""
    parts = []
    for axis in range(3):
        dim = 2 - axis
        n = values.shape[dim]
        index = torch.arange(n)
        ahead = values.index_select(dim, (index + 1).clamp_max(n - 1))
        behind = values.index_select(dim, (index - 1).clamp_min(0))
        parts.append((ahead - behind) / (2 * spacing[axis]))
    return torch.nn.functional.normalize(torch.stack(parts, dim=-1), dim=-1, eps=1e-12)


def _codes(color: Tensor, alpha: Tensor) -> Tensor:
    """(...,4) uint8 of linear colour (...,3) and opacity (...,1)."""
    values = torch.cat([srgb_from_linear(color.clamp(0.0, 1.0)), alpha.clamp(0.0, 1.0)], dim=-1)
    return (values * 255.0 + 0.5).to(torch.uint8)


def render_volume(layers: Sequence[VolumeLayer], cameras: Cameras, *, step: float | None = None) -> Tensor:
    """(B,H,W,4) float32: linear colour times coverage, and coverage. Rays end where coverage exceeds 0.995.

    Opacities are those over a layer's reference length; a step of another length gets 1 - (1 - a)^(step / reference).
    Where layers overlap, their optical depths add.

    Args:
        layers: at least one.
        step: length between samples, scene units; None: the shortest edge of a cell, half of that for cubes.

    Raises:
        InputError: no layers.
        OptionError: a step that is not positive.
    """
    layers = several("layers", layers, (VolumeLayer,))
    if not layers:
        raise InputError("layers must not be empty")
    shortest = min(layer.reference * (1.0 if layer.smooth else 0.5) for layer in layers)
    length = shortest if step is None else step
    check_range("step", length, 1e-12)
    origins, toward = cameras.rays()
    toward = torch.nn.functional.normalize(toward, dim=-1)
    image = torch.zeros(*origins.shape[:-1], 4)
    rays = view(origins.reshape(-1, 3), np.float64), view(toward.reshape(-1, 3), np.float64)
    cells = torch.cat([layer.rgba.reshape(-1, 4) for layer in layers]).numpy()
    bricks = [_bricks(layer.rgba[..., 3]) for layer in layers]
    held = Cells(cells, torch.cat(bricks).numpy(), *_tables())
    march(*rays, _arrays(layers, bricks), held, length, image.view(-1, 4).numpy())
    return image


def over_background(image: Tensor, background: ArrayLike) -> Tensor:
    """(B,H,W,3) linear picture of :func:`render_volume`'s result before a colour."""
    return image[..., :3] + (1.0 - image[..., 3:]) * as_vector("background", background)


def _arrays(layers: Sequence[VolumeLayer], bricks: Sequence[Tensor]) -> Layers:
    low = torch.stack([layer.origin for layer in layers])
    spacing = torch.stack([layer.spacing for layer in layers])
    counts = torch.tensor([layer.dims for layer in layers])
    firsts = torch.zeros(len(layers), 2, dtype=torch.int64)
    for n in range(1, len(layers)):
        firsts[n, 0] = firsts[n - 1, 0] + layers[n - 1].rgba[..., 0].numel()
        firsts[n, 1] = firsts[n - 1, 1] + len(bricks[n - 1])
    reference = torch.tensor([layer.reference for layer in layers], dtype=torch.float64)
    smooth = torch.tensor([layer.smooth for layer in layers])
    arrays = (low, low + spacing * counts, 1.0 / spacing, reference, counts, firsts, smooth)
    return Layers(*(a.numpy() for a in arrays))


def _bricks(alpha: Tensor) -> Tensor:
    """Flat uint8: does a block of cells, or a cell beside it, have any opacity?"""
    filled = (alpha > 0).float()[None, None]
    padding = [(-n) % BRICK for n in reversed(alpha.shape)]
    filled = torch.nn.functional.pad(filled, (0, padding[0], 0, padding[1], 0, padding[2]))
    beside = torch.nn.functional.max_pool3d(filled, 3, stride=1, padding=1)
    return torch.nn.functional.max_pool3d(beside, BRICK)[0, 0].to(torch.uint8).reshape(-1)


def _tables() -> tuple[np.ndarray, np.ndarray]:
    alpha = (torch.arange(256, dtype=torch.float64) / 255.0).clamp_max(DENSEST)
    return (-torch.log1p(-alpha)).float().numpy(), srgb_table(8).float().numpy()
