"""Mirrors seen in mirrors: closed forms of infinite mirrors, and what ends them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from reflection_scenes import LIGHT, looking, placed, prepared, rectangle, scene_of, sphere_scene
from torchrender.effects.reflections.bounces import traced_onward
from torchrender.effects.reflections.clustered import ClusterOptions, clustered_reflections
from torchrender.effects.reflections.traced import TraceOptions, trace_reflections
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.metrics import psnr
from torchrender.rays import RayCaster
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, sphere

GLOW, SHARE, ROOM = 0.6, 0.8, 2.0


def hall(gap: float = ROOM) -> Scene:
    """Two mirrors that face each other at z = 0 and z = ``gap``, of which the second has a stripe that glows."""
    silver = Material(name="silver", specular=1.0, specular_color=torch.full((3,), SHARE), diffuse=torch.zeros(3))
    glow = Material(name="glow", diffuse=torch.zeros(3), emission=torch.full((3,), GLOW))
    far = 200.0
    return Scene(
        meshes=(
            rectangle([-far, -far, 0.0], [2 * far, 0.0, 0.0], [0.0, 2 * far, 0.0], 0),
            rectangle([far, -far, gap], [-2 * far, 0.0, 0.0], [0.0, 2 * far, 0.0], 0),
            rectangle([far, -0.2, gap - 1e-3], [-2 * far, 0.0, 0.0], [0.0, 0.4, 0.0], 1),
        ),
        materials=(silver, glow),
        ambient=torch.zeros(3),
        lights=(replace(LIGHT, intensity=torch.zeros(3)),),
    )


def hall_radiance(eye: Tensor, direction: Tensor, depth: int) -> Tensor:
    """What arrives (N,): unfolded, the stripe repeats at odd multiples of the gap, weaker by two mirrors each time."""
    found = torch.zeros(len(direction), dtype=torch.float64)
    open_ = torch.ones(len(direction), dtype=torch.bool)
    for mirrors in range(1, depth + 1):
        if mirrors % 2 == 0:
            continue  # the ray meets the first mirror again
        along = (eye[2] + mirrors * ROOM) / -direction[:, 2]
        y = eye[1] + along * direction[:, 1]
        seen = open_ & (y.abs() < 0.2)
        found = torch.where(seen, GLOW * SHARE**mirrors, found)
        open_ = open_ & ~seen
    return found


def test_infinite_mirrors_are_those_of_the_closed_form() -> None:
    scene = hall()
    eye = torch.tensor([0.0, 1.2, 1.0], dtype=torch.float64)
    camera = Cameras.look_at(eye.tolist(), [0.0, 1.0, 0.0], width=64, height=64, fov_deg=60.0)
    shown = render(scene, camera, options=RenderOptions(reflections="traced", tracing=TraceOptions(bounces=8)))
    directions = torch.nn.functional.normalize(camera.rays()[1].reshape(-1, 3), dim=-1)
    wanted = hall_radiance(eye, directions, 8).reshape(1, 64, 64, 1).expand(-1, -1, -1, 3)
    assert len(wanted.unique()) >= 4  # several pictures of the stripe
    assert float(psnr(shown.radiance.double(), wanted)[0]) > 30.0
    flat = render(scene, camera, options=RenderOptions(reflections="traced", tracing=TraceOptions(bounces=2)))
    assert float(psnr(flat.radiance.double(), wanted)[0]) < float(psnr(shown.radiance.double(), wanted)[0])


@pytest.mark.parametrize("way", ["traced", "clustered", "environment"])
def test_mirrors_in_mirrors_are_not_black(way: str) -> None:
    """Two facing mirrors under a white sky: nothing that they show is dark, however deep it lies."""
    silver = Material(specular=1.0, diffuse=torch.zeros(3))
    scene = Scene(
        meshes=(
            rectangle([-2.0, -1.0, 0.0], [4.0, 0.0, 0.0], [0.0, 2.0, 0.0], 0),
            rectangle([2.0, -1.0, 3.0], [-4.0, 0.0, 0.0], [0.0, 2.0, 0.0], 0),
        ),
        materials=(silver,),
        environment=Environment.constant(torch.ones(3)),
    )
    camera = Cameras.look_at([0.0, 0.0, 1.5], [0.2, 0.0, 0.0], width=20, height=20, fov_deg=70.0)
    shown = render(scene, camera, options=RenderOptions(reflections=way)).radiance
    assert float(shown.min()) > 0.95


def test_one_bounce_is_the_guess_and_asks_nobody() -> None:
    scene = sphere_scene()
    _, pixels, shader = prepared(scene, looking(24))
    caster = RayCaster(scene.geometry)
    assert traced_onward(caster, shader, 1) is None
    one, two = (trace_reflections(caster, pixels, shader, TraceOptions(bounces=n)).color for n in (1, 2))
    assert torch.equal(one, two)  # a convex mirror alone sees no mirror
    assert torch.isfinite(two).all()


def test_clusters_follow_mirrors_in_mirrors_as_rays_do() -> None:
    ball = placed(sphere(0.5, 24), (0.0, 0.0, 1.5), 3)
    scene = scene_of(
        rectangle([-3.0, -3.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 0), ball, *sphere_scene().meshes[1:]
    )
    camera = Cameras.look_at([0.0, 1.0, 2.9], [0.0, 0.0, 0.0], width=48, height=48, fov_deg=60.0)
    _, pixels, shader = prepared(scene, camera)
    caster = RayCaster(scene.geometry)
    onward = traced_onward(caster, shader, 2)
    options = ClusterOptions(missing="trace")
    layers = [
        clustered_reflections(scene, pixels, shader, options, caster=lambda: caster, onward=onward).layer.color,
        trace_reflections(caster, pixels, shader, TraceOptions(bounces=2)).color,
        trace_reflections(caster, pixels, shader, TraceOptions(bounces=1)).color,
    ]
    same = (layers[0] - layers[1]).abs().mean()
    assert float(same) < 0.2 * float((layers[2] - layers[1]).abs().mean())


@pytest.mark.parametrize("model", ["phong", "metal"])
@pytest.mark.parametrize("way", ["traced", "clustered", "environment"])
@pytest.mark.parametrize("gloss", [0.0, 1e-4, 0.3, 0.6, 1.0])
def test_rough_mirrors_under_an_even_sky_send_all_of_it(gloss: float, way: str, model: str) -> None:
    """White furnace: what facets hide from each other comes back from others, whatever way reflections are found."""
    metal = Material(specular=1.0, gloss=gloss, diffuse=torch.zeros(3))
    if model == "metal":
        metal = Material(metallic=1.0, roughness=gloss, diffuse=torch.ones(3))
    scene = Scene(
        meshes=(replace(sphere(1.0, 32), material=0),),
        materials=(metal,),
        environment=Environment.constant(torch.ones(3)),
    )
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=32, height=32, fov_deg=40.0)
    made = render(scene, camera, options=RenderOptions(reflections=way, tracing=TraceOptions(glossy_rays=4)))
    shown = made.radiance[made.gbuffer.covered]
    torch.testing.assert_close(shown, torch.ones_like(shown), rtol=0.0, atol=0.01)


def test_a_closed_metal_object_mirrors_what_lies_outside_it() -> None:
    """The middle of the scene lies inside the box: no way may show its inside."""
    metal = Material(specular=1.0, diffuse=torch.zeros(3))
    scene = Scene(meshes=(box(torch.ones(3)),), materials=(metal,), environment=Environment.constant(torch.ones(3)))
    camera = Cameras.look_at([1.5, 1.2, 2.0], [0.0, 0.0, 0.0], width=32, height=32, fov_deg=50.0)
    for way in ("environment", "clustered", "traced", "auto"):
        shown = render(scene, camera, options=RenderOptions(reflections=way)).radiance
        assert float(shown.min()) > 0.95, way


def test_a_camera_inside_a_chrome_sphere_sees_the_lamp_again_and_again() -> None:
    chrome = Material(specular=0.9, diffuse=torch.full((3,), 0.1))
    lamp = Material(diffuse=torch.zeros(3), emission=torch.full((3,), 3.0))
    shell = replace(sphere(2.0, 48), material=0)
    bulb = placed(sphere(0.3, 24), (0.5, 0.3, -0.8), 1)
    scene = Scene(meshes=(shell, bulb), materials=(chrome, lamp), ambient=torch.full((3,), 0.05))
    camera = Cameras.look_at([0.2, 0.0, 1.0], [0.0, 0.0, -2.0], width=32, height=32, fov_deg=90.0)
    seen = [
        render(scene, camera, options=RenderOptions(reflections="traced", tracing=TraceOptions(bounces=n))).radiance
        for n in (1, 2, 4)
    ]
    assert all(bool(torch.isfinite(image).all()) for image in seen)
    assert float((seen[2] - seen[1]).abs().mean()) < float((seen[1] - seen[0]).abs().mean()) + 0.05
    assert float(seen[2].mean()) > 0.03


def test_clusters_alone_follow_mirrors_in_mirrors() -> None:
    """Two facing mirrors and a card between them: what the second mirror shows in the first, without any ray."""
    scene = scene_of(
        rectangle([-2.0, -1.5, 0.0], [4.0, 0.0, 0.0], [0.0, 3.0, 0.0], 0),
        rectangle([2.0, -1.5, 4.0], [-4.0, 0.0, 0.0], [0.0, 3.0, 0.0], 0),
        rectangle([-0.6, -0.6, 2.6], [1.2, 0.0, 0.0], [0.0, 1.2, 0.0], 1),
    )
    camera = Cameras.look_at([0.9, 0.8, 2.0], [-0.2, 0.0, 0.0], width=64, height=64, fov_deg=60.0)
    options = [
        RenderOptions(reflections=way, tracing=TraceOptions(bounces=n), shadows=False)
        for way, n in (("traced", 2), ("clustered", 2), ("clustered", 1))
    ]
    exact, ours, guess = (render(scene, camera, options=o).radiance for o in options)
    error, before = float((ours - exact).abs().mean()), float((guess - exact).abs().mean())
    assert error < 0.3 * before and error < 0.02
