"""Multi-valued voxels (specification 05, section 6), and their visible sides as a mesh."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from torchrender.errors import InputError
from torchrender.scene import shapes
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.voxels.attributes import (
    decode_normals,
    encode_normals,
    surface_fragments,
    voxelize_attributes,
    voxelize_scene,
)
from torchrender.voxels.grid import Voxels, make_grid
from torchrender.voxels.mesh import voxel_mesh
from torchrender.voxels.solid import voxelize_solid
from torchrender.voxels.surface import SurfaceOptions, voxelize_surface
from voxel_shapes import ball_grid, icosphere, together, unit_grid

MODES = ("conservative", "thin")


def area(vertices: torch.Tensor, faces: torch.Tensor) -> float:
    corners = vertices[0][faces]
    return float(torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]).norm(dim=1).sum() / 2)


def test_weights_add_up_to_the_area() -> None:
    vertices, faces = icosphere(3)
    grid = ball_grid(24)
    fragments = surface_fragments(vertices, faces, grid)
    measured = float(fragments.total_weight().sum() * grid.cell[0] ** 2)
    assert measured == pytest.approx(area(vertices, faces), rel=1e-9)
    thin = surface_fragments(vertices, faces, grid, SurfaceOptions(mode="thin"))
    assert float(thin.total_weight().sum() * grid.cell[0] ** 2) == pytest.approx(area(vertices, faces), rel=0.02)


@pytest.mark.parametrize("mode", MODES)
def test_fragments_name_each_pair_once(mode: str) -> None:
    vertices, faces = icosphere(2)
    options = SurfaceOptions(mode=mode)
    fragments = surface_fragments(vertices, faces, ball_grid(16), options)
    surface = voxelize_surface(vertices, faces, ball_grid(16), options)
    assert fragments.voxels.equals(surface) and len(fragments.triangle) == surface.stats["pairs"]
    cell = torch.repeat_interleave(torch.arange(len(fragments.cells)), fragments.lengths)
    pairs = torch.stack([cell, fragments.triangle], dim=1)
    assert torch.equal(torch.unique(pairs, dim=0), pairs)  # each once, in order


@pytest.mark.parametrize("mode", MODES)
def test_linear_attributes_are_found_where_the_surface_is(mode: str) -> None:
    """Positions as attributes come back as points inside the cell; a constant stays what it is."""
    vertices, faces = icosphere(3)
    grid = ball_grid(20)
    constant = torch.full((1, vertices.shape[1], 1), 0.25)
    attributes = torch.cat([vertices.float(), constant], dim=2)
    found = voxelize_attributes(vertices, faces, attributes, grid, SurfaceOptions(mode=mode))
    inside = (found.values[0][:, :3].double() - grid.origin[0]) / grid.cell[0] - found.cells[0]
    assert bool((inside >= -1e-4).all()) and bool((inside <= 1 + 1e-4).all())
    assert torch.allclose(found.values[0][:, 3], torch.tensor(0.25))
    dense = found.dense()
    assert dense.shape == (1, 20, 20, 20, 4)
    assert torch.equal(dense[..., 3] > 0, found.voxels.dense())


def test_corner_attributes_equal_vertex_attributes_and_batch_equals_single() -> None:
    vertices, faces = icosphere(2)
    stacked = torch.cat([vertices, vertices * 0.8])
    grid = make_grid(stacked, (18, 18, 18))
    values = torch.rand(2, vertices.shape[1], 2, generator=torch.Generator().manual_seed(0))
    by_vertex = voxelize_attributes(stacked, faces, values, grid)
    by_corner = voxelize_attributes(stacked, faces, values[:, faces], grid)
    for b in range(2):
        single = voxelize_attributes(stacked[b][None], faces, values[b][None], grid[b])
        assert torch.equal(by_vertex.values[b], by_corner.values[b])
        assert torch.equal(by_vertex.values[b], single.values[0])


def test_two_faces_in_one_cell_count_by_their_area() -> None:
    big = torch.tensor([[[0.1, 0.1, 0.2], [0.9, 0.1, 0.2], [0.1, 0.9, 0.2]]])
    small = torch.tensor([[[0.1, 0.1, 0.8], [0.5, 0.1, 0.8], [0.1, 0.5, 0.8]]])
    vertices, faces = together((big, torch.tensor([[0, 1, 2]])), (small, torch.tensor([[0, 1, 2]])))
    values = torch.tensor([1.0, 1, 1, 6, 6, 6])[None, :, None]
    found = voxelize_attributes(vertices, faces, values, unit_grid(1))
    assert float(found.values[0]) == pytest.approx(2.0)  # areas 4 to 1
    assert float(found.weight[0]) == pytest.approx(0.4)


def test_normals_that_cancel_leave_the_largest() -> None:
    vertices = torch.tensor([[0.2, 0.2, 0.5], [0.8, 0.2, 0.5], [0.2, 0.8, 0.5]])
    mesh = Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 1]]))
    found = voxelize_scene(Scene(meshes=(mesh,)), unit_grid(1))
    assert found.normal.tolist() == [[0.0, 0.0, 1.0]]
    assert float(found.density) == pytest.approx(0.36)


def test_scene_normals_colours_and_materials() -> None:
    red, green = Material(diffuse=torch.tensor([0.8, 0, 0])), Material(diffuse=torch.tensor([0, 0.6, 0]))
    ball = shapes.sphere(1.0, 48)
    other = Mesh(vertices=ball.vertices + torch.tensor([3.0, 0, 0]), faces=ball.faces, normals=ball.normals, material=1)
    scene = Scene(meshes=(ball, other), materials=(red, green))
    found = voxelize_scene(scene, make_grid(scene.bounds[None], 64))
    centres = found.grid.centres(found.cells)
    left = centres[:, 0] < 1.5
    wanted = torch.nn.functional.normalize(centres - torch.where(left[:, None], 0.0, torch.tensor([3.0, 0, 0])), dim=1)
    assert float((found.normal.double() * wanted).sum(1).amin()) > 0.99
    assert torch.allclose(found.color[left], red.diffuse, atol=1e-6)
    assert torch.allclose(found.color[~left], green.diffuse, atol=1e-6)
    assert torch.equal(found.material, (~left).long())


def test_textures_colour_voxels() -> None:
    texture = torch.zeros(2, 2, 3)
    texture[:, 0, 0] = texture[:, 1, 2] = 1.0  # red on the left, blue on the right
    white = Material(diffuse=torch.ones(3), diffuse_texture=texture.repeat_interleave(8, 0).repeat_interleave(8, 1))
    scene = Scene(meshes=(shapes.plane(torch.tensor([2.0, 2.0])),), materials=(white,))
    found = voxelize_scene(scene, make_grid(scene.bounds[None], 20))
    x = found.grid.centres(found.cells)[:, 0]
    inner = x.abs() < 0.85  # the texture repeats: its sides mix at the border
    left, right = inner & (x < -0.3), inner & (x > 0.3)
    assert bool((found.color[left, 0] > 0.9).all()) and bool((found.color[right, 2] > 0.9).all())
    assert torch.allclose(found.uv[inner, 0].double(), (x[inner] + 1) / 2, atol=0.02)


def test_textured_model(data_dir) -> None:
    scene = load(data_dir / "meshes" / "spot_textured.glb")
    found = voxelize_scene(scene, make_grid(scene.bounds[None], 48))
    assert float(found.color.std(dim=0).amin()) > 0.1  # black patches, brown horns
    assert torch.allclose(found.normal.norm(dim=1), torch.ones(len(found.cells)), atol=1e-5)


def test_normals_in_16_bits() -> None:
    normals = torch.nn.functional.normalize(torch.randn(20_000, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    normals = torch.cat([normals, torch.eye(3), -torch.eye(3)])
    back = decode_normals(encode_normals(normals))
    error = torch.rad2deg(torch.atan2(torch.linalg.cross(normals, back).norm(dim=1), (normals * back).sum(1)))
    assert float(error.amax()) < 0.95 and float(error.mean()) < 0.4


def test_wrong_attributes_are_refused() -> None:
    vertices, faces = icosphere(1)
    with pytest.raises(InputError, match="attributes must have shape"):
        voxelize_attributes(vertices, faces, torch.zeros(1, 5, 2), ball_grid(8))
    with pytest.raises(InputError, match="attributes must be finite"):
        voxelize_attributes(vertices, faces, torch.full((1, vertices.shape[1], 1), math.inf), ball_grid(8))
    with pytest.raises(InputError, match="one grid"):
        surface_fragments(vertices.expand(2, -1, -1), faces, make_grid(vertices.expand(2, -1, -1), (8, 8, 8)))


# --------------------------------------------------------------------- mesh


def test_sides_of_voxels_equal_a_count_and_are_closed() -> None:
    dense = torch.rand(1, 6, 5, 70, generator=torch.Generator().manual_seed(1)) < 0.4
    voxels = Voxels.from_dense(dense, unit_grid(70, 5, 6))
    mesh = voxel_mesh(voxels)
    padded = np.pad(dense[0].numpy(), 1)
    sides = sum(int((padded != np.roll(padded, 1, axis=a)).sum()) for a in range(3))
    assert len(mesh.faces) == 2 * sides
    again, report = voxelize_solid(mesh.vertices[None], mesh.faces, unit_grid(70, 5, 6))
    assert report.closed and again.equals(voxels)
    corners = mesh.vertices[mesh.faces]
    normal = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert mesh.normals is not None
    assert torch.allclose(normal.float(), mesh.normals[mesh.faces[:, 0]])


def test_colours_go_with_their_cells() -> None:
    dense = torch.rand(1, 4, 4, 4, generator=torch.Generator().manual_seed(2)) < 0.5
    voxels = Voxels.from_dense(dense, unit_grid(4))
    cells = voxels.cells()
    mesh = voxel_mesh(voxels, cells.float() / 4)
    assert mesh.colors is not None and mesh.normals is not None
    middle = mesh.vertices[mesh.faces].mean(dim=1) - 0.5 * mesh.normals[mesh.faces[:, 0]]
    assert torch.equal(middle.floor().float() / 4, mesh.colors[mesh.faces[:, 0]])
    with pytest.raises(InputError, match="color must have shape"):
        voxel_mesh(voxels, torch.zeros(3, 3))
