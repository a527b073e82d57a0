"""What the middle of a scene sees: closed objects around it are left out, rooms stay."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender.passes.light.ambient_visibility as ambient
import torchrender.passes.mirrors.hit_shader as hit_shaders
import torchrender.pipeline.scene_cube as scene_cube
from reflection_scenes import placed, sphere_scene
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.scene_cube import middle_solids
from torchrender.report.common.hits import hit_shader
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box


def left_out(scene: Scene, *eyes: tuple[float, float, float]) -> list[int]:
    """Objects that the middle does not see from inside."""
    points = torch.tensor(eyes, dtype=torch.float64).reshape(-1, 3)
    return [solid.number for solid in middle_solids(scene.geometry) if not solid.holds(points)]


def room(*others: object) -> Scene:
    """A closed box of walls that face outwards, with things in it."""
    walls = placed(box(torch.full((3,), 6.0)), (0.0, 0.0, 0.0), 1)
    metal, paint = (
        Material(specular=1.0, diffuse=torch.zeros(3)),
        Material(diffuse=torch.zeros(3), emission=torch.tensor([0.2, 0.4, 0.6])),
    )
    return Scene(
        meshes=(walls, *others),  # type: ignore[arg-type]
        materials=(metal, paint),
        environment=Environment.constant(torch.tensor([5.0, 0.0, 0.0])),
    )


def test_a_solid_in_the_middle_is_left_out_and_a_room_is_not() -> None:
    ball = placed(box(torch.ones(3)), (0.0, 0.0, 0.0), 0)
    scene = room(ball)
    assert left_out(scene) == [1]
    aside = room(placed(box(torch.ones(3)), (1.5, 0.0, 0.0), 0))
    assert left_out(aside) == []
    assert left_out(sphere_scene()) == [0]


def test_what_holds_the_eye_stays() -> None:
    empty = room()
    assert left_out(empty) == [0]
    assert left_out(empty, (1.0, 0.5, 0.0)) == []
    assert left_out(empty, (4.0, 0.5, 0.0)) == [0]


def test_solids_are_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Eyes that move outside the box of what stands in the middle ask no triangle of it."""
    asked = []
    found = scene_cube.winding_number
    monkeypatch.setattr(
        scene_cube, "winding_number", lambda corners, points: (asked.append(len(points)), found(corners, points))[1]
    )
    scene = room(placed(box(torch.ones(3)), (0.0, 0.0, 0.0), 0))
    shader = hit_shader(scene, RenderOptions(shadows=False))
    ahead = torch.tensor([[0.0, 0.0, 1.0]])
    shader.environment(ahead, torch.tensor([[2.0, 0.0, 0.0]]))
    first = len(asked)
    shader.environment(ahead, torch.tensor([[2.1, 0.0, 0.0]]))
    assert first > 0 and len(asked) == first
    shader.environment(ahead, torch.tensor([[0.1, 0.0, 0.0]]))
    assert len(asked) == first + 1


def test_guesses_see_the_walls_and_not_the_inside_of_the_mirror() -> None:
    scene = room(placed(box(torch.ones(3)), (0.0, 0.0, 0.0), 0))
    shader = hit_shader(scene, RenderOptions(shadows=False))
    directions = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    wanted = torch.tensor([0.2, 0.4, 0.6])
    seen = shader.environment(directions)
    assert float((seen[:, 2] - wanted[2]).min()) > -0.05 and float(seen[:, 0].max()) < 3.0
    guess = shader.surroundings(torch.zeros(200, 3).double() + 0.51, directions.double())
    assert float(guess[:, 2].min()) > 0.5


def test_the_cube_finds_ambient_light_by_a_sixteenth_of_the_rays(monkeypatch: pytest.MonkeyPatch) -> None:
    """The usual cube, beside one with 24 rays a texel: less than a step or two of 255 apart on the mean."""
    monkeypatch.setattr(scene_cube, "CUBE_SIZE", 128)
    scene = replace(room(placed(box(torch.ones(3)), (1.5, -2.0, 0.0), 1)), ambient=torch.full((3,), 0.5))
    scene = replace(scene, materials=(scene.materials[0], Material(diffuse=torch.full((3,), 0.7))), environment=None)
    made = []
    for spacing, rays in ((1, 24), (hit_shaders.AROUND, 8)):
        monkeypatch.setattr(hit_shaders, "AROUND", spacing)
        monkeypatch.setattr(ambient, "AT_HITS", rays)
        shader = hit_shader(scene, RenderOptions(shadows=False, ambient=AmbientOptions(rays=rays)))
        made.append(shader.environment(torch.randn(4000, 3, generator=torch.Generator().manual_seed(2))))
    exact, few = made
    assert float(exact.std()) > 0.03
    assert float((few - exact).abs().mean()) < 0.01
