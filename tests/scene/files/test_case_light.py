"""Materials and lights of files that others' programs showed wrongly: what pictures of them must show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.errors import TorchRenderWarning
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.model import Scene
from torchrender.shade import diffuse_color, shade

SIDE = 24


def front() -> tr.Cameras:
    """All plates are the unit square of x and y, a little smaller than this picture."""
    return tr.Cameras.look_at([0.5, 0.5, 3.0], [0.5, 0.5, 0.0], width=SIDE, height=SIDE, fov_deg=22.0)


def lit(scene: Scene) -> Tensor:
    """(N,3) radiance of what is covered, under the light that a picture of the scene has."""
    scene = scene.with_default_light()
    seen = tr.rasterize(scene, front())
    return shade(scene, seen)[seen.covered]


def test_a_lamp_on_a_wall_leaves_the_wall_lit(cases: Path) -> None:
    light = lit(load(cases / "led.glb"))
    assert float(light.median()) > 0.1


def test_a_picture_of_emission_glows_where_it_is_bright_alone(cases: Path) -> None:
    light = lit(load(cases / "emissive_led.glb")).amax(-1)
    assert float(light.max()) > 0.8 and 0.1 < float(light.median()) < 0.6


@pytest.mark.parametrize("name", ["metal_defau.glb", "metal_metal.glb"])
def test_a_metal_mirrors_in_the_colour_of_its_picture(cases: Path, name: str) -> None:
    white = Environment.constant(torch.ones(3))
    scene = replace(load(cases / name), lights=(), environment=white, ambient=torch.zeros(3))
    seen = tr.rasterize(scene, front())
    light = shade(scene, seen)[seen.covered].mean(0)
    other = 0.02 if scene.materials[0].metallic == 1.0 else 0.06  # a dielectric mirrors 4 % of white
    assert light.tolist() == pytest.approx([1.0, 0.0, 0.0], abs=other)


def test_unlit_is_its_colour(cases: Path) -> None:
    assert lit(load(cases / "unlit.glb")).mean(0).tolist() == pytest.approx([0.5, 0.25, 0.1], abs=1e-5)


@pytest.mark.parametrize("name", ["blend.glb", "blend_uv.glb"])
def test_what_blends_shows_what_lies_behind_by_its_alpha(cases: Path, name: str) -> None:
    scene = load(cases / name).with_default_light()
    options = tr.RenderOptions(shadows=False, ambient_visibility="off", reflections="off")

    def centre(shown: Scene) -> Tensor:
        return tr.render(shown, front(), options=options).radiance[0, SIDE // 2, SIDE // 2]

    pane = next(k for k, m in enumerate(scene.materials) if m.blend)
    alpha = scene.materials[pane].opacity
    solid = tuple(replace(m, blend=False, opacity=1.0) if k == pane else m for k, m in enumerate(scene.materials))
    behind = replace(scene, meshes=tuple(m for m in scene.meshes if m.material != pane))
    wanted = alpha * centre(replace(scene, materials=solid)) + (1.0 - alpha) * centre(behind)
    torch.testing.assert_close(centre(scene), wanted, atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize(
    ("name", "fields"), [("wrap_clamp.glb", "RRRBBB"), ("wrap_mirror.glb", "BRRBBR"), ("wrap_repeat.glb", "RBRBRB")]
)
def test_pictures_go_on_beyond_their_edges_as_the_file_says(cases: Path, name: str, fields: str) -> None:
    scene = load(cases / name)
    seen = tr.rasterize(scene, front())
    color = diffuse_color(scene, seen)[0, SIDE // 2]
    covered = seen.covered[0, SIDE // 2].nonzero().reshape(-1)
    first, last = int(covered[0]), int(covered[-1]) + 1
    middles = [first + int((k + 0.5) / 6 * (last - first)) for k in range(6)]
    assert "".join("R" if float(color[m, 0]) > float(color[m, 2]) else "B" for m in middles) == fields


def test_a_normal_map_turns_the_light(cases: Path) -> None:
    scene = load(cases / "normalmap.glb")
    flat = replace(scene, materials=tuple(replace(m, normal_texture=None, samplers={}) for m in scene.materials))
    assert float((lit(scene) - lit(flat)).abs().mean()) > 0.01


def test_alpha_of_vertices_makes_holes_and_panes(cases: Path) -> None:
    scene = load(cases / "color0.glb")  # a mask, alpha 0
    assert not bool(tr.rasterize(scene, front()).covered.any())
    pane = replace(scene, materials=tuple(replace(m, alpha_cutoff=None, blend=True) for m in scene.materials))
    options = tr.RenderOptions(ambient_visibility="off")
    image = tr.render(pane, front(), options=options).radiance
    torch.testing.assert_close(image, tr.render(replace(pane, meshes=()), front(), options=options).radiance)


def test_a_sun_of_a_hundred_thousand_lux_is_no_white_picture(cases: Path) -> None:
    scene = load(cases / "sunlux.glb")
    with pytest.warns(TorchRenderWarning, match="exposure is automatic"):
        shown = tr.render(scene, front()).displayed()
    assert 0.05 < float(shown[0, SIDE // 2, SIDE // 2].mean()) < 0.95
