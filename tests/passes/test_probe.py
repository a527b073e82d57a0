"""Probes: what they find in a few pixels is what the two pictures really differ by."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch

import torchrender as tr
from torchrender.passes.light.probe import MOST_LIGHTS
from torchrender.passes.senses import closely
from torchrender.passes.settings import CUSTOM
from torchrender.passes.table import PASSES
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.planning.costs import sense_of
from torchrender.scene.model import Scene

SIDE = 40  # every pixel is probed
FLOOR, BOX = tr.Mesh.plane(4.0, name="floor"), tr.Mesh.box((0.6, 0.8, 0.6), (0.0, 0.4, 0.0), name="box")
LAMP = tr.PointLight(position=(1.5, 2.5, 0.5), intensity=(9.0, 9.0, 9.0))
PANEL = tr.RectLight(corner=(0.6, 1.4, 0.2), edge_u=(0.8, 0.0, 0.0), edge_v=(0.0, 0.0, 0.8), radiance=(6.0, 6.0, 6.0))
CAMERA = tr.Cameras.look_at((2.0, 2.0, 2.5), (0, 0.2, 0), width=SIDE, height=SIDE)


def options(**changes: Any) -> RenderOptions:
    return RenderOptions(exposure=0.0, supersample=1.0, ambient_visibility="off", reuse=None, **changes)


def probed(scene: Scene, name: str, **changes: Any) -> float | None:
    made = options(**changes)
    held = tuple(p.name for p in PASSES if p.settings.is_choice and p.settings.current(made) != CUSTOM)
    image = tr.render(scene, CAMERA, history=RenderHistory(), budget_ms=1e9, options=replace(made, fixed=held))
    assert image.history is not None and image.history.pace is not None
    return image.history.pace.known.get(sense_of(closely(name)))


def apart(scene: Scene, name: str, *values: str, **changes: Any) -> float:
    first, second = (tr.render(scene, CAMERA, options=options(**{name: v}, **changes)).to_srgb() for v in values)
    return float((first - second).abs().mean())


def test_light_of_rectangles_is_probed_by_both_ways_of_it() -> None:
    scene = Scene(meshes=(FLOOR, BOX), lights=(PANEL,), ambient=torch.full((3,), 0.1), name="panel")
    found = probed(scene, "direct_light", area_shadows="hard")
    wanted = apart(scene, "area_light", "polygon", "centre", area_shadows="hard")
    assert wanted > 1e-3 and found == pytest.approx(wanted, rel=0.02)


def test_mirrors_are_probed_by_their_surroundings() -> None:
    meshes = (replace(FLOOR, material=1), replace(BOX, material=0))
    materials = (tr.Material(diffuse=(0.9, 0.2, 0.1)), tr.Material(diffuse=(0.5, 0.5, 0.5), specular=0.7))
    scene = Scene(meshes=meshes, materials=materials, lights=(LAMP,), ambient=torch.full((3,), 0.2), name="mirror")
    found = probed(scene, "reflections", reflections="traced")
    wanted = apart(scene, "reflections", "traced", "environment")
    assert wanted > 1e-3 and found == pytest.approx(wanted, rel=0.05)
    assert probed(scene, "reflections", reflections="environment") is None


@pytest.mark.parametrize("how", ["traced", "maps"])
def test_a_border_of_a_shadow_counts_by_its_contrast_however_it_was_found(how: str) -> None:
    def found(*meshes: tr.Mesh, ambient: float) -> float:
        scene = Scene(meshes=meshes, lights=(LAMP,), ambient=torch.full((3,), ambient), name="box")
        value = probed(scene, "point_shadow", point_shadows=how)
        assert value is not None and value == probed(scene, "shadow_map", point_shadows=how)
        return value

    dark, bright, none = found(FLOOR, BOX, ambient=0.05), found(FLOOR, BOX, ambient=0.4), found(FLOOR, ambient=0.05)
    assert dark > 1.5 * bright > 0 and none < 0.2 * dark


def test_many_lights_are_not_probed() -> None:
    lamps = tuple(replace(LAMP, position=torch.tensor([x, 2.5, 0.5])) for x in torch.linspace(-1, 1, MOST_LIGHTS + 1))
    assert probed(Scene(meshes=(FLOOR, BOX), lights=lamps, name="many"), "point_shadow") is None
