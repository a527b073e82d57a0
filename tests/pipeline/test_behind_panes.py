"""Mirrors show what lies behind panes, as far as these let it pass, and the panes."""

from __future__ import annotations

import pytest
import torch

import torchrender as tr
from torchrender.effects.reflections.traced import TraceOptions

EYE = tr.Cameras.look_at([0, 1, 1], [0, 0, 0], width=17, height=17, fov_deg=20)


def below(*panes: tr.Material, roughness: float = 0.0) -> tr.Scene:
    """A mirror floor under a white ceiling, with panes between them; and one below the eye, which it does not see."""
    mirror = tr.Material(diffuse=[1, 1, 1], metallic=1.0, roughness=roughness)
    white = tr.Material(diffuse=[0, 0, 0], emission=[1, 1, 1])
    between = [tr.Mesh.plane(20, [0, 2.0 + 0.2 * k, 0], material=2 + k) for k in range(len(panes))]
    meshes = (tr.Mesh.plane(4), tr.Mesh.plane(20, [0, 4, 0], material=1), *between)
    return tr.Scene(meshes=meshes, materials=(mirror, white, *panes), lights=())


def glass(opacity: float, emission: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> tr.Material:
    return tr.Material(diffuse=[0, 0, 0], opacity=opacity, blend=True, emission=emission)


@pytest.mark.parametrize("way", ("traced", "clustered"))
def test_mirrors_show_panes_and_what_they_let_pass(way: str) -> None:
    options = tr.RenderOptions(reflections=way)
    one, two = below(glass(0.5)), below(glass(0.25, (0.0, 0.0, 2.0)), glass(0.5))
    assert torch.allclose(centre(one, options), torch.full((3,), 0.5), atol=5e-3)
    assert torch.allclose(centre(two, options), torch.tensor([0.375, 0.375, 0.875]), atol=5e-3)


def test_glossy_mirrors_show_them_too() -> None:
    scene, options = below(glass(0.5), roughness=0.3), tr.RenderOptions(reflections="traced")
    clear = centre(tr.Scene(meshes=scene.meshes[:2], materials=scene.materials, lights=()), options)
    assert torch.allclose(centre(scene, options), 0.5 * clear, atol=0.02)


def test_mirrors_in_mirrors_show_them() -> None:
    """A second mirror in place of the ceiling's half that the first one shows: light passes the pane twice."""
    scene = below(glass(0.5))
    upper = tr.Mesh.plane(20, [0, 3, 0], material=0)
    white = tr.Mesh.plane(20, [0, -1, 0], material=1)
    small = tr.Mesh.plane(0.4, [0, 0, 0], material=0)
    twice = scene.replace(meshes=(small, upper, white, *scene.meshes[2:]))
    found = centre(twice, tr.RenderOptions(reflections="traced", tracing=TraceOptions(bounces=2)))
    assert torch.allclose(found, torch.full((3,), 0.25), atol=5e-3)


def test_without_transparency_panes_are_not_there() -> None:
    assert torch.allclose(centre(below(glass(0.5)), tr.RenderOptions(transparency="off")), torch.ones(3), atol=5e-3)


def centre(scene: tr.Scene, options: tr.RenderOptions) -> torch.Tensor:
    return tr.render(scene, EYE, options=options).radiance[0, 8, 8]
