"""A scene becomes a picture: end to end on scenes whose answer is known, and what a picture saves."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.depth.viewpoints import viewpoints_around
from torchrender.errors import ImageFileError, InputError, OptionError
from torchrender.images.files import read_image

UP = torch.tensor([0.0, 0.0, 1.0])


def quad(corner: list[float], u: list[float], v: list[float], material: int = 0) -> tr.Mesh:
    c, a, b = (torch.tensor(x) for x in (corner, u, v))
    return tr.Mesh(
        vertices=torch.stack([c, c + a, c + a + b, c + b]),
        faces=torch.tensor([[0, 1, 2], [0, 2, 3]]),
        material=material,
    )


def floor_and_roof(*lights: tr.DirectionalLight | tr.PointLight) -> tr.Scene:
    """A white floor in the plane y = 0 and a small roof that shades its middle."""
    floor = quad([-4.0, 0.0, 4.0], [8.0, 0.0, 0.0], [0.0, 0.0, -8.0])
    roof = quad([-1.0, 1.0, 1.0], [2.0, 0.0, 0.0], [0.0, 0.0, -2.0], material=1)
    materials = (tr.Material(diffuse=torch.ones(3)), tr.Material(diffuse=torch.tensor([1.0, 0.0, 0.0])))
    return tr.Scene(meshes=(floor, roof), materials=materials, lights=lights, ambient=torch.full((3,), 0.25))


SUN = tr.DirectionalLight(direction=torch.tensor([0.0, -1.0, 0.0]), irradiance=torch.full((3,), math.pi))
SIDE = tr.Cameras.look_at([0.0, 3.0, 6.0], [0.0, 0.0, 0.0], width=96, height=64, near=0.1)


def radiance_at(image: tr.Image, point: list[float]) -> Tensor:
    pixel, _ = image.cameras.project(torch.tensor([point]))
    u, v = pixel[0, 0].floor().long().tolist()
    return image.radiance[0, v, u]


PLAIN = tr.RenderOptions(ambient_visibility="off")


def test_sun_above_a_roof() -> None:
    image = tr.render(floor_and_roof(SUN), SIDE, options=PLAIN)
    torch.testing.assert_close(radiance_at(image, [2.5, 0.0, 0.0]), torch.full((3,), 1.25))
    torch.testing.assert_close(radiance_at(image, [0.0, 0.0, 0.0]), torch.full((3,), 0.25))
    torch.testing.assert_close(radiance_at(image, [0.0, 1.0, 0.5]), torch.tensor([1.25, 0.0, 0.0]))
    assert image.timings_ms["total"] >= image.timings_ms["gbuffer"] > 0


def test_without_shadows_the_floor_under_the_roof_is_lit() -> None:
    image = tr.render(floor_and_roof(SUN), SIDE, options=replace(PLAIN, shadows=False))
    torch.testing.assert_close(radiance_at(image, [0.0, 0.0, 0.0]), torch.full((3,), 1.25))


def test_lights_have_their_own_shadows() -> None:
    low = tr.PointLight(position=torch.tensor([0.0, 0.5, 2.0]), intensity=torch.full((3,), math.pi))
    image = tr.render(floor_and_roof(SUN, low), SIDE, options=PLAIN)
    at = torch.tensor([0.0, 0.0, 0.5])
    offset = low.position - at
    expected = 0.25 + float(offset[1] / offset.norm() ** 3)
    assert float(radiance_at(image, at.tolist())[0]) == pytest.approx(expected, rel=0.05)


def test_supersampling_averages_linear_radiance_and_keeps_the_gbuffer_size() -> None:
    scene = floor_and_roof(SUN)
    fine = tr.render(scene, SIDE.scaled(2))
    image = tr.render(scene, SIDE, options=tr.RenderOptions(supersample=2))
    cells = fine.radiance.reshape(64, 2, 96, 2, 3).mean(dim=(1, 3))
    torch.testing.assert_close(image.radiance[0], cells)
    assert image.gbuffer.depth.shape == (1, 64, 96)
    one = tr.render(scene, SIDE)
    torch.testing.assert_close(image.gbuffer.depth, one.gbuffer.depth)


def test_what_was_shaded_and_what_is_seen_are_told_apart() -> None:
    scene = floor_and_roof(SUN)
    few, one = tr.render(scene, SIDE, options=tr.RenderOptions(supersample=0.5)), tr.render(scene, SIDE)
    assert few.rendered is not None and few.rendered.depth.shape == (1, 32, 48)
    assert torch.equal(few.visibility.triangle, one.gbuffer.triangle)
    assert torch.equal(few.gbuffer.triangle, one.gbuffer.triangle)
    assert one.rendered is one.visibility is one.gbuffer
    assert tr.render(scene, SIDE, options=tr.RenderOptions(supersample=2)).rendered is None


def test_batch_of_cameras_equals_single_pictures() -> None:
    cameras = tr.Cameras.look_at(
        [[0.0, 3.0, 6.0], [1.0, 4.0, 5.0]], [[0.0, 0.0, 0.0]] * 2, width=48, height=32, near=0.1
    )
    scene = floor_and_roof(SUN)
    both = tr.render(scene, cameras)
    assert len(both) == 2
    for k in range(2):
        torch.testing.assert_close(both.radiance[k], tr.render(scene, cameras[k]).radiance[0])


def test_scene_without_light_gets_one_and_without_camera_is_framed() -> None:
    image = tr.render(tr.Scene(meshes=(quad([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]),)), width=64, height=48)
    covered = image.gbuffer.covered
    assert 0.1 < float(covered.float().mean()) < 0.9
    assert float(image.radiance[covered].min()) > 0.1


def test_empty_scene_is_background() -> None:
    image = tr.render(tr.Scene(), width=8, height=6, options=tr.RenderOptions(background=(0.1, 0.2, 0.3)))
    assert torch.equal(image.radiance, torch.tensor([0.1, 0.2, 0.3]).expand(1, 6, 8, 3))
    assert bool((image.gbuffer.triangle == -1).all())
    assert torch.isfinite(tr.render(tr.Scene(), width=8, height=6).radiance).all()


@pytest.mark.parametrize("wish", [{}, {"budget_ms": 50.0}, {"max_error": 0.05}, {"budget_ms": 50.0, "max_error": 0.05}])
def test_no_cameras_give_no_pictures_whatever_is_wished(wish: dict[str, float]) -> None:
    scene, none = floor_and_roof(SUN), SIDE[[]]
    for history in (None, tr.RenderHistory()):
        image = tr.render(scene, none, history=history, **wish)
        assert image.radiance.shape == (0, 64, 96, 3) and image.plan is not None
        assert image.plan.possible and not image.plan.statement
    assert image.history is not None and image.history.pace is not None
    assert all(math.isfinite(value) for value in image.history.pace.known.values())
    assert tr.plan(scene, none, **wish).possible


def test_named_cameras_and_sizes() -> None:
    scene = replace(floor_and_roof(SUN), cameras={"side": SIDE, "far": replace(SIDE, near=torch.tensor(1.0))})
    assert tr.render(scene, "far", width=30, height=20).radiance.shape == (1, 20, 30, 3)
    assert tr.render(scene, SIDE).radiance.shape == (1, 64, 96, 3)
    assert tr.render(scene, SIDE, width=30, height=20).radiance.shape == (1, 20, 30, 3)
    with pytest.raises(InputError, match="known cameras: side, far"):
        tr.render(scene, "near")
    with pytest.raises(InputError, match="camera"):
        tr.render(scene, 3)  # type: ignore[arg-type]


def test_built_in_scene_by_name() -> None:
    image = tr.render("cornell_box", width=64, height=64)
    assert float(image.gbuffer.covered.float().mean()) > 0.5
    assert torch.isfinite(image.radiance).all()
    assert image.timings_ms["load"] > 0


def test_options_are_checked() -> None:
    for wrong in ({"supersample": 5.0}, {"supersample": math.nan}, {"exposure": math.nan}, {"tone_map": "film"}):
        with pytest.raises(OptionError):
            tr.RenderOptions(**wrong)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="background"):
        tr.RenderOptions(background=(1.0, 2.0))


# -------------------------------------------------------------------- saving


def test_png_holds_srgb_of_the_displayed_picture(tmp_path: Path) -> None:
    image = tr.render(floor_and_roof(SUN), SIDE, options=tr.RenderOptions(exposure=-1.0, tone_map="reinhard"))
    (file,) = image.save(tmp_path / "a.png")
    assert float((read_image(file) - image.displayed()[0]).abs().max()) < 0.01
    assert float((image.to_srgb() - image.displayed()).min()) >= 0.0


def test_automatic_exposure_does_not_depend_on_the_brightness_of_the_light() -> None:
    options = tr.RenderOptions(exposure=None)
    scene = floor_and_roof(SUN)
    bright = replace(scene, lights=(replace(SUN, irradiance=100 * SUN.irradiance),), ambient=100 * scene.ambient)
    pictures = [tr.render(s, SIDE, options=options).displayed() for s in (scene, bright)]
    torch.testing.assert_close(pictures[0], pictures[1], rtol=1e-4, atol=1e-5)


def test_exr_holds_radiance_depth_normals_and_ids(tmp_path: Path) -> None:
    image = tr.render(floor_and_roof(SUN), SIDE)
    (file,) = image.save(tmp_path / "a.exr")
    with OpenEXR.File(str(file), separate_channels=True) as exr:
        planes = {name: torch.from_numpy(np.array(c.pixels)) for name, c in exr.channels().items()}
    g = image.gbuffer
    assert torch.equal(torch.stack([planes[c] for c in "RGB"], -1), image.radiance[0])
    assert torch.equal(planes["Z"], g.depth[0])
    assert torch.equal(torch.stack([planes[f"N.{c}"] for c in "XYZ"], -1), g.normal[0])
    for name, ids in (("triangle", g.triangle), ("object", g.object_id), ("material", g.material)):
        assert torch.equal(planes[f"id.{name}"].long(), ids[0])


def test_npz_holds_everything_and_cameras_come_back(tmp_path: Path) -> None:
    image = tr.render(floor_and_roof(SUN), SIDE)
    (file,) = image.save(tmp_path / "a.npz")
    with np.load(file) as data:
        assert np.array_equal(data["radiance"], image.radiance.numpy())
        assert np.array_equal(data["triangle"], image.gbuffer.triangle.numpy())
        width, height = (int(v) for v in data["image_size"])
        back = tr.Cameras(
            *(torch.from_numpy(data[k]) for k in ("camera_from_world", "intrinsics")),
            width,
            height,
            *(torch.from_numpy(data[k]) for k in ("near", "far")),
        )
    points = torch.rand(10, 3)
    torch.testing.assert_close(back.project(points)[0], SIDE.project(points)[0])


def test_several_views_are_numbered(tmp_path: Path) -> None:
    cameras = tr.Cameras.cat([SIDE, SIDE]).scaled(0.25)
    image = tr.render(floor_and_roof(SUN), cameras)
    for suffix in ("png", "exr"):
        files = image.save(tmp_path / f"out.{suffix}")
        assert [f.name for f in files] == [f"out_000.{suffix}", f"out_001.{suffix}"]
        assert all(f.is_file() for f in files)
    assert image.save(tmp_path / "out.npz") == [tmp_path / "out.npz"]


def test_saving_errors_name_the_file(tmp_path: Path) -> None:
    image = tr.render(tr.Scene(), width=4, height=4)
    with pytest.raises(ImageFileError, match=r"a\.jpg"):
        image.save(tmp_path / "a.jpg")
    with pytest.raises(ImageFileError, match="does not exist"):
        image.save(tmp_path / "missing" / "a.png")


def test_image_checks_its_parts() -> None:
    image = tr.render(tr.Scene(), width=4, height=4)
    with pytest.raises(InputError, match="radiance"):
        replace(image, radiance=torch.zeros(1, 4, 5, 3))
    with pytest.raises(OptionError, match="tone_map"):
        replace(image, tone_map="film")


# ---------------------------------------------------------------- viewpoints


def test_three_viewpoints_form_an_equilateral_triangle_that_faces_the_centre() -> None:
    scene = floor_and_roof(SUN)
    cameras = viewpoints_around(scene, SIDE, 3)
    eyes = cameras.eye
    sides = (eyes - eyes.roll(1, 0)).norm(dim=1)
    torch.testing.assert_close(sides, torch.full((3,), 0.2 * scene.diagonal, dtype=torch.float64))
    torch.testing.assert_close(eyes.mean(0), SIDE.eye[0])
    pixels, depth = cameras.project(scene.bounds.mean(0, keepdim=True))
    torch.testing.assert_close(pixels[:, 0], torch.tensor([48.0, 32.0], dtype=torch.float64).expand(3, 2))
    assert bool((depth > 0).all())
    assert float(eyes[0, 1]) == float(eyes[:, 1].max())


def test_viewpoints_stay_in_the_room() -> None:
    """Beyond a wall a camera sees nothing of what is wanted: such a viewpoint comes nearer, the others stay."""
    eye = [0.0, 1.5, 3.0]
    things = [tr.Mesh.sphere(0.4, (x, 0.4, -2.0)) for x in (-1.0, 0.0, 1.0)]
    walls = [tr.Mesh.box((8.0, 0.1, 8.0), (0.0, 0.0, 0.0)), tr.Mesh.box((0.1, 6.0, 8.0), (0.35, 3.0, 0.0))]
    camera = tr.Cameras.look_at(eye, [-1.0, 0.4, -2.0], width=96, height=64)
    whole = viewpoints_around(tr.Scene(meshes=[*things, walls[0]]), camera, 4)
    cameras = viewpoints_around(tr.Scene(meshes=[*things, *walls]), camera, 4)
    assert float(whole.eye[:, 0].max()) > 0.4 > 0.3 > float(cameras.eye[:, 0].max()), "on this side of the wall"
    far = (cameras.eye - camera.eye).norm(dim=1)
    assert int((far > 0.99 * far.max()).sum()) == 3 and float(far.min()) > 0.1 * float(far.max())


def test_viewpoints_at_the_centre_and_wrong_counts() -> None:
    scene = floor_and_roof(SUN)
    centre = scene.bounds.mean(0)
    inside = tr.Cameras.look_at(centre, centre + UP, width=8, height=8)
    assert torch.isfinite(viewpoints_around(scene, inside, 4).camera_from_world).all()
    torch.testing.assert_close(viewpoints_around(scene, SIDE, 1).eye, SIDE.eye)
    with pytest.raises(OptionError, match="count"):
        viewpoints_around(scene, SIDE, 0)
    with pytest.raises(OptionError, match="single camera"):
        viewpoints_around(scene, tr.Cameras.cat([SIDE, SIDE]), 2)
