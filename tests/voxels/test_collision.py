"""Collision of two bodies by shared voxels (specification 05, section 8)."""

from __future__ import annotations

import pytest
import torch

from torchrender.errors import InputError, OptionError
from torchrender.scene import shapes
from torchrender.scene.mesh import concatenate
from torchrender.voxels.collision import CollisionOptions, collide
from torchrender.voxels.solid import SolidOptions, voxelize_solid


def moved(x: float) -> torch.Tensor:
    matrix = torch.eye(4)
    matrix[0, 3] = x
    return matrix


def test_shared_voxels_are_those_of_both_bodies() -> None:
    ball = concatenate([shapes.sphere(1.0, 32)])
    found = collide(ball, ball, CollisionOptions(resolution=120), world_from_second=moved(1.2))
    assert found.touching and found.shared is not None and found.count == found.shared.count == len(found.cells)
    sets = [
        voxelize_solid(v[None], ball.faces, found.shared.grid, SolidOptions(surface=True))[0]
        for v in (ball.vertices, ball.vertices + torch.tensor([1.2, 0, 0]))
    ]
    assert (sets[0] & sets[1]).equals(found.shared)
    # The lens between two unit balls 1.2 apart.
    lens = 2 * torch.pi * 0.4**2 * (1 - 0.4 / 3)
    assert found.count * found.cell**3 == pytest.approx(lens, rel=0.1)
    assert torch.allclose(found.centroid, torch.tensor([0.6, 0, 0]).double(), atol=1e-6)
    assert found.bounds[0, 0] == pytest.approx(0.2, abs=2 * found.cell)
    assert found.bounds[1, 0] == pytest.approx(1.0, abs=2 * found.cell)


def shifted(*by: float) -> torch.Tensor:
    matrix = torch.eye(4)
    matrix[:3, 3] = torch.tensor(by)
    return matrix


@pytest.mark.parametrize("by", [(0.9, 0.4, -0.2), (-0.3, 1.1, 0.5), (0.2, -0.3, 1.2)])
def test_bounds_and_centroid_are_those_of_the_shared_voxels(by: tuple[float, float, float]) -> None:
    """Boxes of cells, to their far sides, whichever axis the overlap is short along."""
    ball = concatenate([shapes.sphere(1.0, 24)])
    found = collide(ball, ball, CollisionOptions(resolution=40), world_from_second=shifted(*by))
    assert found.shared is not None and found.centroid is not None
    k, j, i = found.shared.dense()[0].nonzero(as_tuple=True)
    low = found.shared.grid.origin[0] + found.cell * torch.stack([i, j, k], dim=1).double()
    torch.testing.assert_close(found.bounds, torch.stack([low.amin(0), low.amax(0) + found.cell]))
    torch.testing.assert_close(found.centroid, low.mean(0) + 0.5 * found.cell)
    for axis, step in enumerate(by):  # of two unit balls
        assert found.bounds[0, axis] >= max(-1.0, step - 1.0) - 2 * found.cell
        assert found.bounds[1, axis] <= min(1.0, step + 1.0) + 2 * found.cell


@pytest.mark.parametrize("given", [{"resolution": 40}, {"cell": 0.03}], ids=["resolution", "cell"])
def test_the_grid_is_that_of_the_overlap_with_a_cell_around_it(given: dict[str, float]) -> None:
    by = torch.tensor([0.9, 0.4, -0.2])
    box = concatenate([shapes.box(torch.full((3,), 2.0))])
    found = collide(box, box, CollisionOptions(**given), world_from_second=shifted(*by.tolist()))  # type: ignore[arg-type]
    assert found.shared is not None
    grid, size = found.shared.grid, 2.0 - by.abs().double()
    assert found.cell == pytest.approx(given.get("cell", float(size.max()) / 38))
    assert grid.dims == tuple(int(n) for n in (size / found.cell - 1e-6).ceil() + 2)
    low = torch.maximum(torch.tensor(-1.0), by - 1.0).double()
    for room in (low - grid.origin[0], grid.far_corner[0] - low - size):
        assert bool((room >= 0.999 * found.cell).all()) and bool((room <= 1.501 * found.cell).all())


def test_placing_both_is_placing_one() -> None:
    ball, ring = concatenate([shapes.sphere(0.5, 16)]), concatenate([shapes.torus(1.0, 0.2, 24)])
    one = collide(ball, ring, world_from_first=moved(1.0))
    both = collide(ball, ring, world_from_first=moved(4.0), world_from_second=moved(3.0))
    assert one.count == pytest.approx(both.count, rel=0.02) and one.touching
    apart = collide(ball, ring)
    assert not apart.touching  # in the hole of the ring, though the boxes overlap
    assert apart.centroid is None and apart.count == 0


def test_wrong_placements_are_refused() -> None:
    ball = concatenate([shapes.sphere(1.0, 8)])
    with pytest.raises(InputError, match="world_from_second must have shape"):
        collide(ball, ball, world_from_second=torch.eye(3))
    with pytest.raises(InputError, match="world_from_first must be finite"):
        collide(ball, ball, world_from_first=torch.eye(4) * float("nan"))
    with pytest.raises(OptionError, match="resolution must be"):
        CollisionOptions(resolution=0)
