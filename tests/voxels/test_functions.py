"""Voxels of implicit and parametric surfaces (specification 05, section 7)."""

from __future__ import annotations

import math

import pytest
import torch
from scipy import ndimage

from torchrender.errors import InputError, OptionError
from torchrender.voxels.functions import voxelize_implicit, voxelize_parametric
from torchrender.voxels.grid import VoxelGrid
from voxel_shapes import ball_grid, unit_grid


def tangle(points: torch.Tensor) -> torch.Tensor:
    return (points**4 - 5 * points**2).sum(dim=1) + 11.8


def ball(points: torch.Tensor) -> torch.Tensor:
    return points.norm(dim=1) - 1.0


def sphere(uv: torch.Tensor) -> torch.Tensor:
    u, v = uv.unbind(1)
    return torch.stack([u.cos() * v.sin(), v.cos(), u.sin() * v.sin()], dim=1)


@pytest.mark.parametrize(("n", "solid", "surface"), [(64, 36_104, 8_928), (128, 290_408, 37_184)])
def test_counts_of_the_specification(n: int, solid: int, surface: int) -> None:
    grid = ball_grid(n, 3.0)
    assert voxelize_implicit(tangle, grid).count == pytest.approx(solid, rel=1e-3)
    assert voxelize_implicit(tangle, grid, "surface").count == pytest.approx(surface, rel=1e-3)


def test_surface_of_corners_separates() -> None:
    crossed = voxelize_implicit(ball, ball_grid(24), "corners").dense()[0].numpy()
    assert ndimage.label(~crossed)[1] == 2


def test_batch_of_grids_and_border_cells() -> None:
    grid = VoxelGrid(torch.tensor([[-1.1, -1.1, -1.1], [0.0, 0.0, 0.0]]), torch.tensor([0.1, 0.1]), (22, 22, 22))
    both = voxelize_implicit(ball, grid)
    for b in range(2):
        assert voxelize_implicit(ball, grid[b]).equals(both[b])
    surface = voxelize_implicit(ball, grid[1], "surface")
    assert bool(surface.dense()[0, 0, 0, 0])  # solid, and beyond the grid counts as outside


def test_parametric_sphere_has_no_gap() -> None:
    grid = ball_grid(32)
    found = voxelize_parametric(sphere, ((0.0, 2 * math.pi), (0.0, math.pi)), grid)
    assert found.largest_gap <= 0.5
    crossed = voxelize_implicit(ball, grid, "corners")
    # Samples half a cell apart may miss cells that the sphere only grazes; none may lie off the sphere.
    radius = grid.centres(found.voxels.cells()).norm(dim=1)
    assert float((radius - 1).abs().amax()) <= 3**0.5 / 2 * float(grid.cell[0])
    assert found.voxels.count > 0.9 * crossed.count
    # 26-connected: no way from inside to outside through faces and no hole.
    assert ndimage.label(found.voxels.dense()[0].numpy(), structure=torch.ones(3, 3, 3).numpy())[1] == 1


def test_limit_of_samples_is_kept_and_told() -> None:
    found = voxelize_parametric(sphere, ((0.0, 2 * math.pi), (0.0, math.pi)), ball_grid(256), max_samples=4096)
    assert found.samples <= 4096 and found.largest_gap > 0.5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: voxelize_implicit(lambda p: p[:, 0] * math.nan, unit_grid(4)), "NaN"),
        (lambda: voxelize_implicit(lambda p: p, unit_grid(4)), "function must return"),
        (lambda: voxelize_implicit(ball, unit_grid(4), "shell"), "kind must be one of"),
        (lambda: voxelize_parametric(sphere, ((1.0, 0.0), (0.0, 1.0)), unit_grid(4)), "domain must have"),
        (lambda: voxelize_parametric(lambda uv: uv, ((0.0, 1.0), (0.0, 1.0)), unit_grid(4)), "surface must return"),
        (lambda: voxelize_parametric(sphere, ((0.0, 1.0), (0.0, 1.0)), unit_grid(4), max_samples=3), "max_samples"),
    ],
)
def test_wrong_input_is_named(call: object, message: str) -> None:
    with pytest.raises((InputError, OptionError), match=message):
        call()  # type: ignore[operator]
