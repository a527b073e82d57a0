"""Surface and solid voxels of meshes (specification 05, sections 4 and 5)."""

from __future__ import annotations

import warnings
from itertools import pairwise

import pytest
import torch
from scipy import ndimage

from torchrender.errors import InputError, OptionError
from torchrender.rays import RayCaster
from torchrender.scene import shapes
from torchrender.scene.mesh import concatenate
from torchrender.voxels.grid import make_grid
from torchrender.voxels.solid import LeakWarning, SolidOptions, voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, voxelize_surface
from voxel_shapes import ball_grid, cell_indices, cube, icosphere, inside_convex, together, unit_grid

AXES = ("x", "y", "z")


def test_conservative_separates_inside_from_outside_and_thin_leaks() -> None:
    vertices, faces = icosphere()
    grid = ball_grid(64)
    thin = voxelize_surface(vertices, faces, grid, SurfaceOptions(mode="thin"))
    closed = voxelize_surface(vertices, faces, grid)
    assert (thin.count, closed.count) == (8768, 15872)  # the numbers of the specification
    assert (thin - closed).count == 0
    assert ndimage.label(~closed.dense()[0].numpy())[1] == 2
    assert ndimage.label(~thin.dense()[0].numpy())[1] == 1


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("method", ["winding", "parity", "vote"])
def test_solid_of_a_closed_mesh_has_no_wrong_voxel(axis: str, method: str) -> None:
    vertices, faces = icosphere()
    grid = ball_grid(64)
    solid, report = voxelize_solid(vertices, faces, grid, SolidOptions(axis=axis, method=method))
    assert torch.equal(solid.dense()[0], inside_convex(vertices, faces, grid))
    assert solid.count == 103_096 and report.leaking_share == 0.0


def test_the_source_s_fill_fails_where_the_default_does_not() -> None:
    vertices, faces = icosphere()
    grid = ball_grid(64)
    exact = inside_convex(vertices, faces, grid)
    toggled, _ = voxelize_solid(vertices, faces, grid, SolidOptions(method="toggle"))
    assert int((toggled.dense()[0] != exact).sum()) > 2000


@pytest.mark.parametrize("axis", AXES)
def test_cube_with_corners_on_cell_centres(axis: str) -> None:
    solid, report = voxelize_solid(*cube(10.5, 20.5), unit_grid(32), SolidOptions(axis=axis))
    assert solid.count == 1000 and report.leaking_share == 0


def test_overlapping_and_nested_parts() -> None:
    """Winding numbers unite overlapping parts and fill nested shells; parity cuts both out."""
    overlap = together(cube(4.2, 15.3), cube(9.1, 25.7))
    counts = {
        m: voxelize_solid(*overlap, unit_grid(32), SolidOptions(method=m))[0].count for m in ("winding", "parity")
    }
    assert counts == {"winding": 6028, "parity": 5812}
    nested = together(cube(4.2, 25.3), cube(9.1, 15.7))
    counts = {m: voxelize_solid(*nested, unit_grid(32), SolidOptions(method=m))[0].count for m in ("winding", "parity")}
    assert counts == {"winding": 21**3, "parity": 21**3 - 7**3}
    cavity = together(cube(4.2, 25.3), (cube(9.1, 15.7)[0], cube(9.1, 15.7)[1].flip(1)))
    assert voxelize_solid(*cavity, unit_grid(32))[0].count == 21**3 - 7**3


def test_solid_agrees_with_rays() -> None:
    """Centres of cells are inside where a ray in an oblique direction leaves the mesh an odd number of times."""
    mesh = concatenate([shapes.torus(1.0, 0.37, 24)])
    grid = make_grid(mesh.vertices[None], 26)
    solid, report = voxelize_solid(mesh.vertices[None], mesh.faces, grid)
    assert report.leaking_share == 0
    centres = grid.centres(cell_indices(grid.dims).reshape(-1, 3))
    directions = torch.tensor([0.6, 0.3, 0.742], dtype=torch.float64).expand_as(centres)
    caster = RayCaster(mesh)
    crossings = torch.zeros(len(centres), dtype=torch.int64)
    hits = caster.first_hit(centres, directions)
    while bool((hits.triangle >= 0).any()):
        crossings += hits.triangle >= 0
        hits = caster.next_hit(centres, directions, hits.t, hits.triangle)
    wrong = (crossings % 2 == 1) != solid.dense()[0].reshape(-1)
    # Vertices move by up to half a unit of 2^-8 cell; all disagreements must lie that close to the surface.
    nearest = _distance(centres[wrong], mesh.vertices[mesh.faces.long()])
    assert bool((nearest <= float(grid.cell[0]) / 256).all())
    assert int(wrong.sum()) < 10


def _distance(points: torch.Tensor, triangles: torch.Tensor) -> torch.Tensor:
    """(N,) distance to the planes of the nearest triangles, by their closest sample points."""
    n = 8
    a, b = torch.meshgrid(torch.arange(n + 1) / n, torch.arange(n + 1) / n, indexing="ij")
    keep = a + b <= 1
    weights = torch.stack([1 - a[keep] - b[keep], a[keep], b[keep]], dim=1).double()
    normal = torch.nn.functional.normalize(
        torch.linalg.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), dim=1
    )
    samples = weights @ triangles
    out = []
    for point in points:
        nearest = (samples - point).norm(dim=2).amin(dim=1).argmin()
        out.append(((point - triangles[nearest, 0]) * normal[nearest]).sum().abs())
    return torch.stack(out) if out else torch.zeros(0, dtype=torch.float64)


@pytest.mark.parametrize("seed", range(3))
def test_missing_faces_are_reported_and_the_vote_repairs(seed: int) -> None:
    vertices, faces = icosphere()
    grid = ball_grid(64)
    exact = inside_convex(vertices, faces, grid)
    order = torch.randperm(len(faces), generator=torch.Generator().manual_seed(seed))
    holes = faces[order[len(faces) // 100 :]]
    with pytest.warns(LeakWarning, match=r"% of the columns"):
        single, report = voxelize_solid(vertices, holes, grid)
    assert int((single.dense()[0] != exact).sum()) > 1000
    assert 0.005 < report.leaking_share < 0.05 and report.odd["z"] > 0
    with pytest.warns(LeakWarning, match="other axes"):
        voted, report = voxelize_solid(vertices, holes, grid, SolidOptions(method="vote"))
    assert int((voted.dense()[0] != exact).sum()) < 0.001 * int(exact.sum())
    assert set(report.leaking) == set(AXES) and min(report.leaking.values()) > 0
    assert 0 < report.unknown < 100


def test_an_open_mesh_whose_columns_do_not_leak_is_told_without_shares() -> None:
    vertices, faces = icosphere()
    small = torch.tensor([[0.01, 0.0, 0.0], [0.01, 0.2, 0.0], [0.01, 0.0, 0.2]])[None]  # upright, as columns are
    corners = torch.tensor([[0, 1, 2]], dtype=faces.dtype) + vertices.shape[1]
    with pytest.warns(LeakWarning, match=r"edges belong to one face alone; no column of these cells leaks$"):
        _, report = voxelize_solid(torch.cat([vertices, small.to(vertices)], 1), torch.cat([faces, corners]), 16)
    assert not report.closed
    assert sum(report.leaking.values()) == 0


def test_volume_converges_with_resolution() -> None:
    vertices, faces = icosphere(5)
    corners = vertices[0][faces]
    exact = float(torch.linalg.det(corners).sum() / 6)
    errors = []
    for n in (32, 64, 128, 256):
        solid, _ = voxelize_solid(vertices, faces, make_grid(vertices, n))
        errors.append(abs(float(solid.volume[0]) / exact - 1))
    assert errors[-1] < 0.01 and errors[-1] < errors[0] / 8


def test_surface_count_grows_fourfold_per_doubling() -> None:
    vertices, faces = icosphere(5)
    counts = [voxelize_surface(vertices, faces, make_grid(vertices, (n, n, n))).count for n in (128, 256, 512)]
    for less, more in pairwise(counts):
        assert 3.8 < more / less < 4.2


def test_batch_equals_single() -> None:
    first, faces = icosphere(2)
    stacked = torch.cat([first, first * 0.7 + 0.1])
    grid = make_grid(stacked, (40, 33, 70))
    surface = voxelize_surface(stacked, faces, grid)
    solid, report = voxelize_solid(stacked, faces, grid, SolidOptions(method="vote"))
    assert report.leaking_share == 0
    for b in range(2):
        assert voxelize_surface(stacked[b][None], faces, grid[b]).equals(surface[b])
        assert voxelize_solid(stacked[b][None], faces, grid[b])[0].equals(solid[b])


def test_surface_joins_the_solid() -> None:
    vertices, faces = icosphere(2)
    grid = ball_grid(24)
    inside, _ = voxelize_solid(vertices, faces, grid)
    both, _ = voxelize_solid(vertices, faces, grid, SolidOptions(surface=True))
    assert both.equals(inside | voxelize_surface(vertices, faces, grid)) and both.count > inside.count


def test_closed_meshes_do_not_warn() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        voxelize_solid(*cube(1.0, 5.0), unit_grid(8))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: voxelize_surface(torch.zeros(3, 3), torch.zeros(1, 3), unit_grid(4)), "vertices must have shape"),
        (lambda: voxelize_surface(torch.zeros(1, 3, 3), torch.zeros(1, 3), unit_grid(4)), "faces must be integers"),
        (lambda: voxelize_surface(torch.zeros(1, 3, 3), torch.tensor([[0, 1, 3]]), unit_grid(4)), "index 3 vertices"),
        (
            lambda: voxelize_solid(torch.full((1, 3, 3), float("inf")), torch.tensor([[0, 1, 2]]), unit_grid(4)),
            "vertices must be finite",
        ),
        (
            lambda: voxelize_solid(torch.full((1, 3, 3), 1e9), torch.tensor([[0, 1, 2]]), unit_grid(4)),
            "must lie within",
        ),
        (lambda: SurfaceOptions(mode="fat"), "mode must be one of"),
        (lambda: SolidOptions(method="guess"), "method must be one of"),
        (lambda: SolidOptions(axis="w"), "axis must be one of"),
        (lambda: SolidOptions(subbits=2), "subbits must be in"),
    ],
)
def test_wrong_input_is_named(call: object, message: str) -> None:
    with pytest.raises((InputError, OptionError), match=message):
        call()  # type: ignore[operator]
