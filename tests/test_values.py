"""Functions take what has triangles, in any of its forms; values say in a line what they are, and show themselves."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import torch

import torchrender as tr
from torchrender.effects.shadows.options import ShadowOptions
from torchrender.errors import InputError
from torchrender.images.files import read_image, read_image_bytes
from torchrender.photo.fog.picture import prepare
from torchrender.scene import shapes
from torchrender.scene.mesh import concatenate

LONGEST = 600
"""Characters of a representation: a few lines of a terminal."""


@pytest.fixture(scope="module")
def ball() -> tr.Mesh:
    return shapes.sphere(1.0, 24)


@pytest.fixture(scope="module")
def forms(ball) -> list[object]:
    return [ball, concatenate([ball]), tr.Scene(meshes=[ball])]


@pytest.fixture(scope="module")
def camera() -> tr.Cameras:
    return tr.Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=32, height=24)


@pytest.fixture(scope="module")
def cloud(ball) -> tr.PointCloud:
    return tr.PointCloud(position=ball.vertices, normal=ball.normals, radius=torch.full((len(ball.vertices),), 0.2))


def test_depth_rays_and_shadows_of_any_form_agree(forms, camera) -> None:
    depths = [tr.rasterize_depth(form, camera) for form in forms]
    assert bool(torch.isfinite(depths[0]).any())
    origins, directions = camera.rays()
    for form, depth in zip(forms, depths, strict=True):
        assert torch.equal(depth, depths[0])
        hits = tr.RayCaster(form).first_hit(origins[0], directions[0])
        assert torch.equal(torch.isfinite(hits.t).reshape(24, 32), torch.isfinite(depth[0]))
    floor = tr.Scene(meshes=[shapes.plane(torch.tensor([8.0, 8.0]))])
    above = tr.Cameras.look_at([3.0, 4.0, 3.0], [0.0, 0.0, 0.0], width=32, height=24)
    light = tr.RectLight(
        corner=[-0.2, 5.0, -0.2], edge_u=[0.4, 0.0, 0.0], edge_v=[0.0, 0.0, 0.4], radiance=[1.0, 1.0, 1.0]
    )
    seen = tr.rasterize(floor, above)
    options = tr.SoftShadowOptions(light_samples=4)
    shadows = [tr.soft_shadow(form, light, seen, options).visibility for form in (*forms, forms)]
    assert float(shadows[0].min()) == 0.0
    assert float(shadows[0].max()) == 1.0
    for one in shadows[1:]:
        assert torch.equal(one, shadows[0])


def test_collisions_and_voxels_of_any_form_agree(forms, ball) -> None:
    for first in forms:
        hit = tr.collide(first, forms[2], world_from_second=_moved(1.5))
        assert hit
        assert hit.touching
        assert not tr.collide(first, forms[2], world_from_second=_moved(2.5))
    by_hand, _ = tr.voxelize_solid(ball.vertices[None], ball.faces, tr.make_grid(ball.vertices[None].double(), 24))
    for form in forms:
        solid, report = tr.voxelize_solid(form, 24)
        assert report.closed
        assert torch.equal(solid.words, by_hand.words)
        skin = tr.voxelize_surface(form, solid.grid)
        assert 0 < skin.count < solid.count


def test_voxels_are_written_in_any_form(forms, tmp_path) -> None:
    solid, _ = tr.voxelize_solid(forms[0], 16)
    tr.write_voxels(tmp_path / "ball.npz", solid)
    back = tr.read_voxels(tmp_path / "ball.npz")
    assert back.name == "ball"
    assert torch.equal(back.voxels.words, solid.words)
    tr.write_voxels(tmp_path / "skin.npz", tr.voxelize_scene(forms[2], solid.grid))
    assert tr.read_voxels(tmp_path / "skin.npz").color is not None


def test_points_are_rendered_saved_and_shown(cloud, camera, tmp_path) -> None:
    image = tr.render(cloud, camera)
    assert torch.equal(image.image, tr.render_points(cloud, camera).image)
    assert tr.render(cloud, width=20, height=10).image.shape == (1, 10, 20, 3)
    assert len(image) == 1
    (file,) = image.save(tmp_path / "points.png")
    torch.testing.assert_close(read_image(file), image.image[0].clamp(0, 1), atol=0.01, rtol=0)
    assert image.save(tmp_path / "points.exr") == [tmp_path / "points.exr"]
    shown = read_image_bytes(image._repr_png_(), "shown")
    assert shown.shape == (24, 32, 3)
    two = tr.render(cloud, tr.Cameras.cat([camera, camera]))
    assert [path.name for path in two.save(tmp_path / "two.png")] == ["two_000.png", "two_001.png"]
    assert read_image_bytes(two._repr_png_(), "shown").shape == (24, 64, 3)


def test_a_picture_shows_itself(forms, camera) -> None:
    image = tr.render(forms[2], camera)
    shown = read_image_bytes(image._repr_png_(), "shown")
    torch.testing.assert_close(shown, image.displayed()[0], atol=0.01, rtol=0)


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda _, camera: tr.rasterize_depth(3, camera), "geometry must be a Scene, a Mesh or a Geometry, got int"),
        (
            lambda ball, _: tr.collide(ball, "x"),
            "second must be a Scene, a Mesh or a Geometry, got the text 'x': load it first",
        ),
        (lambda ball, _: tr.voxelize_solid(ball, "x"), "grid must be a VoxelGrid or a number of cells, got str"),
        (lambda ball, _: tr.voxelize_solid(ball, ball.faces, 8), "of a shape, the grid is all that follows"),
        (lambda ball, _: tr.voxelize_solid(ball.vertices[None], ball.faces), "grid must be a VoxelGrid or a number"),
        (lambda ball, _: tr.voxelize_surface(ball.vertices[None], 8), "faces must be a torch tensor, got int"),
        (
            lambda ball, _: tr.write_voxels("x.npz", ball),
            "Voxels, got Mesh",
        ),
        (
            lambda ball, camera: tr.render(ball, camera),
            r"scene must be .*Scene\(meshes=\[mesh\]\)",
        ),
    ],
)
def test_what_fits_nowhere_is_named(call, told: str, ball, camera) -> None:
    with pytest.raises(InputError, match=told):
        call(ball, camera)


def test_options_of_scenes_are_not_for_points(cloud, camera) -> None:
    with pytest.raises(InputError, match="budget_ms: for scenes; points take SplatOptions"):
        tr.render(cloud, camera, budget_ms=50)


def test_representations_are_short_and_say_what_is_there(forms, camera, cloud) -> None:
    scene = tr.load("living_room", size=10000)
    history = tr.RenderHistory()
    image = tr.render(tr.load("cornell_box"), width=24, height=24, history=history)
    seen = tr.rasterize(scene, camera)
    solid, _ = tr.voxelize_solid(forms[0], 16)
    values = [
        scene, scene.meshes[0], scene.geometry, scene.materials[0], scene.material_table, camera, image, image.gbuffer,
        image.history, seen, solid, solid.grid, cloud, tr.render_points(cloud, camera), tr.build_patches(cloud),
        tr.collide(forms[0], forms[0]), tr.sample_depth_images(scene, camera),
    ]  # fmt: skip
    for value in values:
        text = repr(value)
        assert len(text) <= LONGEST, f"{type(value).__name__}: {len(text)} characters"
        assert "\n" not in text
        assert text.startswith(f"{type(value).__name__}(")
    assert "float64 (1, 4, 4)" in repr(camera)
    assert "width=32" in repr(camera)
    assert f"{len(scene.meshes)} Mesh" in repr(scene)


def test_values_and_plans_are_tables_in_notebooks(forms, camera, cloud) -> None:
    odd = forms[2].replace(name="<b>&")
    for value, told in ((odd, "&lt;b&gt;&amp;"), (camera, "float64 (1, 4, 4)"), (cloud, "position")):
        shown = value._repr_html_()
        assert told in shown and shown.count("<tr>") == shown.count("</tr>") > 2 and len(shown) < 4 * LONGEST
    plan = tr.plan(forms[2], camera, budget_ms=1e-3)
    shown = plan._repr_html_()
    assert all(row.name in shown for row in plan.rows) and plan.statement in shown and plan.changes[0] in shown


def test_a_representation_makes_nothing(forms, camera) -> None:
    seen = tr.rasterize(forms[2], camera)
    before = set(vars(seen))
    repr(seen)
    assert set(vars(seen)) == before


def test_completion_offers_public_names_alone() -> None:
    found = subprocess.run(
        [sys.executable, "-c", "import torchrender as t; print(*dir(t)); import torchrender; t.load; print(*dir(t))"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    for line in found.stdout.splitlines():
        assert line.split() == sorted(tr.__all__)


def _moved(distance: float) -> torch.Tensor:
    matrix = torch.eye(4)
    matrix[0, 3] = distance
    return matrix


def test_integers_of_numpy_are_integers(ball: tr.Mesh, camera: tr.Cameras) -> None:
    """In sizes, counts and places; what is kept is an integer of Python."""
    size = np.array([8, 6])
    made = tr.Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=size[0], height=size[1])
    assert (type(made.width), made.width, type(made.height), made.height) == (int, 8, int, 6)
    assert len(camera[np.int64(0)]) == 1
    assert tr.render(tr.Scene(meshes=[ball], ambient=[0.5] * 3), width=size[0], height=size[1]).radiance.shape[1:3] == (
        6, 8,
    )  # fmt: skip
    assert tr.voxelize_surface(ball, np.int32(5)).grid.dims == tr.voxelize_surface(ball, 5).grid.dims
    assert tr.load("city", size=np.int64(4000)).geometry.triangle_count > 0
    assert ShadowOptions(size=np.int64(64)).shape == (64, 64)
    with pytest.raises(InputError, match="width must be an integer"):
        tr.render(tr.Scene(meshes=[ball]), width=np.float64(8), height=6)


def test_messages_say_what_was_given(ball: tr.Mesh) -> None:
    flat = tr.Cameras.orthographic_view([0, 0, 4], [0, 0, 0], width=8, height=8, view_height=2)
    with pytest.raises(InputError, match="got orthographic ones"):
        tr.sample_depth_images(tr.Scene(meshes=[ball]), flat)
    with pytest.raises(InputError, match=r"\(H, W, C\), got torch.uint8"):
        prepare(torch.zeros(4, 4, 3, dtype=torch.uint8))
