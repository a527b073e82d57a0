"""Hard cases of gradient-enhanced pictures: specification 10, section 9, and what cameras and scales do to it."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
import trimesh

import torchrender as tr
from torchrender.effects.enhancement.options import EnhanceOptions
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

WISHES = (
    EnhanceOptions(),
    EnhanceOptions(magnitude="sum", terms=("geometry", "projection", "visibility", "specular")),
    EnhanceOptions(magnitude="l2", curvature="full", range_limit=0.25, overshoot_limit=1 / 3),
    EnhanceOptions(exponent=0.1, source="picture", centred=True),
)
LAMP = PointLight(position=torch.tensor([2.0, 3.0, 3.0]), intensity=torch.full((3,), 20.0))


def ball(subdivisions: int = 3) -> Mesh:
    made = trimesh.creation.icosphere(subdivisions=subdivisions)
    v = torch.tensor(made.vertices, dtype=torch.float64)
    return Mesh(vertices=v, faces=torch.tensor(made.faces.copy()), normals=v.float())


def picture(mesh: Mesh, wish: EnhanceOptions | None, camera: Cameras | None = None, **parts: object) -> torch.Tensor:
    scene = Scene(**{"meshes": (mesh,), "lights": (LAMP,), **parts})  # type: ignore[arg-type]
    camera = (
        camera
        if camera is not None
        else Cameras.look_at(torch.tensor([[0.0, 0.0, 3.0]]), torch.zeros(1, 3), width=48, height=48)
    )
    return tr.render(scene, camera, options=RenderOptions(enhance=wish)).radiance


def broken(kind: str) -> Mesh:
    mesh = ball()
    assert mesh.normals is not None
    if kind == "degenerate faces":
        return replace(mesh, faces=torch.cat([mesh.faces, torch.tensor([[0, 0, 1], [5, 5, 5]])]))
    if kind == "isolated vertices":
        extra = torch.tensor([[0.0, 0, 0]])
        return replace(
            mesh, vertices=torch.cat([mesh.vertices, extra.double()]), normals=torch.cat([mesh.normals, extra])
        )
    if kind == "not manifold":
        return replace(mesh, faces=torch.cat([mesh.faces, mesh.faces[:40], mesh.faces[:40].flip(-1)]))
    if kind == "open":
        return replace(mesh, faces=mesh.faces[::2])
    if kind == "normals inwards":
        return replace(mesh, normals=-mesh.normals)
    if kind == "normals that cancel":
        return replace(
            mesh, normals=torch.where(torch.arange(len(mesh.normals))[:, None] % 2 == 0, mesh.normals, -mesh.normals)
        )
    if kind == "zero normals":
        return replace(mesh, normals=torch.zeros_like(mesh.normals))
    if kind == "no normals":
        return replace(mesh, normals=None)
    return replace(mesh, faces=mesh.faces[:0])


@pytest.mark.parametrize("wish", WISHES, ids=["usual", "all terms", "full", "picture"])
@pytest.mark.parametrize(
    "kind",
    ["degenerate faces", "isolated vertices", "not manifold", "open", "normals inwards", "normals that cancel",
     "zero normals", "no normals", "empty"],
)  # fmt: skip
def test_broken_meshes_give_finite_pictures(kind: str, wish: EnhanceOptions) -> None:
    made = picture(broken(kind), wish)
    assert bool(torch.isfinite(made).all()) and bool((made >= 0).all())


def test_flipped_normals_and_faces_look_the_same() -> None:
    """Normals are turned to the eye, and the strength with them."""
    mesh = ball(4)
    assert mesh.normals is not None
    usual = picture(mesh, WISHES[0])
    torch.testing.assert_close(picture(replace(mesh, normals=-mesh.normals), WISHES[0]), usual, rtol=1e-4, atol=1e-5)


def test_flat_meshes_are_only_scaled() -> None:
    quad = torch.tensor([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    up = torch.tensor([[0.0, 0, 1]]).expand(4, 3)
    flat = Mesh(vertices=quad, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), normals=up)
    scene_plain, made = picture(flat, None), picture(flat, WISHES[0])
    background = scene_plain[0, 0, 0]
    covered = (scene_plain != background).any(-1)
    torch.testing.assert_close(made[covered], 0.8 * scene_plain[covered], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("distance", [1.0, 1.0 + 1e-9, 1.0 - 1e-9])
def test_a_light_on_the_surface_stays_finite(distance: float) -> None:
    lamp = PointLight(position=torch.tensor([0.0, 0.0, distance]), intensity=torch.ones(3))
    for wish in WISHES:
        assert bool(torch.isfinite(picture(ball(), wish, lights=(lamp,))).all())


def test_edge_on_and_inside() -> None:
    quad = torch.tensor([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    flat = Mesh(vertices=quad, faces=torch.tensor([[0, 2, 1], [0, 3, 2]]))
    for height in (0.0, 1e-7, 1e-3):
        eye = Cameras.look_at(
            torch.tensor([[0.0, height, 3.0]]), torch.tensor([[0.0, height, 0.0]]), width=32, height=33
        )
        for wish in WISHES:
            assert bool(torch.isfinite(picture(flat, wish, eye)).all())
    centre = Cameras.look_at(torch.zeros(1, 3), torch.tensor([[0.0, 0.0, 1.0]]), width=32, height=32)
    for wish in WISHES:
        assert bool(torch.isfinite(picture(ball(), wish, centre)).all())


@pytest.mark.parametrize("scale", [2.0**-20, 2.0**20])
def test_it_does_not_depend_on_units(scale: float) -> None:
    mesh = ball(4)
    sun = DirectionalLight(direction=torch.tensor([-1.0, -1.0, -1.0]))
    parts = {"lights": (sun,), "environment": Environment(radiance=torch.rand(8, 16, 3))}

    def view(unit: float) -> Cameras:
        return Cameras.look_at(
            torch.tensor([[0.0, 0.0, 3.0 * unit]]), torch.zeros(1, 3), near=1e-3 * unit, width=48, height=48
        )

    usual = picture(mesh, WISHES[0], view(1.0), **parts)
    other = picture(replace(mesh, vertices=mesh.vertices * scale), WISHES[0], view(scale), **parts)
    assert float(((usual - other).abs() > 1e-3).float().mean()) < 0.01


def test_batches_are_single_pictures() -> None:
    mesh = ball(3)
    eyes = torch.tensor([[0.0, 0.0, 3.0], [3.0, 0.5, 0.0]])
    both = Cameras.look_at(eyes, torch.zeros(2, 3), width=40, height=40)
    for wish in WISHES[:2]:
        made = picture(mesh, wish, both)
        for k in range(2):
            torch.testing.assert_close(made[k : k + 1], picture(mesh, wish, both[k]), rtol=1e-5, atol=1e-6)
    assert picture(mesh, WISHES[0], both[[]]).shape == (0, 40, 40, 3)


def test_everything_around_is_orthographic() -> None:
    camera = Cameras.look_at(torch.tensor([[0.0, 0.0, 3.0]]), torch.zeros(1, 3), width=48, height=48)
    k = camera.intrinsics.clone()
    k[:, :2, :2] *= 0.3
    flat = Cameras(camera.camera_from_world, k, 48, 48, camera.near, torch.tensor([100.0]), orthographic=True)
    for wish in WISHES:
        made = picture(ball(4), wish, flat)
        assert bool(torch.isfinite(made).all())
    assert float((picture(ball(4), WISHES[0], flat) - 0.8 * picture(ball(4), None, flat)).abs().max()) > 0.01
