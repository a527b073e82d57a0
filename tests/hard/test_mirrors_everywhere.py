"""Mirrors where they are hardest: in each other, around the eye, too small, too rough, edge-on, and moving."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from reflection_scenes import looking, placed, rectangle, scene_of, sphere_scene
from torchrender.effects.reflections.clustered import ClusterOptions
from torchrender.effects.reflections.traced import TraceOptions
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.quality.metrics import flip_map
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, sphere

HYBRID = ClusterOptions(missing="trace")
WAYS = {
    "traced": RenderOptions(reflections="traced", shadows=False),
    "hybrid": RenderOptions(reflections="clustered", reflection=HYBRID, shadows=False),
    "clusters": RenderOptions(reflections="clustered", shadows=False),
    "auto": RenderOptions(shadows=False),
}


def shown(scene: Scene, camera: Cameras, way: str) -> Tensor:
    made = render(scene, camera, options=WAYS[way]).radiance[0]
    assert bool(torch.isfinite(made).all())
    return made


def sky() -> Environment:
    rows = torch.linspace(1.0, 0.2, 64)[:, None, None]
    return Environment(radiance=rows.expand(64, 128, 3) * torch.tensor([0.6, 0.8, 1.0]))


@pytest.mark.parametrize("way", WAYS)
def test_a_reflector_that_only_a_mirror_shows(way: str) -> None:
    """A chrome ball behind the eye: the mirror shows it, and it shows the red wall, not black."""
    ball = placed(sphere(0.7, 32), (0.0, 0.0, 4.0), 0)
    scene = scene_of(
        rectangle([-3.0, -3.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 0),
        rectangle([-6.0, -6.0, -0.5], [12.0, 0.0, 0.0], [0.0, 12.0, 0.0], 2),
        rectangle([6.0, -6.0, 8.0], [-12.0, 0.0, 0.0], [0.0, 12.0, 0.0], 2),
        ball,
    )
    camera = Cameras.look_at([0.9, 0.0, 2.0], [0.4, 0.0, 0.0], width=48, height=48, fov_deg=50.0)
    exact, made = shown(scene, camera, "traced"), shown(scene, camera, way)
    assert float((made - exact).abs().mean()) < (0.02 if way != "clusters" else 0.05)
    assert float(made[24, :].amax(dim=-1).min()) > 0.01


@pytest.mark.parametrize("way", WAYS)
def test_a_closed_box_from_outside_and_inside(way: str) -> None:
    metal = Material(specular=1.0, diffuse=torch.zeros(3))
    scene = Scene(meshes=(box(torch.full((3,), 2.0)),), materials=(metal,), environment=sky())
    outside = Cameras.look_at([2.5, 2.0, 3.0], [0.0, 0.0, 0.0], width=32, height=32, fov_deg=45.0)
    exact, made = (shown(scene, outside, w) for w in ("traced", way))
    assert float(flip_map(made[None].clamp(0, 1), exact[None].clamp(0, 1)).mean()) < 0.03
    inside = Cameras.look_at([0.2, 0.1, 0.3], [1.0, 0.2, 0.0], width=32, height=32, fov_deg=80.0, near=1e-3)
    shown(scene, inside, way)  # mirrors without end: finite is all there is to say


def test_a_million_tiny_reflectors() -> None:
    count = 1_000_000
    generator = torch.Generator().manual_seed(1)
    middle = torch.rand(count, 1, 3, generator=generator) * 2.0 - 1.0
    corners = middle + 4e-3 * torch.randn(count, 3, 3, generator=generator)
    glitter = Mesh(vertices=corners.reshape(-1, 3), faces=torch.arange(3 * count).reshape(-1, 3), material=0)
    metal = Material(specular=1.0, diffuse=torch.zeros(3))
    scene = Scene(meshes=(glitter,), materials=(metal,), environment=Environment.constant(torch.ones(3)))
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=48, height=48, fov_deg=40.0)
    made = render(scene, camera, options=replace(WAYS["auto"], ambient_visibility="off")).radiance[0]
    assert float(made.min()) > 0.9 and float(made.max()) < 1.0 + 1e-5  # a sky that is white everywhere


@pytest.mark.parametrize("gloss", [0.0, 1e-4, 1.0])
@pytest.mark.parametrize("way", ["traced", "hybrid"])
def test_roughness_from_end_to_end(gloss: float, way: str) -> None:
    scene = sphere_scene(gloss=gloss)
    camera = looking(32)
    made, mirror = shown(scene, camera, way), shown(sphere_scene(), camera, way)
    if gloss < 0.1:
        # Glossy hits share what ambient light they get, an exact mirror's have their own few rays.
        assert float((made - mirror).abs().mean()) < (2e-3 if gloss == 0.0 else 4e-3)
    else:  # rougher is smoother: the checks of the walls are blurred away
        ball = made[14:18, 14:18]
        assert float(ball.std()) < float(mirror[14:18, 14:18].std()) + 0.05


@pytest.mark.parametrize("way", WAYS)
def test_a_mirror_seen_edge_on(way: str) -> None:
    """89.99 degrees off its normal: the mirror shows the card as if it were not there, mirrored at a line."""
    angle = math.radians(89.99)
    far = 30.0
    eye = [0.0, far * math.cos(angle) + 1e-9, far * math.sin(angle)]
    scene = scene_of(
        rectangle([-20.0, 0.0, 20.0], [40.0, 0.0, 0.0], [0.0, 0.0, -40.0], 0),
        rectangle([-40.0, -1.0, -25.0], [80.0, 0.0, 0.0], [0.0, 40.0, 0.0], 2),
    )
    camera = Cameras.look_at(eye, [0.0, 0.0, 0.0], width=64, height=64, fov_deg=1.0)
    exact, made = shown(scene, camera, "traced"), shown(scene, camera, way)
    assert float((made - exact).abs().mean()) < 0.02


def test_what_moves_is_never_the_reflection_of_before() -> None:
    """A moving reflected object, then a moving reflector, in one sequence: each picture is that of a fresh start."""
    options = RenderOptions(reflections="traced", tracing=TraceOptions(glossy_rays=1), shadows=False)
    base = sphere_scene()
    camera = looking(32)
    scenes = [base]
    block = base.meshes[1]
    scenes.append(replace(base, meshes=(base.meshes[0], placed(block, (0.4, 0.0, 0.0), 2), *base.meshes[2:])))
    moved = placed(base.meshes[0], (0.0, 0.3, 0.0), 0)
    scenes.append(replace(base, meshes=(moved, *scenes[1].meshes[1:])))
    history = RenderHistory()
    for scene in scenes:
        image = render(scene, camera, options=options, history=history)
        assert image.history is not None
        history = image.history
        alone = render(scene, camera, options=options)
        torch.testing.assert_close(image.radiance, alone.radiance)


@pytest.mark.parametrize("turn", [0.0, 0.37, 1.1])
@pytest.mark.parametrize("way", WAYS)
def test_a_mirror_shows_the_floor_it_stands_on_up_to_where_they_meet(way: str, turn: float) -> None:
    """The floor is the top of a box: no ray sees that from inside, however near to it the ray begins."""
    c, s = math.cos(turn), math.sin(turn)
    spun = torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]], dtype=torch.float64)
    away = torch.tensor([0.123, 0.377, -0.71], dtype=torch.float64)
    floor = box(torch.tensor([4.0, 0.4, 4.0]))
    corners = [[-1.3, 0.0, -0.7], [1.3, 0.0, -0.7], [1.3, 1.7, -0.7], [-1.3, 1.7, -0.7]]
    low = torch.tensor([0.0, float(floor.vertices[:, 1].max()), 0.0], dtype=torch.float64)
    wall = torch.tensor(corners, dtype=torch.float64) @ spun.T + away
    meshes = [
        Mesh(vertices=(floor.vertices.double() - low) @ spun.T + away, faces=floor.faces, name="floor"),
        Mesh(vertices=wall, faces=[[0, 1, 2], [0, 2, 3]], material=1, name="wall"),
    ]
    materials = [Material(diffuse=torch.full((3,), 0.6)), Material(diffuse=torch.zeros(3), specular=1.0)]
    scene = Scene(meshes=meshes, materials=materials, ambient=torch.full((3,), 0.5))
    eye, target = (torch.tensor(p, dtype=torch.float64) @ spun.T + away for p in ([0.6, 1.1, 2.9], [0.0, 0.3, -0.7]))
    camera = Cameras.look_at(eye.tolist(), target.tolist(), width=480, height=360, fov_deg=45.0)
    made = render(scene, camera, options=replace(WAYS[way], ambient_visibility="off"))
    seen = made.gbuffer
    foot = (seen.object_id[0] == 1) & (seen.position[0, ..., 1] < 0.3 + float(away[1]))
    assert int(foot.sum()) > 1000
    assert float(made.radiance[0][foot].amin()) > 0.2
