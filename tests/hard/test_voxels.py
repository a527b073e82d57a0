"""Hard numerical cases of voxels (specification 05, section 13)."""

from __future__ import annotations

import warnings

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError
from torchrender.rays import RayCaster
from torchrender.scene import shapes
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.voxels.collision import CollisionOptions, collide
from torchrender.voxels.grid import VoxelGrid, Voxels, make_grid
from torchrender.voxels.solid import LeakWarning, SolidOptions, voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, voxelize_surface
from voxel_shapes import ball_grid, cube, icosphere, inside_convex, together, unit_grid

AXES = ("x", "y", "z")
METHODS = ("winding", "parity", "vote")
ALL_METHODS = (*METHODS, "soup", "toggle")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("axis", AXES)
def test_faces_exactly_on_cell_borders(method: str, axis: str) -> None:
    solid, report = voxelize_solid(*cube(3.0, 7.0), unit_grid(10), SolidOptions(method=method, axis=axis))
    assert solid.count == 64 and report.leaking_share == 0
    assert solid.cells().amin() == 3 and solid.cells().amax() == 6
    # A face between two layers of cells touches both.
    surface = voxelize_surface(*cube(3.0, 7.0), unit_grid(10))
    assert surface.count == 6**3 - 2**3


@settings(deadline=None, max_examples=40)
@given(
    low=st.tuples(*[st.integers(0, 10)] * 3),
    size=st.tuples(*[st.integers(1, 10)] * 3),
    axis=st.sampled_from(AXES),
)
def test_boxes_on_half_cells(low: tuple[int, ...], size: tuple[int, ...], axis: str) -> None:
    """Corners and edges run through centres and corners of cells; a box of whole cells always has as many inside."""
    first = torch.tensor(low, dtype=torch.float64) / 2
    vertices, faces = cube(0.0, 1.0)
    placed = vertices * torch.tensor(size, dtype=torch.float64) + first
    solid, report = voxelize_solid(placed, faces, unit_grid(16), SolidOptions(axis=axis))
    assert solid.count == size[0] * size[1] * size[2] and report.leaking_share == 0


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000), squash=st.sampled_from([1.0, 1e-2, 1e-5]), axis=st.sampled_from(AXES))
def test_any_convex_body_is_exact(seed: int, squash: float, axis: str) -> None:
    """Rotated and squashed balls, with faces that collapse when snapped; no leak, every voxel right."""
    generator = torch.Generator().manual_seed(seed)
    turn, _ = torch.linalg.qr(torch.randn(3, 3, generator=generator, dtype=torch.float64))
    vertices, faces = icosphere(2)
    body = (vertices * torch.tensor([1.0, 1.0, squash], dtype=torch.float64)) @ turn.T
    body = body + torch.rand(3, generator=generator, dtype=torch.float64) * 0.1
    grid = ball_grid(21, 1.3)
    solid, report = voxelize_solid(body, faces, grid, SolidOptions(axis=axis))
    assert report.leaking_share == 0
    if squash == 1.0:  # snapping may bend the faces of a thinner body inwards
        assert torch.equal(solid.dense()[0], inside_convex(body, faces, grid))


@pytest.mark.parametrize("method", METHODS)
def test_duplicate_faces(method: str) -> None:
    """Some, or all, faces twice: left out, not cancelled."""
    vertices, faces = icosphere(2)
    grid = ball_grid(24)
    whole, _ = voxelize_solid(vertices, faces, grid)
    for doubled in (torch.cat([faces, faces[:50]]), torch.cat([faces, faces.roll(1, dims=1)])):
        solid, report = voxelize_solid(vertices, doubled, grid, SolidOptions(method=method))
        assert solid.equals(whole) and report.leaking_share == 0
    # Also with vertices of their own, and turned round.
    twice = together((vertices, faces), (vertices, faces[:50].flip(1)))
    solid, report = voxelize_solid(*twice, grid, SolidOptions(method=method))
    assert solid.equals(whole) and report.leaking_share == 0 and report.duplicates == 50


def test_triangle_soup() -> None:
    """Every face moved on its own, a tenth of them lost: no edge joins, and the inside is still found."""
    vertices, faces = icosphere(3)
    grid = ball_grid(32)
    exact = inside_convex(vertices, faces, grid)
    whole, report = voxelize_solid(vertices, faces, grid, SolidOptions(method="soup"))
    assert report.closed and int((whole.dense()[0] != exact).sum()) <= 2  # centres within a snap of the surface
    rng = torch.Generator().manual_seed(0)
    corners = vertices[0][faces] + 0.01 * torch.randn(len(faces), 1, 3, generator=rng, dtype=torch.float64)
    kept = torch.rand(len(faces), generator=rng) > 0.1
    loose, apart = corners[kept].reshape(1, -1, 3), torch.arange(3 * int(kept.sum())).reshape(-1, 3)
    with pytest.warns(LeakWarning, match="half of what they see"):
        soup, report = voxelize_solid(loose, apart, grid, SolidOptions(method="soup"))
    wrong = Voxels.from_dense((soup.dense()[0] != exact)[None], grid)
    assert not report.closed and wrong.count < 0.05 * int(exact.sum())
    away = (grid.centres(wrong.cells()).norm(dim=1) - 1).abs()
    assert float(away.amax()) < 2 * float(grid.cell[0])  # only where the faces themselves went astray
    inverted, _ = voxelize_solid(vertices, faces.flip(1), grid, SolidOptions(method="soup"))
    assert inverted.equals(whole)


@pytest.mark.parametrize("method", METHODS)
def test_two_sided_models_and_flaps(method: str) -> None:
    """Every face both ways round does not cancel to nothing; a two-sided flap inside changes nothing."""
    vertices, faces = icosphere(2)
    grid = ball_grid(24)
    whole, _ = voxelize_solid(vertices, faces, grid)
    solid, report = voxelize_solid(vertices, torch.cat([faces, faces.flip(1)]), grid, SolidOptions(method=method))
    assert solid.equals(whole) and report.duplicates == len(faces)
    flap = torch.tensor([[0, 3, 8], [8, 3, 0]])
    solid, report = voxelize_solid(vertices, torch.cat([faces, flap]), grid, SolidOptions(method=method))
    assert solid.equals(whole) and report.closed and report.duplicates == 0


@pytest.mark.parametrize("method", METHODS)
def test_inverted_orientation(method: str) -> None:
    vertices, faces = icosphere(2)
    grid = ball_grid(24)
    outward, _ = voxelize_solid(vertices, faces, grid)
    inward, report = voxelize_solid(vertices, faces.flip(1), grid, SolidOptions(method=method))
    assert inward.equals(outward) and report.leaking_share == 0


def test_some_faces_inverted_are_reported_by_winding_and_right_by_parity() -> None:
    vertices, faces = icosphere(2)
    grid = ball_grid(24)
    whole, _ = voxelize_solid(vertices, faces, grid)
    mixed = faces.clone()
    mixed[::5] = mixed[::5].flip(1)
    with pytest.warns(LeakWarning):
        voxelize_solid(vertices, mixed, grid)
    assert voxelize_solid(vertices, mixed, grid, SolidOptions(method="parity", warn=False))[0].equals(whole)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("side", range(6))
def test_parts_outside_the_grid(axis: str, side: int) -> None:
    """The grid cuts the body on each of six sides: the rest stays as it was, also where columns start inside."""
    vertices, faces = icosphere(3)
    whole_grid = ball_grid(32)
    whole, _ = voxelize_solid(vertices, faces, whole_grid)
    begin, end = [0, 0, 0], [32, 32, 32]
    if side % 2:
        end[side // 2] = 14
    else:
        begin[side // 2] = 14
    origin = whole_grid.origin + whole_grid.cell * torch.tensor(begin)
    dims = tuple(e - b for b, e in zip(begin, end, strict=True))
    part_grid = VoxelGrid(origin, whole_grid.cell, (dims[0], dims[1], dims[2]))
    part, report = voxelize_solid(vertices, faces, part_grid, SolidOptions(axis=axis))
    surface = voxelize_surface(vertices, faces, part_grid)
    box = tuple(slice(b, e) for b, e in zip(reversed(begin), reversed(end), strict=True))
    assert torch.equal(part.dense()[0], whole.dense()[0][box]) and report.leaking_share == 0
    assert torch.equal(surface.dense()[0], voxelize_surface(vertices, faces, whole_grid).dense()[0][box])


def test_model_far_larger_than_the_grid() -> None:
    """A grid deep inside, one across a face, one beside; triangles of thousands of cells."""
    vertices, faces = cube(-5000.0, 5000.0)
    inside, report = voxelize_solid(vertices, faces, unit_grid(7))
    assert (
        inside.count == 343 and report.leaking_share == 0 and voxelize_surface(vertices, faces, unit_grid(7)).count == 0
    )
    across = VoxelGrid(torch.tensor([[4997.0, 0, 0]]), torch.ones(1), (7, 7, 7))
    assert voxelize_solid(vertices, faces, across)[0].count == 3 * 49
    assert voxelize_surface(vertices, faces, across).count == 2 * 49
    beside = VoxelGrid(torch.tensor([[6000.0, 0, 0]]), torch.ones(1), (7, 7, 7))
    assert voxelize_solid(vertices, faces, beside)[0].count == 0


@pytest.mark.parametrize("method", ALL_METHODS)
def test_empty_mesh(method: str) -> None:
    nothing = torch.zeros(1, 0, 3), torch.zeros(0, 3, dtype=torch.int64)
    grid = make_grid(nothing[0], 8)
    solid, report = voxelize_solid(*nothing, grid, SolidOptions(method=method))
    assert solid.count == 0 and report.leaking_share == 0
    surface = voxelize_surface(*nothing, grid)
    assert surface.count == 0 and surface.cells().shape == (0, 3)


def test_grid_of_one_cell() -> None:
    vertices, faces = icosphere(1)
    grid = make_grid(vertices, (1, 1, 1), pad=0)
    for method in METHODS:
        assert voxelize_solid(vertices, faces, grid, SolidOptions(method=method))[0].count == 1
    assert voxelize_surface(vertices, faces, grid).count == 1


@pytest.mark.parametrize("dims", [(1, 1, 200), (200, 1, 1), (65, 3, 1), (64, 64, 1), (63, 2, 130)])
def test_flat_and_long_grids(dims: tuple[int, int, int]) -> None:
    vertices, faces = icosphere(2)
    size = torch.tensor(dims, dtype=torch.float64)
    body = (vertices * 0.45 + 0.5) * size
    grid = unit_grid(*dims)
    results = [voxelize_solid(body, faces, grid, SolidOptions(axis=axis)) for axis in AXES]
    assert all(r.leaking_share == 0 for _, r in results)
    exact = inside_convex(body, faces, grid)
    for solid, _ in results:
        # A long body is no longer exactly convex once its corners are snapped.
        assert int((solid.dense()[0] != exact).sum()) <= 2


def test_triangles_parallel_to_an_axis_and_walls_thinner_than_a_cell() -> None:
    vertices, faces = cube(0.0, 1.0)
    wall = vertices * torch.tensor([0.2, 8.0, 8.0]) + torch.tensor([4.7, 1.0, 1.0])  # between two planes of centres
    solid, report = voxelize_solid(wall, faces, unit_grid(10))
    assert solid.count == 0 and report.leaking_share == 0
    assert voxelize_surface(wall, faces, unit_grid(10)).count == 100
    filled, _ = voxelize_solid(wall, faces, unit_grid(10), SolidOptions(surface=True))
    assert filled.count == 100


@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 10_000), thickness=st.sampled_from([0.0, 1e-300, 1e-16, 1e-12, 1e-9, 1e-6]))
def test_slivers_leave_no_gap(seed: int, thickness: float) -> None:
    """A needle's cells hold every point of it, however thin."""
    rng = torch.Generator().manual_seed(seed)
    a, b = torch.rand(2, 3, generator=rng, dtype=torch.float64) * 12
    side = torch.rand(3, generator=rng, dtype=torch.float64) * thickness
    triangle = torch.stack([a, b, (a + b) / 2 + side])
    found = voxelize_surface(triangle[None], torch.tensor([[0, 1, 2]]), unit_grid(12))
    if found.stats["flat"]:
        assert found.count == 0 and thickness <= 1e-12
        return
    cells = (a + torch.linspace(0, 1, 500, dtype=torch.float64)[:, None] * (b - a)).floor().long()
    i, j, k = cells.clamp(0, 11).unbind(-1)
    assert bool(found.dense()[0, k, j, i].all())


@pytest.mark.parametrize("turn", range(3))
def test_tube_without_caps_is_told_even_where_no_column_leaks(turn: int) -> None:
    """Columns along an open tube meet nothing at all: counting alone would call it empty without a word."""
    tube = shapes.cylinder(0.8, 1.6, 48)
    corners = tube.vertices[tube.faces]
    side = ((corners[..., 1].amax(1) - corners[..., 1].amin(1)) > 0.1).nonzero().reshape(-1)
    vertices, grid = tube.vertices.roll(turn + 1, dims=1)[None], ball_grid(32)
    whole, _ = voxelize_solid(vertices, tube.faces, grid)
    with pytest.warns(LeakWarning):
        _, report = voxelize_solid(vertices, tube.faces[side], grid)
    assert not report.closed
    with pytest.warns(LeakWarning):
        voted, _ = voxelize_solid(vertices, tube.faces[side], grid, SolidOptions(method="vote"))
    assert voted.equals(whole)


def test_open_mesh_has_no_stray_lines_with_the_vote() -> None:
    vertices, faces = icosphere(3)
    grid = ball_grid(48)
    exact, _ = voxelize_solid(vertices, faces, grid)
    with pytest.warns(LeakWarning):
        voted, _ = voxelize_solid(vertices, faces[5:], grid, SolidOptions(method="vote"))
    stray = voted - voxelize_solid(vertices, faces, grid, SolidOptions(surface=True))[0]
    assert stray.count == 0 and (exact - voted).count < 0.001 * exact.count


def test_vertices_far_from_the_origin_and_very_small_or_large_units() -> None:
    vertices, faces = icosphere(2)
    wanted = voxelize_solid(vertices, faces, ball_grid(20))[0].words
    for scale, shift in ((1e-12, 0.0), (1e12, 0.0), (1.0, 2.0**20)):
        grid = ball_grid(20)
        moved = VoxelGrid(grid.origin * scale + shift, grid.cell * scale, grid.dims)
        assert torch.equal(voxelize_solid(vertices * scale + shift, faces, moved)[0].words, wanted)


def test_bad_vertices_are_refused() -> None:
    vertices, faces = icosphere(1)
    vertices[0, 3, 1] = float("nan")
    for call in (voxelize_surface, voxelize_solid):
        with pytest.raises(InputError, match="vertices must be finite: 1 of"):
            call(vertices, faces, ball_grid(8))


def test_unused_vertices_do_not_matter() -> None:
    vertices, faces = icosphere(2)
    more = torch.cat([vertices, torch.full((1, 1, 3), 1000.0)], dim=1)
    assert voxelize_solid(more, faces, ball_grid(20))[0].equals(voxelize_solid(vertices, faces, ball_grid(20))[0])


# ---------------------------------------------------------------- collision


def _block(low: float, high: float) -> Mesh:
    vertices, faces = cube(low, high)
    return Mesh(vertices=vertices[0], faces=faces)


def test_touching_bodies_collide_and_separate_ones_do_not() -> None:
    first = concatenate([_block(0.0, 1.0)])
    for gap, touching in ((0.0, True), (1e-6, False), (-1e-6, True)):
        found = collide(first, concatenate([_block(1.0 + gap, 2.0)]), CollisionOptions(resolution=16))
        assert found.touching is touching
        if touching:
            assert torch.allclose(found.centroid, torch.ones(3, dtype=torch.float64), atol=2 * found.cell)


def test_one_body_inside_the_other_without_touching() -> None:
    outer, inner = concatenate([_block(0.0, 8.0)]), concatenate([_block(3.0, 5.0)])
    found = collide(outer, inner, CollisionOptions(resolution=20))
    assert found.touching and found.count >= 18**3
    assert not collide(outer, inner, CollisionOptions(resolution=20, solid=False)).touching


def test_spheres_meet_no_later_than_they_touch_and_no_earlier_than_the_diagonal_of_a_cell() -> None:
    ball = concatenate([shapes.sphere(1.0, 48)])
    toward = torch.nn.functional.normalize(torch.tensor([1.0, 0.7, 0.4], dtype=torch.float64), dim=0)
    # Bodies that are symmetric about their centre touch at twice the radius in the direction of the other.
    contact = 2 * float(RayCaster(ball).first_hit(torch.zeros(1, 3, dtype=torch.float64), toward[None]).t)
    options = CollisionOptions(cell=0.05)
    seen = []
    for step in range(24):
        distance = contact + 0.121 - 0.01 * step
        placement = torch.eye(4, dtype=torch.float64)
        placement[:3, 3] = toward * distance
        found = collide(ball, ball, options, world_from_second=placement)
        seen.append(found.touching)
        if found.touching:
            assert distance - contact <= 1.01 * 3**0.5 * 0.05
        assert found.touching or distance > contact
    assert not seen[0] and seen[-1] and seen == sorted(seen)


def test_collision_of_empty_and_open_bodies() -> None:
    body = concatenate([_block(0.0, 1.0)])
    assert not collide(body, concatenate([])).touching
    block = _block(0.5, 2.0)
    half = concatenate([Mesh(vertices=block.vertices, faces=block.faces[2:])])
    with pytest.warns(LeakWarning):
        assert collide(body, half, CollisionOptions(resolution=16)).touching


def test_thin_voxels_of_tiny_triangles_may_vanish_conservative_ones_never() -> None:
    speck = torch.tensor([[[2.1, 2.1, 2.1], [2.2, 2.1, 2.1], [2.1, 2.2, 2.15]]])
    face = torch.tensor([[0, 1, 2]])
    assert voxelize_surface(speck, face, unit_grid(4), SurfaceOptions(mode="thin")).count == 0
    assert voxelize_surface(speck, face, unit_grid(4)).cells().tolist() == [[2, 2, 2]]


def test_no_warning_is_lost_when_warnings_are_off() -> None:
    vertices, faces = icosphere(2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        _, report = voxelize_solid(vertices, faces[3:], ball_grid(24), SolidOptions(warn=False))
    assert report.leaking_share > 0 and not report.closed
