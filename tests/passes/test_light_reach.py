"""Lights that reach nothing cost nothing, and the plan says so."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torchrender import RenderOptions, render
from torchrender.passes.light.light_reach import LIGHT_REACH
from torchrender.passes.light.shadow_map import SHADOW_MAP
from torchrender.renderer import make_buffers
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

SCENE = build("cornell_box")
AWAY = tuple(
    SpotLight(position=torch.tensor([0.1 * k, 50.0, 0.0]), direction=torch.tensor([0.0, 1.0, 0.0])) for k in range(17)
)
INSIDE = tuple(PointLight(position=SCENE.bounds.mean(0).float() + 0.05 * k) for k in range(2))


def row(image, name):
    assert image.plan is not None
    return image.plan.row(name)


def test_the_plan_says_how_many_lights_reach_nothing() -> None:
    scene = replace(SCENE, lights=(*SCENE.lights, *INSIDE, *AWAY))
    image = render(scene, width=48, height=48)
    assert row(image, "light_reach").reason == "17 of 20 lights reach nothing in view"
    assert row(image, "shadow_map").reason.startswith("3 lights")
    assert row(image, "point_shadow").reason.startswith("2 lights without area")
    alone = render(replace(scene, lights=(*SCENE.lights, *INSIDE)), width=48, height=48)
    assert torch.equal(image.radiance, alone.radiance)


def test_their_maps_are_not_drawn() -> None:
    scene = replace(SCENE, lights=(*AWAY[:2], *INSIDE))
    camera = SCENE.camera(width=48, height=48)
    made = make_buffers(scene, camera, (SHADOW_MAP, LIGHT_REACH), RenderOptions())
    assert made[LIGHT_REACH].any.tolist() == [False, False, True, True]
    other = render(scene, camera, options=RenderOptions(buffers=("point_shadow", "shadow_map")))
    maps, factors = other.buffers["shadow_map"], other.buffers["point_shadow"]
    assert [m is None for m in maps] == [True, True, False, False] and set(factors) == {2, 3}


def test_at_the_sky_and_with_every_light_off_no_shadows_run() -> None:
    up = Cameras.look_at((0.0, 1e4, 0.0), (0.0, 2e4, 1.0), width=32, height=32)
    image = render(SCENE, up)
    for name in ("shadow_map", "soft_shadow", "point_shadow"):
        assert not row(image, name).runs
    assert "reaches what is seen" in row(image, "soft_shadow").reason
    off = replace(SCENE, lights=tuple(replace(light, radiance=torch.zeros(3)) for light in SCENE.lights))
    dark = render(off, width=32, height=32)
    assert row(dark, "shadow_map").reason == "every light is off" and not row(dark, "light_reach").runs


def test_a_light_that_comes_into_view_gets_its_shadows() -> None:
    """In a sequence: what was not needed for one picture is made for the next."""
    lamp = RectLight(
        corner=torch.tensor([-0.2, 0.9, 0.2]), edge_u=torch.tensor([0.0, 0, -0.3]), edge_v=torch.tensor([0.3, 0, 0])
    )
    scene = replace(SCENE, lights=(*SCENE.lights, lamp))
    from torchrender.pipeline.history import RenderHistory

    sky = Cameras.look_at((0.0, 1e4, 0.0), (0.0, 2e4, 1.0), width=48, height=48)
    first = render(scene, sky, history=RenderHistory())
    camera = SCENE.camera(width=48, height=48)
    second = render(scene, camera, history=first.history)
    assert torch.equal(second.radiance, render(scene, camera).radiance)


@pytest.mark.parametrize("dark", [
    PointLight(position=torch.tensor([0.0, 2, 0]), intensity=torch.zeros(3)),
    SpotLight(position=torch.tensor([0.0, 2, 0]), direction=torch.tensor([0.0, -1, 0]), intensity=torch.zeros(3)),
    DirectionalLight(direction=torch.tensor([0.3, -1, -0.4]), irradiance=torch.zeros(3)),
    RectLight(corner=torch.tensor([-0.5, 2, 0]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0.0, 0, 1]),
              radiance=torch.zeros(3)),
], ids=["point", "spot", "sun", "panel"])  # fmt: skip
def test_lights_of_no_strength_are_none_also_in_mirrors(dark: Light) -> None:
    """A dark sun has no map; among hits of rays it was taken for a small light with a place."""
    lamp = PointLight(position=torch.tensor([1.0, 2, 1]), intensity=torch.full((3,), 10.0))
    mirror, red = Material(metallic=1.0, roughness=0.02), Material(diffuse=torch.tensor([0.7, 0.2, 0.1]))
    meshes = [Mesh.plane(4.0), Mesh.box(0.6, [0.0, 0.3, 0.0], material=1)]
    view = Cameras.look_at([1.5, 1.2, 2.0], [0.0, 0.2, 0.0], width=48, height=36)
    scene = Scene(meshes=meshes, materials=[mirror, red], lights=[lamp], ambient=torch.full((3,), 0.2))
    options = RenderOptions(reflections="traced")
    wanted = render(scene, view, options=options).radiance
    for lights in ([lamp, dark], [dark, lamp]):
        torch.testing.assert_close(render(scene.replace(lights=lights), view, options=options).radiance, wanted)
