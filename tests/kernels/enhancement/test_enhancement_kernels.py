"""Kernels of enhancement against slow twins: plain torch for gradients, loops for ranges."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from torchrender.effects.enhancement.curvature import face_curvature
from torchrender.effects.enhancement.enhance import enhancement
from torchrender.effects.enhancement.gradient import Lighting, shading_gradient
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.effects.enhancement.surface_image import SurfaceImage, curvature_of
from torchrender.kernels.enhancement import gradient as gradient_kernels
from torchrender.kernels.enhancement.curvature import vertex_curvature
from torchrender.kernels.enhancement.local_range import limit_to_range
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

LIGHTS = (
    PointLight(position=torch.tensor([1.0, 2.0, 3.0]), intensity=torch.tensor([5.0, 4.0, 3.0])),
    DirectionalLight(direction=torch.tensor([-1.0, -1.0, -0.5])),
    SpotLight(position=torch.tensor([-1.0, 2.0, 2.0]), direction=torch.tensor([0.4, -1.0, -1.0]), outer_deg=40.0),
    RectLight(
        corner=torch.tensor([-0.5, 2.0, 1.0]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0])
    ),
)


def wavy(size: int = 24) -> Mesh:
    """A bent sheet with normals of its own."""
    u = torch.linspace(-1, 1, size, dtype=torch.float64)
    x, z = torch.meshgrid(u, u, indexing="ij")
    y = 0.15 * torch.sin(5 * x) * torch.cos(4 * z)
    normal = torch.stack(
        [-0.75 * torch.cos(5 * x) * torch.cos(4 * z), torch.ones_like(x), 0.6 * torch.sin(5 * x) * torch.sin(4 * z)], -1
    )
    index = torch.arange(size * size).reshape(size, size)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, :-1], index[1:, 1:]
    faces = torch.cat([torch.stack([a, b, c], -1).reshape(-1, 3), torch.stack([b, d, c], -1).reshape(-1, 3)])
    vertices = torch.stack([x, y, z], -1).reshape(-1, 3)
    return Mesh(
        vertices=vertices, faces=faces, normals=torch.nn.functional.normalize(normal, dim=-1).reshape(-1, 3).float()
    )


@pytest.fixture(scope="module", params=[False, True], ids=["perspective", "orthographic"])
def subject(request: pytest.FixtureRequest) -> tuple[Scene, SurfaceImage, torch.Tensor, Lighting]:
    sky = Environment(radiance=torch.rand(8, 16, 3, generator=torch.Generator().manual_seed(1)))
    scene = Scene(
        meshes=(wavy(), Mesh(vertices=wavy().vertices + 0.6, faces=wavy().faces)), lights=LIGHTS, environment=sky
    )
    cameras = Cameras.look_at(
        torch.tensor([[0.3, 1.5, 2.5], [-1.0, 0.4, 1.5]]), torch.zeros(2, 3), fov_deg=50.0, width=40, height=32
    )
    if request.param:
        k = cameras.intrinsics.clone()
        k[:, :2, :2] *= 0.3
        cameras = Cameras(cameras.camera_from_world, k, 40, 32, cameras.near, cameras.near + 100.0, orthographic=True)
    seen = rasterize(scene, cameras)
    surface = SurfaceImage.of(seen)
    g = torch.Generator().manual_seed(2)
    bent = torch.rand(seen.depth.shape, generator=g) * 3 - 1.5
    visibility = torch.rand(2, len(LIGHTS), 32, 40, generator=g)
    return scene, surface, bent, Lighting(LIGHTS, visibility, sky)


@pytest.mark.parametrize("magnitude", ["signed_l2", "sum", "l1", "l2"])
@pytest.mark.parametrize("terms", [("geometry", "projection"), ("geometry",), ("projection",)])
@pytest.mark.parametrize("light_gradient", [True, False])
def test_the_fused_loop_is_plain_torch(subject, magnitude, terms, light_gradient) -> None:  # type: ignore[no-untyped-def]
    _, surface, bent, lighting = subject
    assert 100 < int(surface.covered.sum()) < surface.covered.numel()
    options = EnhanceOptions(magnitude=magnitude, terms=terms, light_gradient=light_gradient, exponent=0.7)
    fused = enhancement(surface, bent, lighting, options)
    plain = enhancement(surface, bent.clone().requires_grad_(), lighting, options).detach()
    scale = float(plain.abs().max())
    assert scale > 0.05 or "geometry" not in terms
    assert float((fused - plain).abs().max()) <= 1e-4 * max(scale, 1e-6)
    assert not bool(fused[~surface.covered].any())


def test_pixels_get_the_curvature_of_their_vertices() -> None:
    scene = load("nest", size=3000)
    cameras = scene.camera(width=32, height=24)
    seen = rasterize(scene, cameras)
    geometry = scene.geometry
    assert geometry.normals is not None

    class Known:
        relative = torch.rand(len(geometry.vertices), generator=torch.Generator().manual_seed(0))

    found = curvature_of(seen, geometry, Known())  # type: ignore[arg-type]
    for b, j, i in torch.nonzero(seen.covered)[::37].tolist():
        corners = geometry.faces[seen.triangle[b, j, i]].long()
        second, third = seen.barycentric[b, j, i].tolist()
        weights = torch.tensor([1 - second - third, second, third])
        value = float((weights * Known.relative[corners]).sum())
        turned = float((weights @ geometry.normals[corners]) @ seen.normal[b, j, i]) < 0
        assert float(found[b, j, i]) == pytest.approx(-value if turned else value, abs=1e-5)
    assert not bool(found[~seen.covered].any())


def test_vertices_get_the_mean_of_their_faces() -> None:
    mesh = wavy(9)
    assert mesh.normals is not None
    v, f, n = mesh.vertices, mesh.faces, mesh.normals
    out = np.zeros(len(v))
    vertex_curvature(v.numpy(), f.int().numpy(), n.numpy(), np.zeros((len(v), 2)), out)
    k = face_curvature(v[f], n.double()[f])
    area = torch.linalg.cross(v[f[:, 1]] - v[f[:, 0]], v[f[:, 2]] - v[f[:, 0]]).norm(dim=-1)
    for vertex in range(len(v)):
        around = (f == vertex).any(dim=1)
        wanted = float((k * area)[around].sum() / area[around].sum())
        assert out[vertex] == pytest.approx(wanted, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 0.25])
def test_ranges_are_those_of_a_loop(share: float) -> None:
    g = np.random.default_rng(4)
    plain = g.random((9, 13, 3), np.float32)
    normals = np.where(g.random((9, 13, 1)) < 0.5, (0.0, 0.0, 1.0), (0.0, 1.0, 0.0)).astype(np.float32)
    nearness = g.choice(np.array([0.0, 0.5, 0.51], np.float32), (9, 13))
    made = plain + g.normal(size=plain.shape).astype(np.float32)
    out = made.copy()
    limit_to_range(normals, nearness, plain, (3, share, 0.9, 0.05), out)
    for j, i in np.ndindex(9, 13):
        if not nearness[j, i]:
            np.testing.assert_array_equal(out[j, i], made[j, i])
            continue
        window = (slice(max(j - 3, 0), j + 4), slice(max(i - 3, 0), i + 4))
        side = (normals[window] @ normals[j, i] >= 0.9) & (nearness[window] > 0)
        least, greatest = plain[window][side].min(0), plain[window][side].max(0)
        room = share * (greatest - least)
        np.testing.assert_allclose(out[j, i], np.clip(made[j, i], least - room, greatest + room), rtol=1e-5)


def test_the_kernels_numbers_are_the_tables() -> None:
    from torchrender.effects.enhancement import lights

    names = ("POINT", "PARALLEL", "SPOT", "RECTANGLE")
    assert [getattr(gradient_kernels, n) for n in names] == [getattr(lights, n) for n in names]


def test_without_lights_nothing_is_added(subject) -> None:  # type: ignore[no-untyped-def]
    _, surface, bent, _ = subject
    assert not bool(enhancement(surface, bent, Lighting()).any())
    gradient, signed = shading_gradient(surface, bent, Lighting(), EnhanceOptions())
    assert not bool(gradient.any()) and not bool(signed.any())
