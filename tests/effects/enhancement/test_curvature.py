"""Curvature: closed forms on spheres and cylinders, of meshes and of pictures; the strength that follows from it."""

from __future__ import annotations

import math

import pytest
import torch
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from torchrender.effects.enhancement import curvature as c
from torchrender.effects.enhancement.surface_image import SurfaceImage, curvature_of
from torchrender.errors import InputError
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene


def sphere(radius: float = 1.0, subdivisions: int = 3) -> tuple[Tensor, Tensor, Tensor]:
    made = trimesh.creation.icosphere(subdivisions=subdivisions)
    normals = torch.nn.functional.normalize(torch.tensor(made.vertices, dtype=torch.float64), dim=-1)
    return normals * radius, torch.tensor(made.faces.copy()), normals


@pytest.mark.parametrize("radius", [1e-6, 0.3, 7.0, 1e6])
def test_a_sphere_bends_by_two_thirds_of_its_inverse_radius(radius: float) -> None:
    v, f, n = sphere(radius)
    faces = c.face_curvature(v[f], n[f])
    torch.testing.assert_close(faces, torch.full_like(faces, 2 / (3 * radius)), rtol=1e-12, atol=0.0)
    vertices = c.vertex_curvature(v, f, n)
    torch.testing.assert_close(vertices, torch.full_like(vertices, 2 / (3 * radius)), rtol=1e-6, atol=0.0)
    torch.testing.assert_close(c.vertex_curvature(v, f, -n), -vertices, rtol=1e-12, atol=0.0)


def test_broken_meshes_stay_finite() -> None:
    v, f, n = sphere()
    lonely = torch.cat([v, torch.zeros(1, 3, dtype=torch.float64)])
    normals = torch.cat([n, torch.zeros(1, 3, dtype=torch.float64)])
    degenerate = torch.cat([f, torch.tensor([[0, 0, 1], [3, 3, 3]])])
    found = c.vertex_curvature(lonely, degenerate, normals)
    assert float(found[-1]) == 0.0
    torch.testing.assert_close(found[:-1], c.vertex_curvature(v, f, n))
    shared = torch.cat([f, f[:1], f[:1].flip(-1)])  # non-manifold: faces that stand on each other
    assert bool(torch.isfinite(c.vertex_curvature(v, shared, n)).all())
    assert c.vertex_curvature(v[:0], f[:0], n[:0]).shape == (0,)


def test_gradients_come_by_the_torch_path() -> None:
    v, f, n = sphere(subdivisions=1)
    plain = c.vertex_curvature(v, f, n)
    variable = v.clone().requires_grad_()
    torch.testing.assert_close(c.vertex_curvature(variable, f, n).detach(), plain, rtol=1e-6, atol=1e-9)
    assert torch.autograd.gradcheck(lambda x: c.vertex_curvature(x, f[:4], n), [variable])


def test_shapes_are_checked() -> None:
    v, f, n = sphere()
    with pytest.raises(InputError, match="normals must have shape"):
        c.vertex_curvature(v, f, n[:5])


@given(st.floats(-3, 3, allow_subnormal=False), st.floats(0.1, 5.0))
def test_strength_is_odd_bounded_and_rises(k: float, exponent: float) -> None:
    value = torch.tensor([k, -k, k * 0.9], dtype=torch.float64)
    found = c.strength(value, exponent)
    assert float(found[0]) == -float(found[1]) and float(found.abs().max()) <= 1.0
    assert abs(float(found[2])) <= abs(float(found[0]))


def test_strength_is_one_at_the_limit_and_nothing_on_flat_ground() -> None:
    assert c.strength(torch.tensor([1.0, -1.0, 0.0]), 0.3).tolist() == [1.0, -1.0, 0.0]
    assert c.relative_to(torch.tensor([0.0, 0.0]), c.usual_limit(torch.zeros(2), 1.0)).tolist() == [0.0, 0.0]
    assert c.usual_limit(torch.arange(1.0, 101.0), 1.0) == pytest.approx(96.0)


def test_rounding_of_flat_meshes_is_no_shape() -> None:
    turn = torch.linalg.qr(torch.randn(3, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(1)))[0]
    u = torch.linspace(-1, 1, 9, dtype=torch.float64)
    x, y = torch.meshgrid(u, u, indexing="ij")
    index = torch.arange(81).reshape(9, 9)
    a, b, d, e = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = torch.cat([torch.stack([a, d, b], -1).reshape(-1, 3), torch.stack([b, d, e], -1).reshape(-1, 3)])
    flat = (torch.stack([x, y, torch.zeros_like(x)], -1).reshape(-1, 3)) @ turn.T
    normals = turn[:, 2].float().expand(81, 3)
    found = c.mesh_curvature(concatenate([Mesh(vertices=flat, faces=faces, normals=normals)]))
    assert not bool(found.relative.any())


def test_each_mesh_has_a_limit_of_its_own() -> None:
    small, large = sphere(0.01), sphere(100.0)
    meshes = [Mesh(vertices=v + 10 * k, faces=f, normals=n.float()) for k, (v, f, n) in enumerate((small, large))]
    found = c.mesh_curvature(concatenate(meshes))
    torch.testing.assert_close(found.relative, torch.ones_like(found.relative), rtol=1e-3, atol=0.0)
    bare = concatenate([Mesh(vertices=small[0], faces=small[1])])
    assert not bool(c.mesh_curvature(bare).smooth.any())


def camera(size: int = 96, distance: float = 4.0) -> Cameras:
    return Cameras.look_at(
        torch.tensor([[0.0, 0.0, distance]]), torch.zeros(1, 3), fov_deg=35.0, width=size, height=size,
    )  # fmt: skip


@pytest.mark.parametrize("radius", [1.0, 0.6])
def test_pictures_bend_as_what_they_show(radius: float) -> None:
    v, f, n = sphere(radius, 5)
    scene = Scene(meshes=(Mesh(vertices=v, faces=f, normals=n.float()),))
    seen = rasterize(scene, camera(128))
    surface = SurfaceImage.of(seen)
    found = surface.curvature(limit=1.0)
    middle = seen.covered & (seen.normal[..., 2] > 0.6)
    wanted = 2 / (3 * radius)
    assert float((found[middle] / wanted - 1).abs().median()) < 0.05
    torch.testing.assert_close(curvature_of(seen, scene.geometry, c.mesh_curvature(scene.geometry, 1.0))[seen.covered],
                               torch.full((int(seen.covered.sum()),), wanted), rtol=1e-3, atol=0.0)  # fmt: skip
    assert not bool(found[~seen.covered].any())


def test_the_inside_of_a_sphere_is_hollow() -> None:
    v, f, n = sphere(1.0, 4)
    scene = Scene(meshes=(Mesh(vertices=v, faces=f, normals=n.float()),))
    inside = Cameras.look_at(
        torch.tensor([[0.0, 0.0, 0.2]]), torch.tensor([[0.0, 0.0, -1.0]]), fov_deg=60.0, width=64, height=64
    )
    seen = rasterize(scene, inside)
    found = curvature_of(seen, scene.geometry, c.mesh_curvature(scene.geometry, 1.0))
    torch.testing.assert_close(found, torch.full_like(found, -2 / 3), rtol=1e-3, atol=0.0)
    assert float(SurfaceImage.of(seen).curvature(limit=1.0).median()) == pytest.approx(-2 / 3, rel=0.1)


def test_depth_alone_is_enough() -> None:
    v, f, n = sphere(1.0, 6)
    scene = Scene(meshes=(Mesh(vertices=v, faces=f, normals=n.float()),))
    seen = rasterize(scene, camera(160))
    surface = SurfaceImage.from_depth(seen.cameras, seen.depth)
    inside = surface.covered & (seen.normal[..., 2] > 0.5)
    assert int(inside.sum()) > 2000
    cosine = (surface.normal * seen.normal).sum(-1)[inside]
    assert float(cosine.min()) > 0.99
    assert float(surface.curvature(limit=1.0)[inside].median()) == pytest.approx(2 / 3, rel=0.1)


def test_planes_do_not_bend_however_they_lie() -> None:
    quad = torch.tensor([[-5.0, -5, 0], [5, -5, 0], [5, 5, 0], [-5, 5, 0]], dtype=torch.float64)
    for angle in (0.0, 0.7, 1.3):
        turn = torch.tensor(
            [[1, 0, 0], [0, math.cos(angle), -math.sin(angle)], [0, math.sin(angle), math.cos(angle)]]
        ).double()
        scene = Scene(meshes=(Mesh(vertices=quad @ turn.T, faces=torch.tensor([[0, 1, 2], [0, 2, 3]])),))
        seen = rasterize(scene, camera(64))
        for surface in (SurfaceImage.of(seen), SurfaceImage.from_depth(seen.cameras, seen.depth)):
            assert float(surface.curvature(limit=1.0).abs().max()) < 2e-3
