"""What the middle of a scene sees: closed objects around it are left out, rooms stay."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

import torchrender.passes.light.ambient_visibility as ambient
import torchrender.passes.mirrors.hit_shader as hit_shaders
import torchrender.pipeline.hit_shader as hit_shader_module
import torchrender.pipeline.scene_cube as scene_cube
from reflection_scenes import placed, sphere_scene
from torchrender.effects.ambient.options import AmbientOptions
from torchrender.effects.reflections.reflectors import reflective_pixels
from torchrender.pipeline.options import RenderOptions
from torchrender.pipeline.scene_cube import Solids
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box


def left_out(scene: Scene, *eyes: tuple[float, float, float]) -> list[int]:
    """Objects that the middle does not see from inside."""
    points = torch.tensor(eyes, dtype=torch.float64).reshape(-1, 3)
    around = Solids.of(scene.geometry).around(scene.bounds.mean(dim=0))
    return [solid.number for solid in around if not solid.holds(points)]


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


COLORS = torch.tensor([[1.0, 0, 0], [0, 1, 1], [0, 1, 0], [1, 0, 1], [0, 0, 1], [1, 1, 0]])
"""Of the walls +x, -x, +y, -y, +z, -z."""
CHROME = Material(metallic=1.0, roughness=0.0, diffuse=torch.ones(3))


def coloured_room(*mirrors: Mesh) -> Scene:
    """Six walls that glow, five units from the middle, around things of chrome."""
    walls, materials = [], [CHROME]
    for number, color in enumerate(COLORS):
        middle, size = torch.zeros(3), torch.full((3,), 10.0)
        middle[number // 2], size[number // 2] = 5.0 - 10.0 * (number % 2), 0.1
        walls.append(Mesh.box(size, middle, material=number + 1))
        materials.append(Material(diffuse=torch.zeros(3), emission=color, roughness=1.0))
    return Scene(meshes=(*mirrors, *walls), materials=tuple(materials), ambient=torch.zeros(3))


def test_the_middle_sees_every_wall_where_it_is() -> None:
    """Straight at each of them, and near each edge."""
    shader = hit_shader(coloured_room(), RenderOptions(shadows=False))
    generator = torch.Generator().manual_seed(3)
    direction = torch.nn.functional.normalize(torch.randn(4000, 3, generator=generator), dim=-1)
    size, axis = direction.abs().sort(dim=-1, descending=True)
    clear, axis = size[:, 0] > 1.1 * size[:, 1], axis[:, 0]
    wanted = COLORS[2 * axis + (direction.gather(1, axis[:, None])[:, 0] < 0)]
    seen = shader.environment(direction, torch.zeros(1, 3))
    assert torch.allclose(seen[clear], wanted[clear], atol=1e-3)


def difference(scene: Scene, camera: Cameras) -> tuple[float, float]:
    """Mean difference of the environment's picture to the traced one, and the latter's to black, where it mirrors."""
    options = RenderOptions(shadows=False, supersample=1)
    seen = reflective_pixels(scene, rasterize(scene, camera)).pixel
    made = [
        render(scene, camera, options=replace(options, reflections=way)).radiance.reshape(-1, 3)[seen]
        for way in ("environment", "traced")
    ]
    return float((made[0] - made[1]).abs().mean()), float(made[1].mean())


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (0.3, 0.2, 0.0), (0.52, 0.0, -0.3), (-2.5, 1.0, 1.0)])
def test_a_lone_mirror_shows_the_room_wherever_it_stands(place: tuple[float, float, float]) -> None:
    scene = coloured_room(Mesh.sphere(0.5, place, segments=32))
    middle = torch.tensor(place)
    camera = Cameras.look_at(middle + torch.tensor([0.0, 0.0, 2.0]), middle, width=64, height=64, fov_deg=35)
    off, light = difference(scene, camera)
    assert light > 0.3 and off < 0.03


def test_two_mirrors_show_the_room_and_each_other() -> None:
    scene = coloured_room(*[Mesh.sphere(0.5, [x, 0.3, 0.8], segments=32) for x in (-0.7, 0.7)])
    camera = Cameras.look_at([0.0, 1.0, 4.0], [0.0, 0.3, 0.0], width=96, height=64, fov_deg=40)
    off, light = difference(scene, camera)
    assert light > 0.3 and off < 0.08


@pytest.mark.parametrize(("count", "own"), [(1, [None]), (2, [64, 64]), (6, [])])
def test_mirrors_that_are_a_good_part_of_all_have_maps_of_their_own(
    monkeypatch: pytest.MonkeyPatch, count: int, own: list[int | None]
) -> None:
    """Small ones of many look from the scene's middle: one map for all."""
    scene = coloured_room(*[Mesh.sphere(0.3, [0.8 * x - 2.0, 1.0, 0.0], segments=16) for x in range(count)])
    drawn = []
    make = hit_shader_module.make_cube
    monkeypatch.setattr(hit_shader_module, "make_cube", lambda *given: (drawn.append(given[-2:]), make(*given))[1])
    camera = Cameras.look_at([0.0, 0.0, 4.5], [0.0, 0.0, 0.0], width=96, height=64, fov_deg=60)
    render(scene, camera, options=RenderOptions(shadows=False, reflections="environment"))
    assert [size for around, size in drawn if around is not None] == own
    assert len(drawn) - len(own) == (count == 6)


def test_a_reflector_around_the_eye_or_others_is_a_room() -> None:
    inside = coloured_room(Mesh.box(2.0, [0.0, 0.0, 0.0]), Mesh.sphere(0.3, [0.0, 0.0, 0.0], material=1))
    solids = Solids.of(inside.geometry)
    assert solids.reflector(0) is None and solids.reflector(1) is not None
    assert solids.reflector(2) is None  # a wall: a sheet, on which others may stand
    shader = hit_shader(coloured_room(Mesh.sphere(0.5, [2.0, 0.0, 0.0])), RenderOptions(shadows=False))
    ahead, owner = torch.tensor([[0.0, 0.0, 1.0]]), torch.zeros(1, dtype=torch.int64)
    for eye, number in (([4.0, 0.0, 0.0], 0), ([2.0, 0.1, 0.0], -1)):
        place = torch.tensor([eye], dtype=torch.float64)
        assert shader.unseen(owner, place)
        shader.environment(ahead, place, leaving=(place, owner))
        assert not shader.unseen(owner, place)
        assert [key for key, _ in shader._cubes][-1] == number
