"""Which scenes get a light of their own, and which exposure a picture gets."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from torchrender.errors import ExposureWarning
from torchrender.pipeline.options import RenderOptions
from torchrender.renderer import render
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import quad

DARK = torch.zeros(3)


def room(material: Material, **rest: object) -> Scene:
    wall, lamp = quad([-2.0, -2, 0], [4.0, 0, 0], [0.0, 4, 0]), quad([0.0, 0, 0.1], [0.05, 0, 0], [0.0, 0.05, 0])
    return Scene(meshes=(wall, replace(lamp, material=1)), materials=(Material(), material), **rest)  # type: ignore[arg-type]


def test_an_emitter_is_no_reason_for_darkness() -> None:
    led = Material(diffuse=DARK, emission=torch.tensor([8.0, 2.0, 0.0]))
    scene = room(led)
    assert not scene.is_lit and len(scene.with_default_light().lights) == 1
    image = render(scene, width=48, height=48).radiance
    assert float((image.amax(-1) > 0.05).float().mean()) > 0.5
    assert room(Material(emission=torch.full((3,), 5000.0))).is_lit


def test_black_texels_of_an_emitter_do_not_count() -> None:
    spot = torch.zeros(64, 64, 3)
    spot[0, 0] = 1.0
    glow = Material(emission=torch.full((3,), 1.0), emission_texture=spot)
    everywhere = Scene(meshes=(quad([0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0]),), materials=(glow,))
    assert not everywhere.is_lit


@pytest.mark.parametrize(
    ("rest", "lit"),
    [
        ({"lights": (PointLight(position=torch.zeros(3)),)}, True),
        ({"lights": (PointLight(position=torch.zeros(3), intensity=DARK),)}, False),
        ({"environment": Environment.constant(torch.ones(3))}, True),
        ({"environment": Environment.constant(DARK)}, False),
        ({"ambient": torch.tensor([0.0, 0.1, 0.0])}, True),
        ({}, False),
    ],
)
def test_lights_that_bring_nothing_light_nothing(rest: dict[str, object], lit: bool) -> None:
    assert room(Material(), **rest).is_lit == lit


def test_unlit_surfaces_shine_themselves() -> None:
    """However dark they are, and however dark the first of them is: the background is the same."""
    for level in (0.5, 0.05, 0.0):
        shown = Material(unlit=True, diffuse=torch.full((3,), level))
        assert Scene(meshes=(quad([0.0, 0, 0], [1.0, 0, 0], [0.0, 1, 0]),), materials=(shown,)).is_lit
        assert not room(shown).is_lit, "a small one beside a wall lights nothing"


def test_lights_in_lux_are_exposed_for_and_it_is_said() -> None:
    sun = DirectionalLight(direction=torch.tensor([0.0, 0.0, -1.0]), irradiance=torch.full((3,), 100_000.0))
    scene = room(Material(), lights=(sun,), photometric=True)
    with pytest.warns(ExposureWarning, match="candela and lux"):
        image = render(scene, width=16, height=16)
    assert image.exposure is None and 0.02 < float(image.displayed().mean()) < 0.9
    assert render(scene, width=8, height=8, options=RenderOptions(exposure=-10.0)).exposure == -10.0
    assert render(room(Material(), lights=(sun,)), width=8, height=8).exposure == 0.0
