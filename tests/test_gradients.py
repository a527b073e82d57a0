"""Gradients reach what the documentation says, and are refused by name elsewhere: none is lost in silence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.errors import GradientError
from torchrender.reconstruct.hybrid import reconstruct_grid, reconstruct_hybrid

CAMERA = tr.Cameras.look_at([1.5, 1.5, 2], [0, 0, 0], width=12, height=10)
BOX = tr.Mesh.box(1.0)
OPTIONS = tr.RenderOptions(reflections="off")


def wanted(*shape: int, value: float = 0.5) -> Tensor:
    return torch.full(shape, value, requires_grad=True)


def mesh(**changes: Tensor) -> tr.Mesh:
    return replace(BOX, **changes)


def scene(box: tr.Mesh = BOX, **changes: object) -> tr.Scene:
    lamp = tr.PointLight(position=[2, 3, 4], intensity=20)
    return tr.Scene(meshes=[box], lights=[lamp]).replace(**changes)


@pytest.mark.parametrize("vary", [
    lambda v: {"materials": [tr.Material(diffuse=v)]},
    lambda v: {"materials": [tr.Material(emission=v)]},
    lambda v: {"lights": [tr.PointLight(position=[2, 3, 4], intensity=20 * v)]},
    lambda v: {"lights": [tr.RectLight(corner=[1, 2, 1], edge_u=[1, 0, 0], edge_v=[0, 0, 1], radiance=v)]},
    lambda v: {"ambient": v},
    lambda v: {"environment": tr.Environment(radiance=v.expand(4, 8, 3))},
], ids=["diffuse", "emission", "point", "area", "ambient", "sky"])  # fmt: skip
def test_pictures_carry_gradients_to_light_and_colour(vary: Callable[[Tensor], dict]) -> None:
    """Against a finite difference: pictures are linear in each of these, so it is exact but for rounding."""
    value = wanted(3)
    tr.render(scene(**vary(value)), CAMERA, options=OPTIONS).radiance.sum().backward()
    assert value.grad is not None and bool((value.grad > 0).all())
    with torch.no_grad():
        sums = [
            tr.render(scene(**vary(torch.full((3,), at))), CAMERA, options=OPTIONS).radiance.sum() for at in (0.4, 0.6)
        ]
    assert float(value.grad.sum()) == pytest.approx(float(sums[1] - sums[0]) / 0.2, rel=2e-3)


def test_places_of_lights_carry_gradients_with_shadows_as_they_are() -> None:
    options = replace(OPTIONS, shadows=False)

    def brightness(place: Tensor) -> Tensor:
        lamp = tr.PointLight(position=place, intensity=20)
        return tr.render(scene(lights=[lamp]), CAMERA, options=options).radiance.double().sum()

    place = torch.tensor([2.0, 3.0, 4.0], dtype=torch.float64, requires_grad=True)
    brightness(place).backward()
    assert place.grad is not None
    for axis in range(3):
        step = torch.zeros(3, dtype=torch.float64)
        step[axis] = 0.02
        with torch.no_grad():
            slope = (brightness(place + step) - brightness(place - step)) / 0.04
        assert float(place.grad[axis]) == pytest.approx(float(slope), rel=0.02)


VERTICES = BOX.vertices.clone().requires_grad_()
RADIUS = torch.tensor(0.4, dtype=torch.float64, requires_grad=True)
AREA = tr.RectLight(corner=[1, 2, 1], edge_u=[1, 0, 0], edge_v=[0, 0, 1], radiance=5)
EDGES = torch.tensor([[-2.0], [2.0]])
RAYS = torch.tensor([[0.0, 0.0, 3.0]])
LOST: dict[str, tuple[Callable[[], object], str]] = {
    "render": (lambda: tr.render(scene(mesh(vertices=VERTICES)), CAMERA), "vertices of mesh 'box'"),
    "render colours of vertices": (
        lambda: tr.render(scene(mesh(colors=wanted(24, 3))), CAMERA),
        "colors of mesh 'box'",
    ),
    "rasterize": (lambda: tr.rasterize(scene(mesh(vertices=VERTICES)), CAMERA), "rasterize gives no gradient"),
    "rasterize_depth": (lambda: tr.rasterize_depth(mesh(vertices=VERTICES), CAMERA), "vertices of mesh 'box'"),
    "depth images": (
        lambda: tr.sample_depth_images(scene(mesh(vertices=VERTICES)), CAMERA),
        "sample_depth_images gives no gradient",
    ),
    "camera": (
        lambda: replace(CAMERA, intrinsics=CAMERA.intrinsics.clone().requires_grad_()),
        "a camera gives no gradient to intrinsics",
    ),
    "tree": (lambda: tr.RayCaster(mesh(vertices=VERTICES)), "vertices of mesh 'box'"),
    "rays": (lambda: tr.RayCaster(BOX).first_hit(RAYS.clone().requires_grad_(), -RAYS), "casting rays .* to origins"),
    "voxels": (lambda: tr.voxelize_solid(VERTICES[None], BOX.faces, 8), "voxelization gives no gradient to vertices"),
    "eye": (lambda: tr.Cameras.look_at(wanted(3), [0, 0, 3], width=8, height=8), "a camera gives no gradient to eye"),
    "opening angle": (
        lambda: tr.Cameras.look_at([0, 0, 3], [0, 0, 0], fov_deg=wanted(value=40.0), width=8, height=8),
        "a camera gives no gradient to fov_deg",
    ),
    "cone": (
        lambda: tr.SpotLight(position=[0, 2, 0], direction=[0, -1, 0], intensity=1, outer_deg=wanted(value=40.0)),
        "a light gives no gradient to outer_deg",
    ),
    "turned sky": (
        lambda: tr.Environment(radiance=torch.ones(4, 8, 3), rotation_deg=wanted(value=40.0)),
        "an environment gives no gradient to rotation_deg",
    ),
    "strength of the sky": (
        lambda: tr.Environment(radiance=torch.ones(4, 8, 3), intensity=wanted(value=2.0)),
        "an environment gives no gradient to intensity",
    ),
    "height of a haze": (
        lambda: tr.Medium(low=[-1, -1, -1], high=[1, 1, 1], floor=wanted(value=0.5)),
        "a medium gives no gradient to floor",
    ),
    "panes": (
        lambda: tr.render(
            scene(materials=[tr.Material(metallic=0.0, transmission=0.8, transmission_texture=wanted(2, 2, 3))]), CAMERA
        ),
        "render gives no gradient to transmission_texture of material",
    ),
    "bumps of mirrors": (
        lambda: tr.render(
            scene(materials=[tr.Material(metallic=0.5, roughness=0.5, normal_texture=wanted(2, 2, 3))]), CAMERA
        ),
        "render with reflections .there is reflections='off'. gives no gradient to normal_texture of material",
    ),
    "box of a shadow": (
        lambda: tr.soft_shadow(scene(), AREA, tr.rasterize(scene(), CAMERA), bounds=wanted(2, 3) * EDGES),
        "soft_shadow gives no gradient to bounds",
    ),
    "placement": (
        lambda: tr.collide(BOX, BOX, world_from_second=torch.eye(4).requires_grad_()),
        "collide gives no gradient to world_from_second",
    ),
    "grid": (lambda: tr.make_grid(VERTICES[None], 8), "make_grid gives no gradient to points"),
    "implicit": (
        lambda: tr.voxelize_implicit(lambda p: p.norm(dim=-1) - RADIUS, tr.make_grid(BOX.vertices[None], 8)),
        "voxelize_implicit gives no gradient to values of function",
    ),
    "parametric": (
        lambda: tr.voxelize_parametric(
            lambda q: torch.cat([q, q[:, :1]], dim=-1) * RADIUS, ((0, 1), (0, 1)), tr.make_grid(BOX.vertices[None], 8)
        ),
        "voxelize_parametric gives no gradient to points of surface",
    ),
    "enhanced depth": (
        lambda: tr.enhance_picture(CAMERA, torch.ones(1, 10, 12, 3), wanted(1, 10, 12)),
        "enhance_picture gives no gradient to depth",
    ),
    "points": (lambda: tr.PointCloud(position=wanted(4, 3)), "a point cloud gives no gradient to position"),
}


@pytest.mark.parametrize("name", LOST)
def test_what_gives_none_says_so(name: str) -> None:
    call, told = LOST[name]
    with pytest.raises(GradientError, match=told):
        call()
    with torch.no_grad():
        call()  # says that none is wanted


def asking(buffers: Any, field: str) -> Any:
    return replace(buffers, **{field: getattr(buffers, field).clone().requires_grad_()})


@pytest.mark.parametrize(("call", "field", "told"), [
    (lambda images: tr.reproject(images, CAMERA), "depth", "reproject gives no gradient to images.depth"),
    (lambda images: tr.reproject(images, CAMERA), "normal", "reproject gives no gradient to images.normal"),
    (reconstruct_hybrid, "depth", "reconstruct_hybrid gives no gradient to images.depth"),
    (reconstruct_grid, "position", "reconstruct_grid gives no gradient to images.position"),
    (lambda images: tr.sample_offset_images(scene(), images), "depth", "sample_offset_images gives no gradient"),
])  # fmt: skip
def test_depth_images_that_ask_for_gradients_are_refused(call: Callable[[Any], object], field: str, told: str) -> None:
    images = tr.sample_depth_images(scene(), CAMERA)
    with pytest.raises(GradientError, match=told):
        call(asking(images, field))
    with torch.no_grad():
        call(asking(images, field))


@pytest.mark.parametrize(("call", "field", "told"), [
    (lambda seen: tr.soft_shadow(scene(), AREA, seen), "position", "soft_shadow gives no gradient to gbuffer.position"),
    (lambda seen: tr.soft_shadow(scene(), AREA, seen), "normal", "soft_shadow gives no gradient to gbuffer.normal"),
    (lambda seen: tr.flow(seen, tr.rasterize(scene(), CAMERA)), "depth", "flow gives no gradient to a.depth"),
    (lambda seen: tr.flow(tr.rasterize(scene(), CAMERA), seen), "depth", "flow gives no gradient to b.depth"),
    (lambda seen: tr.visibility(CAMERA, seen), "position", "visibility gives no gradient to gbuffer.position"),
])  # fmt: skip
def test_g_buffers_that_ask_for_gradients_are_refused(call: Callable[[Any], object], field: str, told: str) -> None:
    seen = tr.rasterize(scene(), CAMERA)
    with pytest.raises(GradientError, match=told):
        call(asking(seen, field))


def test_bumps_of_what_does_not_mirror_carry_gradients_by_default() -> None:
    bumps = (torch.full((2, 2, 3), 0.5) + torch.tensor([0.1, 0.0, 0.5])).requires_grad_()
    floor = tr.Mesh(
        vertices=[[-2.0, 0, -2], [-2, 0, 2], [2, 0, 2], [2, 0, -2]],
        faces=[[0, 1, 2], [0, 2, 3]],
        uv=[[0.0, 0], [1, 0], [1, 1], [0, 1]],
    )
    tr.render(scene(floor, materials=[tr.Material(normal_texture=bumps)]), CAMERA).radiance.sum().backward()
    assert bumps.grad is not None and float(bumps.grad.abs().sum()) > 0


def test_lists_are_taken_where_arrays_are() -> None:
    caster = tr.RayCaster(BOX)
    assert float(caster.first_hit([[0, 0, 3]], [[0, 0, -1]]).t) == pytest.approx(2.5)
    assert bool(caster.occluded([[0.0, 0, 3]], [[0.0, 0, -1]]))
    cloud = tr.PointCloud(position=[[0, 0, 0], [1, 0, 0]], color=[[1, 0, 0], [0, 1, 0]], radius=[0.1, 0.1])
    assert cloud.position.dtype == torch.float64 and cloud.color is not None and cloud.color.dtype == torch.float32
    assert tr.make_grid([[[0, 0, 0], [1, 1, 1]]], 8).dims == (8, 8, 8)
    solid, _ = tr.voxelize_solid(BOX.vertices.tolist(), BOX.faces.tolist(), 8)
    assert solid.equals(tr.voxelize_solid(BOX, 8)[0])
    with pytest.raises(tr.TorchRenderError, match="rows of one length"):
        caster.first_hit([[0, 0, 3], [1]], [[0, 0, -1]])
