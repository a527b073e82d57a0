"""What the middle of a scene sees: closed objects around it are left out, rooms stay."""

from __future__ import annotations

import torch

from reflection_scenes import placed, sphere_scene
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.scene_cube import enclosing_solids
from torchrender.report.common.hits import hit_shader
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box

NOBODY = torch.zeros(0, 3, dtype=torch.float64)


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
    assert enclosing_solids(scene.geometry, NOBODY).tolist() == [1]
    aside = room(placed(box(torch.ones(3)), (1.5, 0.0, 0.0), 0))
    assert enclosing_solids(aside.geometry, NOBODY).tolist() == []
    assert enclosing_solids(sphere_scene().geometry, NOBODY).tolist() == [0]


def test_what_holds_the_eye_stays() -> None:
    empty = room()
    assert enclosing_solids(empty.geometry, NOBODY).tolist() == [0]
    eye = torch.tensor([[1.0, 0.5, 0.0]])
    assert enclosing_solids(empty.geometry, eye).tolist() == []


def test_guesses_see_the_walls_and_not_the_inside_of_the_mirror() -> None:
    scene = room(placed(box(torch.ones(3)), (0.0, 0.0, 0.0), 0))
    shader = hit_shader(scene, RenderOptions(shadows=False))
    directions = torch.nn.functional.normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(1)), dim=-1)
    wanted = torch.tensor([0.2, 0.4, 0.6])
    seen = shader.environment(directions)
    assert float((seen[:, 2] - wanted[2]).min()) > -0.05 and float(seen[:, 0].max()) < 3.0
    guess = shader.surroundings(torch.zeros(200, 3).double() + 0.51, directions.double())
    assert float(guess[:, 2].min()) > 0.5
