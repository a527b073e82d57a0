"""Scenes written as GLB and TOML come back as they were."""

from __future__ import annotations

import json
import math
import struct
import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import trimesh
from hypothesis import given
from hypothesis import strategies as st

import torchrender as tr
from torchrender.errors import ImageFileError, NotUsedWarning, SceneFileError
from torchrender.raster import rasterize
from torchrender.scene.environment import Environment
from torchrender.scene.files.gltf.out.materials import metallic_roughness
from torchrender.scene.files.gltf.out.write import LossWarning, glb_bytes, write_glb
from torchrender.scene.files.scene_write import write_scene
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.material import Material, from_metallic_roughness
from torchrender.scene.medium import Medium, medium_values
from torchrender.scene.shapes import box, sphere

ODD = 'stühle/"rot" = [1]\n\\ 椅子 \x7f'
LAMPS = (
    PointLight(position=torch.tensor([1.0, 2.0, 3.0]), intensity=torch.tensor([3.0, 2.0, 0.0]), name="point",
               range=12.0),
    SpotLight(
        position=torch.tensor([0.0, 3.0, 0.0]), direction=torch.tensor([0.0, -1.0, 0.2]),
        intensity=torch.tensor([5.0, 5.0, 4.0]), inner_deg=12.0, outer_deg=33.0, name="spot",
    ),
    DirectionalLight(direction=torch.tensor([0.0, 0.0, 1.0]), irradiance=torch.tensor([1.0, 2.0, 3.0]), name="sun"),
)  # fmt: skip


def scene(**changes) -> tr.Scene:
    """A textured box, a ball with vertex colours, and a flat box without normals, far from the origin."""
    picture = torch.rand(6, 5, 3, generator=torch.Generator().manual_seed(1))
    picture = torch.round(picture * 255) / 255
    picture = torch.where(picture <= 0.04045, picture / 12.92, ((picture + 0.055) / 1.055) ** 2.4)
    first = replace(box(torch.tensor([1.0, 2.0, 3.0])), name=ODD, material=0)
    ball = sphere(0.5, 12)
    ball = replace(
        ball, vertices=ball.vertices.double() + torch.tensor([1e5, 0.0, 2.0]), material=1, name="ball",
        colors=torch.rand(len(ball.vertices), 3, generator=torch.Generator().manual_seed(2)),
    )  # fmt: skip
    flat = replace(first, normals=None, uv=None, name="flat", material=2)
    materials = (
        Material(name="wood", diffuse=torch.tensor([0.9, 0.8, 0.7]), diffuse_texture=picture, specular=0.04, gloss=1.0),
        from_metallic_roughness(name="brass", base_color=torch.tensor([0.8, 0.6, 0.2]), metallic=0.7, roughness=0.3),
        Material(name="lamp", emission=torch.tensor([4.0, 2.0, 1.0]), specular=0.04, alpha_cutoff=0.3),
    )
    return tr.Scene(**{"meshes": (first, ball, flat), "materials": materials, "name": "odd", **changes})


def test_meshes_materials_and_names_come_back(tmp_path: Path) -> None:
    before = scene()
    write_glb(tmp_path / "a.glb", before)
    after = tr.load(tmp_path / "a.glb")
    assert [m.name for m in after.meshes] == [m.name for m in before.meshes]
    for a, b in zip(before.meshes, after.meshes, strict=True):
        corners = (m.vertices.double()[m.faces].reshape(-1, 3) for m in (a, b))
        assert torch.allclose(*corners, atol=1e-6)  # 1e5 units from the origin, too
        if a.normals is not None:
            assert torch.allclose(a.normals[a.faces], b.normals[b.faces], atol=1e-5)
        if a.uv is not None:
            assert torch.allclose(a.uv[a.faces], b.uv[b.faces], atol=1e-6)
        if a.colors is not None:
            assert torch.allclose(a.colors[a.faces], b.colors[b.faces], atol=1e-6)
    for a, b in zip(before.materials, after.materials, strict=True):
        assert a.name == b.name and a.alpha_cutoff == pytest.approx(b.alpha_cutoff)
        assert torch.allclose(a.diffuse, b.diffuse, atol=1e-6) and torch.allclose(a.emission, b.emission, atol=1e-5)
        assert a.specular == pytest.approx(b.specular, abs=1e-6) and a.gloss == pytest.approx(b.gloss, abs=1e-6)
        assert torch.allclose(a.specular_color, b.specular_color, atol=1e-5)
    assert torch.allclose(before.materials[0].diffuse_texture, after.materials[0].diffuse_texture, atol=1e-6)


def test_faces_without_normals_stay_flat(tmp_path: Path) -> None:
    write_glb(tmp_path / "a.glb", scene())
    camera = tr.Cameras.look_at([4.0, 3.0, 5.0], [0.0, 0.0, 0.0], width=64, height=48)
    flat = [m for m in tr.load(tmp_path / "a.glb").meshes if m.name == "flat"]
    seen = rasterize(tr.Scene(meshes=(replace(flat[0], material=0),)), camera)
    assert torch.allclose(seen.normal, seen.geometric_normal, atol=1e-6) and bool(seen.covered.any())


def test_other_programs_read_it(tmp_path: Path) -> None:
    write_glb(tmp_path / "a.glb", scene())
    loaded = trimesh.load(tmp_path / "a.glb")
    assert sum(len(g.faces) for g in loaded.geometry.values()) == sum(len(m.faces) for m in scene().meshes)
    materials = {g.visual.material.name for g in loaded.geometry.values() if hasattr(g.visual, "material")}
    assert "wood" in materials


def test_the_container_keeps_the_rules_of_the_format() -> None:
    data = glb_bytes(scene(lights=LAMPS))
    magic, version, total, size, kind = struct.unpack_from("<4sIIII", data)
    assert (magic, version, total, kind, size % 4) == (b"glTF", 2, len(data), 0x4E4F534A, 0)
    document = json.loads(data[20 : 20 + size])
    for view in document["bufferViews"]:
        assert view["byteOffset"] % 4 == 0
        assert view["byteOffset"] + view["byteLength"] <= document["buffers"][0]["byteLength"]
    for accessor in document["accessors"]:
        assert accessor["count"] > 0
    positions = {p["attributes"]["POSITION"] for m in document["meshes"] for p in m["primitives"]}
    assert all({"min", "max"} <= set(document["accessors"][k]) for k in positions)
    for material in document["materials"]:
        assert all(0 <= v <= 1 for v in material["pbrMetallicRoughness"]["baseColorFactor"])
        assert all(0 <= v <= 1 for v in material.get("emissiveFactor", [0]))
    assert set(document["extensionsUsed"]) == {"KHR_lights_punctual", "KHR_materials_emissive_strength"}


def test_lights_and_cameras_come_back(tmp_path: Path) -> None:
    cameras = {
        "main": tr.Cameras.look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], width=640, height=480, fov_deg=40.0, near=0.05),
    }
    write_glb(tmp_path / "a.glb", scene(lights=LAMPS, cameras=cameras))
    after = tr.load(tmp_path / "a.glb")
    point, spot, sun = after.lights
    assert torch.allclose(point.position, LAMPS[0].position) and torch.allclose(point.intensity, LAMPS[0].intensity)
    assert torch.allclose(spot.direction, LAMPS[1].direction, atol=1e-6)
    assert (point.range, spot.range) == (12.0, math.inf)
    assert spot.outer_deg == pytest.approx(33.0) and spot.inner_deg == pytest.approx(12.0)
    assert torch.allclose(sun.direction, LAMPS[2].direction, atol=1e-6)
    assert torch.allclose(sun.irradiance, LAMPS[2].irradiance)
    camera = after.camera("main", width=640, height=480)
    assert torch.allclose(camera.camera_from_world, cameras["main"].camera_from_world, atol=1e-9)
    assert torch.allclose(camera.intrinsics, cameras["main"].intrinsics, atol=1e-6)


@given(
    st.floats(0.0, 0.95), st.floats(0.0, 0.95), st.floats(0.0, 0.95), st.floats(0.0, 1.0), st.floats(0.0, 1.0)
)  # fmt: skip
def test_metallic_roughness_is_the_inverse_of_reading(
    r: float, g: float, b: float, metallic: float, rough: float
) -> None:
    before = from_metallic_roughness(base_color=torch.tensor([r, g, b]), metallic=metallic, roughness=rough)
    base, metal, gloss = metallic_roughness(before)
    after = from_metallic_roughness(base_color=base, metallic=metal, roughness=gloss)
    assert torch.allclose(before.diffuse, after.diffuse, atol=1e-4)
    # Less than bare plastic cannot be said by metalness.
    assert after.specular == pytest.approx(max(before.specular, 0.04), abs=1e-3)
    assert bool((base >= 0).all()) and 0.0 <= metal <= 1.0


def test_what_a_glb_cannot_hold_is_said() -> None:
    rect = RectLight(
        corner=torch.zeros(3), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0]), name="sky"
    )
    lossy = scene(lights=(rect,), ambient=torch.ones(3), environment=Environment.constant(torch.ones(3)))
    with pytest.warns(LossWarning, match=r"RectLight 'sky', environment 'constant', ambient light"):
        glb_bytes(lossy)


def test_what_textures_lose_is_said_once_by_name(tmp_path: Path) -> None:
    """Phong's textures, numbers above what an image holds, and steps finer than eight bits."""
    codes = np.random.default_rng(3).integers(200, 256, (8, 8, 3))
    assert cv2.imwrite(str(tmp_path / "fine.png"), (codes * 256 + 99).astype(np.uint16))
    assert cv2.imwrite(str(tmp_path / "plain.png"), codes.astype(np.uint8))
    (tmp_path / "a.obj").write_text(
        "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
        "usemtl fine\nf 1/1 2/2 3/3\nusemtl shiny\nf 1/1 2/2 3/3\nusemtl gem\nf 1/1 2/2 3/3\n"
        "usemtl dull\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "a.mtl").write_text(
        "newmtl fine\nmap_Kd fine.png\nnewmtl shiny\nKd .9 .9 .9\nKs .6 .6 .6\nmap_Kd plain.png\nmap_Ks plain.png\n"
        "newmtl gem\nKs .1 .1 .1\nmap_Ks plain.png\nnewmtl dull\nmap_Kd plain.png\n"
    )
    loaded = tr.load(tmp_path / "a.obj")
    with pytest.warns(LossWarning) as said:
        glb_bytes(loaded)
    (text,) = (str(one.message) for one in said)
    assert text.removeprefix("GLB files are written without ").split(" of ", 1)[0] == "more than 8 bits"
    assert "more than 8 bits of the diffuse textures of 'fine'" in text
    assert "what the diffuse textures have above 1 of 'shiny'" in text
    assert "the specular textures of Phong of 'shiny', 'gem'" in text
    assert "dull" not in text and text.count("fine") == text.count("gem") == 1
    kept = loaded.replace(materials=[loaded.materials[-1]], meshes=[replace(loaded.meshes[-1], material=0)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        glb_bytes(kept)


def test_a_warning_names_few_of_many_materials() -> None:
    picture = torch.full((2, 2, 3), 0.3)
    many = [tr.Material(name=f"m{k}", diffuse_texture=picture) for k in range(11)]
    with pytest.warns(LossWarning, match=r"'m7', 3 more$"):
        glb_bytes(scene().replace(materials=many))


def test_toml_holds_everything(tmp_path: Path) -> None:
    rect = RectLight(
        corner=torch.tensor([0.1, 2.0, 0.3]), edge_u=torch.tensor([1.0, 0, 0]), edge_v=torch.tensor([0, 0, 1.0]),
        radiance=torch.tensor([1.0, 2.0, 3.0]), name=ODD,
    )  # fmt: skip
    sky = Environment(
        radiance=torch.rand(4, 8, 3, generator=torch.Generator().manual_seed(0)), intensity=2.0, rotation_deg=30.0
    )
    fog = Medium(low=torch.zeros(3), high=torch.ones(3), density=torch.rand(2, 3, 4), name="fog")
    wide = tr.Cameras.look_at([3.0, 1.0, 2.0], [0.0, 0.0, 0.0], width=100, height=50, fov_deg=70.0)
    flat = tr.Cameras.look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], width=64, height=48)
    flat = replace(flat, orthographic=True, far=torch.tensor([50.0]), intrinsics=flat.intrinsics.clone())
    before = scene(
        lights=(*LAMPS, rect), ambient=torch.tensor([0.1, 0.2, 0.3]), environment=sky, media=(fog,), photometric=True,
        cameras={"wide": wide, "flat": flat},
    )  # fmt: skip
    files = write_scene(tmp_path / "a.toml", before)
    assert len(files) == 4 and all(f.is_file() for f in files)
    after = tr.load(tmp_path / "a.toml")
    assert after.name == "odd" and torch.allclose(after.ambient, before.ambient) and after.photometric
    for a, b in zip(before.lights, after.lights, strict=True):
        assert type(a) is type(b) and a.name == b.name
        for name, value in vars(a).items():
            if isinstance(value, torch.Tensor):
                assert torch.allclose(value, getattr(b, name), atol=1e-6), name
    assert after.environment is not None and torch.allclose(after.environment.radiance, sky.radiance)
    assert (after.environment.intensity, after.environment.rotation_deg) == (2.0, 30.0)
    assert torch.allclose(after.media[0].density, fog.density)
    for name, camera in before.cameras.items():
        assert torch.allclose(after.cameras[name].camera_from_world, camera.camera_from_world, atol=1e-6)
        assert torch.allclose(after.cameras[name].intrinsics, camera.intrinsics, rtol=1e-6)
    assert [m.name for m in after.meshes] == [m.name for m in before.meshes]


@pytest.mark.parametrize("diffuse", [0.3, 1.0])
@pytest.mark.parametrize("specular", [0.0, 0.1, 0.5])
def test_bright_phong_materials_stay_as_bright(tmp_path: Path, diffuse: float, specular: float) -> None:
    """Also where their base colour would be above one, and no texture takes the rest."""
    tile = Material(name="tile", diffuse=torch.tensor([diffuse, 0.5 * diffuse, 0.2]), specular=specular)
    write_glb(tmp_path / "a.glb", tr.Scene(meshes=[tr.Mesh.box(1.0)], materials=[tile]))
    after = tr.load(tmp_path / "a.glb").materials[0]
    torch.testing.assert_close(after.diffuse, tile.diffuse, atol=1e-6, rtol=0.0)
    assert after.specular == pytest.approx(specular)


def test_media_come_back_from_extras(tmp_path: Path) -> None:
    """Every field of them, also where the file is one of several in a scene; other programs' extras are said."""
    grid = Medium(low=torch.zeros(3), high=torch.ones(3), density=torch.rand(2, 3, 4), name="smoke", asymmetry=0.3)
    haze = Medium(
        low=torch.tensor([-5.0, 0.0, -5.0]), high=torch.tensor([5.0, 2.0, 5.0]), density=0.2, falloff=0.5, floor=0.1,
        absorption=torch.tensor([0.1, 0.2, 0.3]), emission=torch.tensor([0.0, 0.5, 0.0]), density_scales="absorption",
    )  # fmt: skip
    write_glb(tmp_path / "a.glb", scene(media=(grid, haze)))
    (tmp_path / "b.toml").write_text("[[geometry]]\nfile = 'a.glb'\nkeep = ['media']\n")
    for file in ("a.glb", "b.toml"):
        after = tr.load(tmp_path / file)
        assert [medium_values(m) for m in after.media] == [medium_values(m) for m in (grid, haze)]
    assert "media (2)" in str(tr.load(tmp_path / "a.glb").report)
    data = (tmp_path / "a.glb").read_bytes()
    (tmp_path / "c.glb").write_bytes(data.replace(b'"low":', b'"lot":'))
    with pytest.warns(NotUsedWarning, match=r"extras\.media of the scene"):
        assert tr.load(tmp_path / "c.glb").media == ()
    (tmp_path / "d.glb").write_bytes(data.replace(b'"asymmetry":0.3', b'"asymmetry":7.5'))
    with pytest.raises(SceneFileError, match=r"scenes\[0\]\.extras\.media\[0\].*asymmetry"):
        tr.load(tmp_path / "d.glb")


@pytest.mark.parametrize("photometric", [False, True])
def test_how_light_is_meant_comes_back(tmp_path: Path, photometric: bool) -> None:
    """Lux and candela ask for an exposure, and light of photos for no shadows, in the file as in the scene."""
    before = scene(lights=LAMPS, photometric=photometric, photo_light=photometric)
    write_glb(tmp_path / "a.glb", before)
    (tmp_path / "b.toml").write_text("[[geometry]]\nfile = 'a.glb'\nkeep = ['lights']\n")
    for file in ("a.glb", "b.toml"):
        after = tr.load(tmp_path / file)
        assert after.photometric == photometric
    assert tr.load(tmp_path / "a.glb").photo_light == photometric
    data = (tmp_path / "a.glb").read_bytes()
    if photometric:
        (tmp_path / "c.glb").write_bytes(data.replace(b'"photometric":true', b'"photometric":1234'))
        with pytest.warns(NotUsedWarning, match=r"extras\.photometric of the scene"):
            assert not tr.load(tmp_path / "c.glb").photometric


@pytest.mark.parametrize("name", ["a.obj", "a", "missing/a.glb", "missing/a.toml"])
def test_where_it_cannot_be_written(tmp_path: Path, name: str) -> None:
    with pytest.raises((SceneFileError, ImageFileError), match=r"\.glb|does not exist"):
        write_scene(tmp_path / name, scene())
    assert not list(tmp_path.iterdir())


def test_nothing_to_write(tmp_path: Path) -> None:
    with pytest.raises(SceneFileError, match="no triangles"):
        write_scene(tmp_path / "a.glb", tr.Scene())


def test_a_bright_factor_goes_into_the_texture(tmp_path: Path) -> None:
    dim = torch.full((2, 2, 3), 0.25)
    material = Material(name="bright", diffuse=torch.tensor([2.0, 1.0, 0.5]), diffuse_texture=dim)
    write_glb(tmp_path / "a.glb", scene(materials=(material,) * 3))
    after = tr.load(tmp_path / "a.glb").materials[0]
    assert torch.allclose((after.diffuse * after.diffuse_texture)[0, 0], torch.tensor([0.5, 0.25, 0.125]), atol=5e-3)
    assert math.isclose(float(after.diffuse.max()), 1.0)
