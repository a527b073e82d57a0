"""Scenes with other values, and objects that stand elsewhere."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import pytest
import torch

from torchrender.errors import InputError, MeshError
from torchrender.pipeline.history import RenderHistory
from torchrender.raster import rasterize
from torchrender.renderer import render
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh, concatenate
from torchrender.scene.model import Scene


def matrix(scale: tuple[float, float, float] = (1.0, 1.0, 1.0), turn: float = 0.3) -> torch.Tensor:
    c, s = math.cos(turn), math.sin(turn)
    out = torch.eye(4, dtype=torch.float64)
    turned = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
    out[:3, :3] = turned * torch.tensor(scale, dtype=torch.float64)
    out[:3, 3] = torch.tensor([0.2, -0.1, 0.4])
    return out


@pytest.fixture
def scene() -> Scene:
    ball, box = shapes.sphere(0.5, 24), shapes.box(torch.tensor([0.4, 0.4, 0.4]))
    parts = [
        Mesh(vertices=ball.vertices, faces=ball.faces, normals=ball.normals, uv=ball.uv, name="ball"),
        Mesh(vertices=box.vertices + 1.0, faces=box.faces, name="chair/wood"),
        Mesh(vertices=box.vertices + 1.5, faces=box.faces, name="chair/cloth"),
    ]
    return Scene(meshes=parts, name="set")


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 0.5, 1.5), (-1.0, 1.0, 1.0)])
def test_normals_stay_across_the_surface_and_faces_keep_their_outside(scene, scale) -> None:
    ball = scene.mesh("ball").transformed(matrix(scale))
    # An ellipsoid: the gradient of its equation at every vertex.
    back = torch.linalg.inv(matrix(scale))
    local = ball.vertices.double() @ back[:3, :3].T + back[:3, 3]
    gradient = torch.nn.functional.normalize(local @ back[:3, :3], dim=1)
    assert float((ball.normals.double() * gradient).sum(1).min()) > 0.999
    a, b, c = ball.vertices.double()[ball.faces].unbind(1)
    outward = torch.linalg.cross(b - a, c - a)
    centre = torch.tensor([0.2, -0.1, 0.4], dtype=torch.float64)
    area = outward.norm(dim=1) > 1e-9
    assert bool(((outward * ((a + b + c) / 3 - centre)).sum(1)[area] > 0).all())


def test_transforming_back_gives_the_mesh(scene) -> None:
    ball = scene.mesh("ball")
    back = ball.transformed(matrix((2.0, 0.5, -1.5))).transformed(torch.linalg.inv(matrix((2.0, 0.5, -1.5))))
    torch.testing.assert_close(back.vertices, ball.vertices, atol=1e-6, rtol=0)
    torch.testing.assert_close(back.normals, ball.normals, atol=1e-6, rtol=0)
    assert torch.equal(back.faces, ball.faces)


def test_a_moved_object_takes_all_its_parts_and_nothing_else(scene) -> None:
    before = scene.geometry
    shifted = scene.moved("chair", matrix())
    assert shifted.meshes[0] is scene.meshes[0]
    for was, now in zip(scene.parts("chair"), shifted.parts("chair"), strict=True):
        wanted = was.vertices.double() @ matrix()[:3, :3].T + matrix()[:3, 3]
        torch.testing.assert_close(now.vertices.double(), wanted, atol=1e-6, rtol=0)
    # What was found out is kept, and says the same as what would be found out anew.
    assert shifted.geometry.order is before.order
    fresh = concatenate(shifted.meshes)
    assert torch.equal(shifted.geometry.vertices, fresh.vertices)
    camera = Cameras.look_at([4.0, 2.0, 4.0], [0.8, 0.8, 0.8], width=48, height=36)
    assert torch.equal(rasterize(shifted, camera).triangle, rasterize(Scene(meshes=shifted.meshes), camera).triangle)
    assert not torch.equal(rasterize(shifted, camera).triangle, rasterize(scene, camera).triangle)


def test_moving_twice_adds_up(scene) -> None:
    twice = scene.moved("ball", matrix()).moved("ball", matrix())
    once = scene.moved("ball", matrix() @ matrix())
    torch.testing.assert_close(twice.mesh("ball").vertices, once.mesh("ball").vertices, atol=1e-6, rtol=0)


def test_other_values_by_name(scene) -> None:
    lamp = PointLight(position=torch.tensor([0.0, 2.0, 0.0]), intensity=torch.ones(3))
    lit = scene.replace(lights=[lamp], name="lit")
    assert lit.lights == (lamp,)
    assert (lit.name, scene.name) == ("lit", "set")
    assert lit.meshes == scene.meshes
    with pytest.raises(InputError, match="a scene has no lamps; it has meshes, materials, lights"):
        scene.replace(lamps=[lamp])


def test_what_is_not_there_is_named(scene) -> None:
    with pytest.raises(InputError, match="scene 'set' has no mesh 'chiar'; there are chair"):
        scene.mesh("chiar")
    with pytest.raises(InputError, match=r"'chair' has 2 parts: chair/wood, chair/cloth; use parts\(\)"):
        scene.mesh("chair")
    assert scene.mesh("chair/wood") is scene.meshes[1]
    with pytest.raises(InputError, match="there are none"):
        Scene().mesh("x")


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e14])
def test_whether_a_matrix_is_singular_does_not_depend_on_units(scale: float) -> None:
    box = Mesh.box(1.0)
    for flattened, told in ((2e-12, None), (5e-13, "matrix must be invertible")):
        flat = torch.diag(torch.tensor([scale, scale, flattened * scale, 1.0], dtype=torch.float64))
        if told is None:
            assert box.transformed(flat).faces.shape == box.faces.shape
        else:
            with pytest.raises(MeshError, match=told):
                box.transformed(flat)


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        (torch.eye(3), r"matrix must be finite with shape \(4, 4\)"),
        (torch.full((4, 4), math.nan), "matrix must be finite"),
        (torch.diag(torch.tensor([1.0, 1.0, 0.0, 1.0])), "matrix must be invertible"),
        (torch.eye(4) + torch.eye(4).flip(0), "matrix must have the last row"),
    ],
)
def test_matrices_that_move_nothing_rightly_are_refused(scene, wrong, told: str) -> None:
    with pytest.raises(MeshError, match=told):
        scene.moved("ball", wrong)


def test_parts_may_be_given_alone_and_others_are_refused_by_name(scene) -> None:
    light = PointLight(position=[0, 1, 0])
    alone = Scene(meshes=scene.mesh("ball"), lights=light, materials=scene.materials[0])
    assert alone.lights == (light,) and len(alone.meshes) == len(alone.materials) == 1
    with pytest.raises(InputError, match=r"lights must be PointLight or .*, one or several, got Mesh"):
        Scene(lights=[scene.mesh("ball")])
    with pytest.raises(InputError, match="meshes must be Mesh, one or several, got int"):
        Scene(meshes=3)


def test_a_path_where_a_scene_is_meant_is_told(scene) -> None:
    view = Cameras.look_at([0, 0, 3], [0, 0, 0], width=8, height=6)
    with pytest.raises(InputError, match=r"scene must be a Scene, got the text 'room.glb': load it first"):
        rasterize("room.glb", view)
    with pytest.raises(InputError, match=r"scene must be a Scene, got Mesh: put it into one"):
        rasterize(scene.mesh("ball"), view)


def test_arrays_that_are_written_to_after_the_first_picture_are_refused(scene) -> None:
    view = Cameras.look_at([0, 0, 3], [0, 0, 0], width=8, height=6)
    mesh = scene.mesh("ball")
    mesh.vertices[:, 0] += 0.1  # nothing has been drawn yet: the scene shows it
    first = rasterize(scene, view)
    copy = pickle.loads(pickle.dumps(scene))
    assert torch.equal(rasterize(copy, view).depth, first.depth)
    mesh.vertices[:, 0] += 0.1
    with pytest.raises(InputError, match=r"vertices of mesh 'ball' were changed in place after .*with_vertices"):
        rasterize(scene, view)
    assert not torch.equal(rasterize(scene.replace(name="new"), view).depth, first.depth)


def test_colours_that_are_written_to_in_place_show(scene) -> None:
    """As with a new material: alone, in a sequence, and in a mirror beside."""
    glass = Material(name="mirror", diffuse=torch.zeros(3), specular=1.0)
    wall = Mesh(vertices=[[-3, -3, -1.5], [3, -3, -1.5], [3, 3, -1.5], [-3, 3, -1.5]], faces=[[0, 1, 2], [0, 2, 3]],
                material=1, name="wall")  # fmt: skip
    lamp = PointLight(position=torch.tensor([1.0, 3.0, 4.0]), intensity=torch.full((3,), 40.0))
    paint = Material(diffuse=torch.tensor([0.8, 0.1, 0.1]))
    scene = scene.replace(meshes=[*scene.meshes, wall], materials=[paint, glass], lights=[lamp])
    camera = Cameras.look_at([1.5, 1.5, 5.0], [0.5, 0.5, 0.0], width=48, height=36)
    first = render(scene, camera, history=RenderHistory())
    paint.diffuse.copy_(torch.tensor([0.1, 0.1, 0.8]))
    anew = Scene(meshes=scene.meshes, materials=[replace(paint), glass], lights=[lamp])
    wanted = render(anew, camera).radiance
    assert float((wanted - first.radiance).abs().max()) > 0.1
    torch.testing.assert_close(render(scene, camera).radiance, wanted, atol=1e-5, rtol=1e-5)
    wanted = render(anew, camera, history=RenderHistory()).radiance
    torch.testing.assert_close(render(scene, camera, history=first.history).radiance, wanted, atol=1e-5, rtol=1e-5)


def test_a_copy_keeps_what_was_found_out_about_the_scene(scene) -> None:
    """Whatever does not depend on what is other in it, by whatever way it comes."""
    lamp = PointLight(position=torch.ones(3), intensity=torch.ones(3))
    found = scene.geometry, scene.material_table, scene.reflector_bounds
    for copy in (scene.replace(lights=[lamp], name="other"), scene.with_default_light()):
        same = copy.geometry, copy.material_table, copy.reflector_bounds
        assert all(one is other for one, other in zip(same, found, strict=True))
        copy.check_unchanged()
    painted = scene.replace(materials=[Material(name="other")])
    assert painted.geometry is not found[0] and painted.material_table is not found[1]
    moved = scene.moved("ball", matrix())
    assert moved.geometry is not found[0] and moved.material_table is found[1]
    assert moved.reflector_bounds is not found[2]


def test_normals_follow_vertices_that_move(scene) -> None:
    ball = scene.mesh("ball")
    scale = torch.tensor([1.0, 3.0, 1.0])
    tall = ball.with_vertices(ball.vertices * scale)
    exact = ball.transformed(torch.diag(torch.tensor([1.0, 3.0, 1.0, 1.0])))
    assert float((tall.normals * exact.normals).sum(1).median()) > 0.995
    stale = float((ball.normals * exact.normals).sum(1).min())
    assert float((tall.normals * exact.normals).sum(1).min()) > max(0.9, stale + 0.05)
    seam = ball.uv[:, 0] == 0
    other = ball.uv[:, 0] == 1
    assert int(seam.sum()) == int(other.sum()) > 2
    torch.testing.assert_close(tall.normals[seam], tall.normals[other])
    back = tall.with_vertices(ball.vertices)
    assert float((back.normals * ball.normals).sum(1).min()) > 0.99
    plain = scene.mesh("chair/wood")
    assert plain.with_vertices(plain.vertices * 2).normals is None
    with pytest.raises(MeshError, match=r"mesh 'ball': vertices must have shape \(\d+, 3\), got \(2, 3\)"):
        ball.with_vertices(torch.zeros(2, 3))


def test_moved_vertices_that_ask_for_a_gradient_are_gathered(scene) -> None:
    ball = scene.mesh("ball")
    asking = (ball.vertices * 1.1).requires_grad_()
    assert scene.geometry.triangle_count
    moved = scene.with_meshes([ball.with_vertices(asking), *scene.meshes[1:]])
    assert not moved.geometry.vertices.requires_grad
    torch.testing.assert_close(moved.geometry.vertices[: len(asking)], asking.detach().double())


@pytest.mark.parametrize("change", ["material", "colors", "uv", "uv1", "alpha", "object_id"])
def test_what_else_than_places_of_vertices_changes_shows(change: str) -> None:
    ball = replace(shapes.sphere(0.5, 12), name="ball")
    scene = Scene(meshes=(ball, replace(shapes.box(torch.ones(3)), name="box")), materials=(Material(), Material()))
    rows = len(ball.vertices)
    values = {
        "material": 1,
        "colors": torch.rand(rows, 3),
        "uv": torch.rand(rows, 2),
        "uv1": torch.rand(rows, 2),
        "alpha": torch.rand(rows),
        "object_id": 7,
    }
    assert scene.geometry.triangle_count
    changed = [replace(ball, **{change: values[change]}), scene.meshes[1]]
    found, wanted = scene.with_meshes(changed).geometry, Scene(meshes=changed, materials=scene.materials).geometry
    for name in ("material", "colors", "uv", "uv1", "alpha", "object_id"):
        first, second = getattr(found, name), getattr(wanted, name)
        assert (first is None and second is None) or torch.equal(first, second), name


def test_meshes_come_and_go(scene) -> None:
    assert scene.geometry.triangle_count
    count = sum(len(mesh.faces) for mesh in scene.meshes)
    more = scene.with_meshes([*scene.meshes, replace(scene.mesh("ball"), name="second")])
    assert more.geometry.triangle_count == count + len(scene.mesh("ball").faces)
    assert scene.with_meshes(scene.meshes[:1]).geometry.triangle_count == len(scene.meshes[0].faces)
    ball = scene.mesh("ball")
    longer = replace(ball, vertices=torch.cat([ball.vertices, ball.vertices[:1]]), normals=None, uv=None)
    assert len(scene.with_meshes([longer, *scene.meshes[1:]]).geometry.vertices) == len(scene.geometry.vertices) + 1
