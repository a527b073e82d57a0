"""Numbers that nobody should hand in, at every door: the right picture, or one typed error that names the argument."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

import torchrender as tr
from torchrender.errors import TorchRenderError

CAMERA = tr.Cameras.look_at([1.5, 1.5, 2.0], [0.0, 0.0, 0.0], width=40, height=30)
NOBODY = CAMERA[:0]
BOX, FLOOR = tr.Mesh.box(1.0), tr.Mesh.plane(6.0, (0.0, -0.5, 0.0))
LAMP = tr.PointLight(position=[2.0, 3.0, 4.0], intensity=20.0)
LIGHT = tr.RectLight(corner=[0.0, 3.0, 0.0], edge_u=[1.0, 0.0, 0.0], edge_v=[0.0, 0.0, 1.0])
CLOUD = tr.PointCloud(position=torch.rand(60, 3, generator=torch.Generator().manual_seed(1)).double())
NAN, INF = math.nan, math.inf


def scene(box: tr.Mesh = BOX, **changes: object) -> tr.Scene:
    parts = {"meshes": [box, FLOOR], "materials": [tr.Material(diffuse=0.5)], "lights": [LAMP], **changes}
    return tr.Scene(**parts)


def picture(box: tr.Mesh = BOX, **changes: object) -> Tensor:
    return tr.render(scene(box, **changes), CAMERA).radiance


def filled(*shape: int, value: float = 0.5) -> Tensor:
    return torch.full(shape, value)


def images() -> tr.DepthImages:
    return tr.sample_depth_images(scene(), CAMERA)


def drawn_again(colors: Tensor) -> object:
    return tr.reproject(images(), CAMERA, colors=colors)


def panel(**changes: object) -> tr.RectLight:
    return tr.RectLight(**{"corner": [0, 2, 0], "edge_u": [1, 0, 0], "edge_v": [0, 0, 1], **changes})


LAST = torch.tensor([0.0, 0.0, 0.0, 1.0])[None, None] * torch.tensor([1.0, 0.0, 0.0, 0.0])[None, :, None]


def posed(change: Callable[[Tensor], Tensor]) -> tr.Cameras:
    return replace(CAMERA, camera_from_world=change(CAMERA.camera_from_world.clone()))


REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "NaN in a texture": (lambda: tr.Material(diffuse_texture=filled(2, 2, 3, value=NAN)), "texture must be finite"),
    "a texture of bytes": (lambda: tr.Material(diffuse_texture=filled(2, 2, 3).byte()), "texture must hold floats"),
    "NaN in colours": (lambda: replace(BOX, colors=filled(24, 3, value=NAN)), "mesh 'box': colors must be finite"),
    "faces of truth values": (lambda: replace(BOX, faces=BOX.faces > 3), "mesh 'box': faces must be an integer tensor"),
    "a vertex too far": (lambda: replace(BOX, vertices=BOX.vertices * 1e30), "mesh 'box': vertices must lie within"),
    "a lamp too far": (
        lambda: tr.PointLight(position=[0, 1e20, 0], name="lamp"),
        r"light 'lamp': PointLight.position must lie within 1e\+15 scene units of the origin, got 1e\+20",
    ),
    "a spot too far": (lambda: tr.SpotLight(position=[-2e15, 0, 0], direction=[1, 0, 0]), "SpotLight.position must"),
    "a panel too far": (lambda: panel(corner=[0, 2e15, 0]), "RectLight.corner must lie within"),
    "a panel too large": (lambda: panel(edge_v=[0, 0, 1e16]), "RectLight.edge_v must lie within"),
    "an eye too far": (lambda: look(eye=[0.0, 0.0, 1e17]), r"eye must lie within 1e\+16 scene units"),
    "a target too far": (lambda: look(target=[0.0, 0.0, 1e17]), r"target must lie within 1e\+16 scene units"),
    "a matrix that leads too far": (lambda: posed(lambda m: m + 1e17 * LAST), "camera_from_world must lie within"),
    "a medium too large": (lambda: tr.Medium(low=[-1e16, 0, 0], high=[1, 1, 1]), "low must lie within"),
    "points too far": (lambda: tr.PointCloud(position=filled(2, 3, value=1e20)), "position must lie within"),
    "a sparse place": (lambda: replace(BOX, vertices=BOX.vertices.to_sparse()), "must be a dense tensor, its layout"),
    "a sparse eye": (lambda: look(eye=torch.ones(3).to_sparse()), "eye must be a dense tensor"),
    "a sparse matrix": (lambda: posed(lambda m: m.to_sparse()), "camera_from_world must be a dense tensor"),
    "a sparse colour": (lambda: tr.PointLight(position=[0, 1, 0], intensity=torch.ones(3).to_sparse()), "dense tensor"),
    "a sparse sky": (lambda: tr.Environment(radiance=filled(2, 4, 3).to_sparse()), "radiance must be a dense tensor"),
    "a sparse texture": (lambda: tr.Material(diffuse_texture=filled(2, 2, 3).to_sparse()), "must be a dense tensor"),
    "half a material": (lambda: replace(BOX, material=0.5), "mesh 'box': material must be a number in Scene"),
    "a text for a matrix": (lambda: BOX.transformed("x"), "mesh 'box': matrix must be"),
    "endless ambient light": (lambda: scene(ambient=INF), "ambient must be finite"),
    "a negative light": (lambda: tr.PointLight(position=[0, 1, 0], intensity=-1), "intensity must not be negative"),
    "a sky turned by NaN": (lambda: tr.Environment(radiance=filled(2, 4, 3), rotation_deg=NAN), "rotation_deg must be"),
    "a sky times infinity": (lambda: tr.Environment(radiance=filled(2, 4, 3), intensity=INF), "intensity must be"),
    "a sky too bright": (
        lambda: tr.Environment(radiance=filled(2, 4, 3, value=1e38), intensity=1e3), "radiance times intensity"
    ),
    "a camera that scales": (lambda: posed(lambda m: 2.0 * m), "camera_from_world must be a rotation"),
    "a camera that shears": (lambda: posed(lambda m: m + torch.triu(filled(4, 4), 1)[None]), "must be a rotation"),
    "an angle of 180 degrees": (lambda: look(fov_deg=180.0), r"fov_deg must be in \(0, 179.9\]"),
    "an angle as a text": (lambda: look(fov_deg="50"), r"fov_deg must be in \(0, 179.9\], got '50'"),
    "an eye in the plane": (lambda: look(eye=[0.0, 1.0]), r"eye must have shape \(3,\) or \(B, 3\)"),
    "an eye as a text": (lambda: look(eye="0"), "eye must be"),
    "two eyes, three targets": (lambda: look(eye=filled(2, 3), target=torch.zeros(3, 3)), "eye, target and up must be"),
    "voxels for layers": (
        lambda: tr.render_volume(tr.voxelize_scene(scene(), 8), CAMERA), "layers must be VolumeLayer, one or several"
    ),
    "no width": (lambda: tr.render(scene(), width=0, height=4), "width must be an integer"),
    "no height": (lambda: tr.render(scene(), CAMERA, height=0), "height must be an integer"),
    "a number as a text": (lambda: tr.Material(specular="1"), "specular must be a number, got '1'"),
    "nothing for a number": (lambda: tr.Material(metallic=0.5, roughness=None), "roughness must be a number"),
    "NaN to reproject": (lambda: drawn_again(filled(1, 30, 40, 3, value=NAN)), "colors must be finite"),
    "bytes to reproject": (lambda: drawn_again(filled(1, 30, 40, 3).byte()), "colors must hold floats"),
    "cameras for images": (lambda: tr.sample_offset_images(scene(), CAMERA), "images must be DepthImages"),
    "a lamp without area": (lambda: tr.soft_shadow(scene(), LAMP, seen()), "lights must be RectLight, one or several"),
    "points as bright as bytes": (lambda: replace(CLOUD, color=filled(60, 3).byte()), "color must hold floats"),
    "no set of points": (lambda: tr.make_grid(torch.zeros(0, 4, 3), 8), "points must hold at least one set"),
    "no mesh to fill": (lambda: tr.voxelize_solid(torch.zeros(0, 24, 3), BOX.faces, 8), "must hold at least one"),
    "a number to load": (lambda: tr.load(3), "load takes a path or a name, got int"),
    "a light in a text": (lambda: scene(lights="x"), "lights must be PointLight or"),
}  # fmt: skip


def look(**changes: object) -> tr.Cameras:
    given = {"eye": [0.0, 0.0, 1.0], "target": [0.0, 0.0, 0.0], "width": 4, "height": 4, **changes}
    return tr.Cameras.look_at(**given)


def seen(camera: tr.Cameras = CAMERA) -> tr.GBuffer:
    return tr.rasterize(scene(), camera)


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_is_refused_by_name(what: str) -> None:
    call, told = REFUSED[what]
    with pytest.raises(TorchRenderError, match=told):
        call()


# ------------------------------------------------------------------------ taken

SAME: dict[str, Callable[[], Tensor]] = {
    "vertices of 16 bits": lambda: picture(replace(BOX, vertices=BOX.vertices.half())),
    "vertices of bfloat16": lambda: picture(replace(BOX, vertices=BOX.vertices.bfloat16())),
    "vertices of 64 bits": lambda: picture(replace(BOX, vertices=BOX.vertices.double())),
    "faces of 32 bits": lambda: picture(replace(BOX, faces=BOX.faces.int())),
    "faces of bytes": lambda: picture(replace(BOX, faces=BOX.faces.to(torch.uint8))),
    "a white texture of 16 bits": lambda: picture(materials=[textured(torch.float16)]),
    "a white texture of bfloat16": lambda: picture(materials=[textured(torch.bfloat16)]),
    "a white texture of 64 bits": lambda: picture(materials=[textured(torch.float64)]),
    "normals that are NaN": lambda: picture(replace(BOX, normals=filled(24, 3, value=NAN))),
    "normals that are infinite": lambda: picture(replace(BOX, normals=filled(24, 3, value=INF))),
    "texture coordinates that are NaN": lambda: picture(
        replace(BOX, uv=filled(24, 2, value=NAN)), materials=[textured(torch.float32)]
    ),
    "texture coordinates that are infinite": lambda: picture(
        replace(BOX, uv=filled(24, 2, value=INF)), materials=[textured(torch.float32)]
    ),
    "a mirrored box": lambda: picture(BOX.transformed(torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0])))),
    "three lamps in one place": lambda: picture(lights=[replace(LAMP, intensity=20 / 3)] * 3),
    "a lamp alone": lambda: picture(lights=LAMP),
    "intrinsics of 16 bits": lambda: tr.render(scene(), replace(CAMERA, intrinsics=CAMERA.intrinsics.half())).radiance,
}


def textured(dtype: torch.dtype) -> tr.Material:
    return tr.Material(diffuse=0.5, diffuse_texture=torch.ones(4, 4, 3, dtype=dtype))


@pytest.mark.parametrize("what", SAME)
def test_the_same_numbers_in_another_form_give_the_same_picture(what: str) -> None:
    usual, found = picture(), SAME[what]()
    limit = 0.02 if what == "intrinsics of 16 bits" else 1e-4
    assert float((found - usual).abs().mean()) <= limit * float(usual.mean())
    assert float(usual.mean()) > 0.01


@pytest.mark.parametrize("radiance", [1e-6, 1e6])
def test_pictures_are_as_bright_as_their_lights(radiance: float) -> None:
    """Skies, suns and lamps from a millionth to a million: the same picture, times that."""
    for lights in (
        {"lights": [tr.DirectionalLight(direction=[0.3, -1.0, -0.2], irradiance=radiance)]},
        {"lights": [tr.SpotLight(position=[0, 3, 0], direction=[0, -1, 0], intensity=radiance)]},
        {"lights": [replace(LAMP, intensity=radiance)]},
        {"lights": [], "environment": tr.Environment(radiance=filled(4, 8, 3, value=radiance))},
    ):
        one = {
            "lights": [_of_one(light) for light in lights["lights"]],
            "environment": tr.Environment(radiance=torch.ones(4, 8, 3)) if "environment" in lights else None,
        }
        found, wanted = picture(**lights), picture(**one)
        torch.testing.assert_close(found / radiance, wanted, rtol=1e-4, atol=1e-5)


def _of_one(light: object) -> object:
    name = "irradiance" if isinstance(light, tr.DirectionalLight) else "intensity"
    return replace(light, **{name: 1.0})


@pytest.mark.parametrize("fov_deg", [1e-3, 179.9])
def test_views_as_narrow_and_as_wide_as_they_may_be(fov_deg: float) -> None:
    """Depths are those of rays through the same pixels."""
    camera = tr.Cameras.look_at([1.5, 1.5, 2.0], [0.01, 0.02, 0.03], width=40, height=30, fov_deg=fov_deg)
    found = seen(camera)
    origins, directions = camera.rays()
    hits = tr.RayCaster(scene()).first_hit(origins[0].reshape(-1, 3), directions[0].reshape(-1, 3), t_min=0.01)
    depth = hits.t.reshape(30, 40)  # directions have depth one
    both = torch.isfinite(depth) & found.covered[0]
    assert float((torch.isfinite(depth) == found.covered[0]).double().mean()) > 0.99 and bool(both.any())
    torch.testing.assert_close(found.depth[0].double()[both], depth[both], rtol=1e-4, atol=0)
    assert bool(torch.isfinite(tr.render(scene(), camera).radiance).all())


SKEWED = torch.tensor([[[30.7, 1.3, 17.2], [0.0, 21.1, 13.9], [0.0, 0.0, 1.0]]], dtype=torch.float64)
FAR_OFF = torch.tensor([[[300.0, 0.0, 170.0], [0.0, 210.0, -90.0], [0.0, 0.0, 1.0]]], dtype=torch.float64)


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("intrinsics", [SKEWED, FAR_OFF], ids=["skewed", "off the centre"])
def test_pixels_see_what_projects_onto_them(intrinsics: Tensor, orthographic: bool) -> None:
    camera = replace(CAMERA, intrinsics=intrinsics, orthographic=orthographic, far=torch.tensor(90.0))
    found = seen(camera)
    assert bool(found.covered.any())
    place, depth = camera.project(found.position)
    wanted = camera.pixel_centres().expand_as(place)
    torch.testing.assert_close(place[found.covered], wanted[found.covered], atol=1e-4, rtol=0)
    torch.testing.assert_close(depth[found.covered].float(), found.depth[found.covered], rtol=1e-5, atol=1e-6)


def test_a_mirrored_camera_sees_the_mirrored_picture() -> None:
    flip = torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0], dtype=torch.float64))
    found, usual = (tr.render(scene(), camera).radiance for camera in (posed(lambda m: flip @ m), CAMERA))
    assert float((found.flip(2) - usual).abs().mean()) < 0.02 * float(usual.mean())


def test_denormal_directions_and_places() -> None:
    sun = tr.DirectionalLight(direction=[1e-40, -1e-40, 0.0])
    wanted = tr.DirectionalLight(direction=[1.0, -1.0, 0.0])
    torch.testing.assert_close(picture(lights=[sun]), picture(lights=[wanted]))
    tiny = replace(BOX, vertices=BOX.vertices.double() * 1e-30)
    found = tr.render(tr.Scene(meshes=[tiny]), width=40, height=30).radiance
    usual = tr.render(tr.Scene(meshes=[BOX]), width=40, height=30).radiance
    assert float((found - usual).abs().mean()) < 0.02 * float(usual.mean())


NONE: dict[str, Callable[[], object]] = {
    "render": lambda: tr.render(scene(), NOBODY).radiance,
    "rasterize": lambda: seen(NOBODY).uv1_footprint,
    "rasterize_depth": lambda: tr.rasterize_depth(scene(), NOBODY),
    "outputs": lambda: tr.rasterize(scene(), NOBODY, outputs=("normal",))["normal"],
    "reproject": lambda: tr.reproject(images(), NOBODY).color,
    "soft_shadow": lambda: tr.soft_shadow(scene(), LIGHT, seen(NOBODY)).visibility,
    "points": lambda: tr.render_points(CLOUD, NOBODY).image,
    "flow": lambda: tr.flow(seen(NOBODY), seen(NOBODY)).flow,
    "visibility": lambda: tr.visibility(NOBODY, seen(NOBODY)),
    "rays": lambda: tr.RayCaster(BOX).first_hit(torch.zeros(0, 3), torch.zeros(0, 3)).t,
    "project": lambda: NOBODY.project(torch.zeros(5, 3))[0],
    "unproject": lambda: NOBODY.unproject(NOBODY.pixel_centres(), torch.zeros(0, 30, 40)),
}


@pytest.mark.parametrize("what", NONE)
def test_no_camera_is_an_empty_answer(what: str) -> None:
    found = NONE[what]()
    assert found is None or (isinstance(found, Tensor) and found.shape[0] == 0)
