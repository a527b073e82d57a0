"""Pictures of a scene in which something moves are those of a scene built anew, and what stands still is kept."""

from __future__ import annotations

import math

import pytest
import torch

import torchrender as tr
from torchrender.buffers import ShadowMap
from torchrender.effects.shadows import shadow_map
from torchrender.effects.shadows.movers import windows_of, with_movers
from torchrender.effects.shadows.shadow_map import render_shadow_map
from torchrender.passes.light.point_shadow import STANDING_POINT_SHADOW
from torchrender.passes.light.standing_maps import STANDING_MAPS
from torchrender.passes.mirrors.hit_shader import HIT_SHADER
from torchrender.pipeline.standing import swept
from torchrender.scene.light import Light
from torchrender.scene.model import Scene

LAMP = tr.RectLight(corner=[-0.5, 2.9, -0.5], edge_u=[1, 0, 0], edge_v=[0, 0, 1], radiance=8.0)
BULB = tr.PointLight(position=[1.2, 2.2, 0.6], intensity=3.0)
SUN = tr.DirectionalLight(direction=[0.4, -1.0, -0.3], irradiance=1.0)


def room(*lights: Light) -> Scene:
    """A box with a mirror for a wall, something that stands and something that will move."""
    mirror = tr.Material(name="mirror", diffuse=[0.1, 0.1, 0.1], specular=0.9)
    return Scene(
        meshes=[
            tr.Mesh.plane(6.0, name="floor"),
            tr.Mesh.box([4.0, 2.0, 0.1], [0.0, 1.2, -2.0], name="glass", material=1),
            tr.Mesh.sphere(0.5, [-1.0, 0.5, 0.0], segments=24, name="ball"),
            tr.Mesh.box(0.6, [0.9, 0.3, 0.2], name="crate"),
        ],
        materials=[tr.Material(name="grey", diffuse=[0.6, 0.5, 0.4]), mirror],
        lights=lights,
        ambient=[0.05, 0.05, 0.05],
        name="room",
    )


def step(number: int) -> torch.Tensor:
    """(4,4) a turn and a shift."""
    matrix = torch.eye(4, dtype=torch.float64)
    angle = 0.25 * number
    matrix[0, 0] = matrix[2, 2] = math.cos(angle)
    matrix[0, 2], matrix[2, 0] = math.sin(angle), -math.sin(angle)
    matrix[0, 3] = -0.12 * number
    return matrix


VIEW = tr.Cameras.look_at([0.6, 1.7, 4.0], [0.0, 0.7, -0.6], width=96, height=72, fov_deg=55.0)


@pytest.mark.parametrize("lights", [(LAMP, BULB), (SUN,)], ids=["lamps", "sun"])
@pytest.mark.parametrize("walks", [False, True], ids=["still eye", "walking eye"])
def test_moved_pictures_are_those_of_a_scene_built_anew(lights: tuple[Light, ...], walks: bool) -> None:
    scene, history = room(*lights), tr.RenderHistory()
    for number in range(5):
        eye = [0.6 + 0.1 * number * walks, 1.7, 4.0]
        view = tr.Cameras.look_at(eye, [0.0, 0.7, -0.6], width=96, height=72, fov_deg=55.0)
        moved = scene.moved("crate", step(number))
        image = tr.render(moved, view, history=history)
        assert image.history is not None
        history = image.history
        fresh = tr.render(moved.replace(name="fresh"), view)
        apart = 255.0 * (image.to_srgb() - fresh.to_srgb()).abs()
        assert float(apart.mean()) < 0.3, number
        assert float((apart.amax(-1) > 8.0).double().mean()) < 0.01, number


def test_what_stands_still_is_kept() -> None:
    scene, history = room(LAMP, BULB), tr.RenderHistory()
    kept = []
    for number in range(4):
        history = tr.render(scene.moved("crate", step(number)), VIEW, history=history).history
        kept.append(history.last(STANDING_MAPS))
    assert [len(one.meshes) for one in kept] == [4, 3, 3, 3]
    assert kept[3].everything[0] is kept[2].everything[0] and kept[3].picture[1] is kept[2].picture[1]
    memory = history.last(HIT_SHADER).memory
    assert memory.known is not None and len(memory.known.key) > 0
    assert history.last(STANDING_POINT_SHADOW).visibility.keys() == {1}


def test_a_view_that_stands_still_is_not_looked_up_again(monkeypatch) -> None:
    scene, history = room(BULB), tr.RenderHistory()
    first = tr.render(scene, VIEW, history=history)
    asked = []
    look_up = shadow_map._look_up

    def counting(points, normals, *rest):
        asked.append(int((normals != 0).any(-1).sum()))
        return look_up(points, normals, *rest)

    monkeypatch.setattr("torchrender.effects.shadows.shadow_map._look_up", counting)
    moved = scene.moved("crate", step(1))
    second = tr.render(moved, VIEW, history=first.history)
    covered = int(second.gbuffer.covered.sum())
    assert asked and 0 < asked[0] < 0.7 * covered


def test_movers_drawn_into_a_map_are_as_if_drawn_with_it() -> None:
    scene = room(LAMP, BULB, SUN)
    still = scene.replace(meshes=[m for m in scene.meshes if m.name != "crate"])
    movers = scene.replace(meshes=[scene.mesh("crate")]).geometry
    options = tr.ShadowOptions(size=128)
    for light in scene.lights:
        whole = render_shadow_map(scene, light, options)
        from_both = with_movers(ShadowMap(whole.cameras, render_of(still, whole.cameras)), movers)
        close = torch.isclose(from_both.depth, whole.depth, rtol=1e-6, atol=0.0) | (from_both.depth == whole.depth)
        assert float((~close).double().mean()) < 1e-4  # windows are other pictures: rounding at edges
        assert 0 < len(windows_of(whole.cameras, movers)) < max(len(whole.cameras), 2)


def render_of(scene: Scene, cameras: tr.Cameras) -> torch.Tensor:
    return tr.rasterize(scene, cameras, outputs=("depth",))["depth"]


def test_what_moved_is_known_by_its_boxes_and_its_shadows() -> None:
    scene = room(BULB, SUN)
    after = scene.moved("crate", step(2))
    moved = swept(scene.meshes, after.meshes)
    assert moved is not None and moved.meshes == {3}
    behind = scene.lights[0].position + 1.5 * (torch.tensor([0.9, 0.3, 0.2]) - scene.lights[0].position)
    points = torch.stack([torch.tensor([-2.5, 0.0, 2.5]).double(), behind.double()])
    assert moved.misses(points, scene.lights, scene.diagonal).tolist() == [[True, True], [False, False]]
    assert moved.beyond(points, 0.8).tolist() == [True, False]
    assert swept(scene.meshes, scene.meshes[:3]) is None
    assert swept(scene.meshes, scene.meshes).meshes == frozenset()
