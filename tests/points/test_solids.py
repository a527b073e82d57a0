"""Points as triangles: discs that face along the normals and close a surface, solids where no normal is known."""

from __future__ import annotations

import pytest
import torch

import torchrender as tr
from torchrender.points.cloud import PointCloud
from torchrender.points.solids import point_mesh


def ball(count: int = 2000) -> torch.Tensor:
    number = torch.arange(count, dtype=torch.float64) + 0.5
    height, angle = 1 - 2 * number / count, number * (torch.pi * (1 + 5**0.5))
    flat = (1 - height.square()).sqrt()
    return torch.stack([flat * angle.cos(), height, flat * angle.sin()], dim=-1)


def test_discs_lie_across_the_normals_and_face_along_them() -> None:
    way = torch.nn.functional.normalize(torch.randn(500, 3, generator=torch.Generator().manual_seed(1)).double())
    way = torch.cat([way, torch.eye(3).double(), -torch.eye(3).double()])
    cloud = PointCloud(position=5 * way, normal=way, radius=torch.linspace(0.01, 0.2, len(way)))
    mesh = point_mesh(cloud)
    assert mesh.faces.shape == (4 * len(way), 3)
    corners = mesh.vertices.reshape(-1, 6, 3) - cloud.position[:, None]
    assert torch.allclose(corners.norm(dim=2), cloud.radius.double()[:, None].expand(-1, 6), atol=1e-6)
    a, b, c = mesh.vertices[mesh.faces].unbind(1)
    facing = torch.nn.functional.normalize(torch.linalg.cross(b - a, c - a), dim=1)
    assert torch.allclose(facing, way.repeat_interleave(4, dim=0), atol=1e-4)


def test_discs_close_the_surface_that_the_points_lie_on() -> None:
    points = ball()
    mesh = point_mesh(PointCloud(position=points, normal=points))
    scene = tr.Scene(meshes=(mesh,))
    rays = tr.RayCaster(scene.geometry)
    ways = ball(5000).float().contiguous()
    hits = rays.first_hit(torch.zeros_like(ways), ways)
    assert bool((hits.triangle >= 0).all())
    assert float(hits.t.min()) > 0.95 and float(hits.t.max()) < 1.05  # no spikes


@pytest.mark.parametrize("step", [1, 3])
def test_a_point_without_a_normal_is_a_solid(step: int) -> None:
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0], [5, 0, 0], [6, 0, 0]])
    normal = torch.zeros(7, 3)
    normal[3] = torch.tensor([0.0, 1.0, 0.0])
    mesh = point_mesh(PointCloud(position=points, normal=normal, radius=torch.ones(7)), max_points=-(-7 // step))
    kept = len(range(0, 7, step))
    assert len(mesh.vertices) == 6 * kept and len(mesh.faces) == 8 * (kept - 1) + 4
    assert point_mesh(PointCloud(position=points)).faces.shape == (56, 3)
    used = mesh.faces.unique()
    assert torch.equal(used, torch.arange(6 * kept))
