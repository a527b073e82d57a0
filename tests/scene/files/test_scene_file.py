from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from gltf_builder import Glb
from torchrender.errors import SceneFileError
from torchrender.scene.files.scene_geometry import rotation_xyz
from torchrender.scene.light import DirectionalLight, PointLight, RectLight, SpotLight
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.place import place_cameras, place_light, place_medium, similarity_scale


def scene_of(folder: Path, text: str) -> Scene:
    (folder / "scene.toml").write_text(text)
    return load(folder / "scene.toml")


FULL = """
name = "Reading corner"
ambient = 0.1

[[material]]
name = "wood"
diffuse = "#bc0000"
texture = "wood.png"
specular = 0.2
gloss = 0.4
shininess = 10
emission = [0, 0.5, 0]
alpha_cutoff = 0.5

[[geometry]]
file = "chair.glb"
translate = [0, 1, 0]
rotate_deg = [0, 90, 0]
scale = 2
material = "wood"

[[geometry]]
shape = "sphere"
radius = 2.0
segments = 16
name = "ball"

[[light]]
type = "point"
position = [0, 3, 0]
intensity = 5
range = 20

[[light]]
type = "directional"
direction = [0, -2, 0]
irradiance = [1, 2, 3]

[[light]]
type = "spot"
position = [0, 3, 0]
target = [0, 0, 4]
inner_deg = 10
outer_deg = 15

[[light]]
type = "rect"
corner = [0, 3, 0]
edge_u = [1, 0, 0]
edge_v = [0, 0, 2]
radiance = "#ffffff"
name = "window"

[environment]
color = [0.1, 0.2, 0.3]
intensity = 2
rotation_deg = 30

[[medium]]
name = "smoke"
low = [-1, 0, -1]
high = [1, 2, 1]
absorption = 0.01
scattering = [0.1, 0.2, 0.3]
asymmetry = 0.5
density = 3
density_file = "smoke.npy"

[[camera]]
name = "door"
eye = [0, 1, 5]
target = [0, 1, 0]
fov_deg = 60
near = 0.1
far = 100
width = 640
height = 480

[[camera]]
name = "plan"
eye = [0, 10, 0]
target = [0, 0, 0]
view_height = 4
"""


@pytest.fixture
def full(tmp_path: Path) -> Scene:
    Image.new("RGB", (2, 3), (255, 255, 255)).save(tmp_path / "wood.png")
    np.save(tmp_path / "smoke.npy", np.arange(24, dtype=np.float32).reshape(2, 3, 4))
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh()
    glb.write(tmp_path / "chair.glb")
    return scene_of(tmp_path, FULL)


def test_whole_file(full: Scene) -> None:
    assert full.name == "Reading corner"
    assert full.ambient.tolist() == pytest.approx([0.1] * 3)
    wood = full.materials[0]
    assert wood.name == "wood"
    assert wood.diffuse.tolist() == pytest.approx([0.5029, 0, 0], abs=1e-4)
    assert wood.diffuse_texture is not None
    assert wood.diffuse_texture.shape == (3, 2, 3)
    assert (wood.specular, wood.gloss, wood.shininess, wood.alpha_cutoff) == (0.2, 0.4, 10.0, 0.5)
    chair, ball = full.meshes
    assert (chair.material, chair.object_id, ball.object_id) == (0, 0, 1)
    assert (ball.name, full.materials[ball.material].name) == ("ball", "default")
    # (x,y,z) -> scaled by 2, turned so that z becomes x and x becomes -z, raised by one.
    torch.testing.assert_close(
        chair.vertices, torch.tensor([[0, 1, 0], [0, 1, -2], [0, 3, 0]]).double(), atol=1e-12, rtol=0
    )


def test_lights_cameras_and_media(full: Scene) -> None:
    point, sun, spot, window = full.lights
    assert isinstance(point, PointLight)
    assert (point.intensity.tolist(), point.range) == ([5, 5, 5], 20.0)
    assert isinstance(sun, DirectionalLight)
    assert sun.direction.tolist() == [0, -1, 0]
    assert isinstance(spot, SpotLight)
    assert spot.direction.tolist() == pytest.approx([0, -0.6, 0.8])
    assert spot.range == math.inf
    assert isinstance(window, RectLight)
    assert (window.name, window.area) == ("window", 2.0)
    assert full.environment is not None
    assert (full.environment.intensity, full.environment.rotation_deg) == (2, 30)
    smoke = full.media[0]
    assert isinstance(smoke.density, torch.Tensor)
    assert smoke.density.shape == (2, 3, 4)
    assert float(smoke.density.max()) == 69.0
    assert list(full.cameras) == ["door", "plan"]
    door, plan = full.cameras.values()
    assert (door.width, door.height) == (640, 480)
    assert door.forward[0].tolist() == pytest.approx([0, 0, -1])
    assert 2 * math.degrees(math.atan(240 / float(door.intrinsics[0, 1, 1]))) == pytest.approx(60)
    assert plan.orthographic
    assert float(plan.intrinsics[0, 0, 0]) == pytest.approx(plan.height / 4)


def test_empty_scene_is_allowed(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "name = 'nothing'")
    assert scene.geometry.triangle_count == 0
    assert len(scene.materials) == 1


def test_scene_file_comments_and_line_ends(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_bytes(b"# a comment\r\nname = 'a'\r\n")
    assert load(tmp_path / "scene.toml").name == "a"


LAMP = "[[light]]\ntype = 'point'\nposition = [0, 1, 2]\n"
SPOT = "[[light]]\ntype = 'spot'\nposition = [0,1,2]\ndirection = [1,0,0]\n"
BOX = "[[medium]]\nlow = [0,0,0]\nhigh = [1,1,1]\n"
VIEW = "[[camera]]\neye = [0,0,0]\ntarget = [0,0,1]\n"

BAD = {
    "nam = 'a'": r"nam: unknown key; did you mean 'name'\?",
    "name = 3": r"name: must be text, got 3",
    "name = ": r"not a TOML file",
    "light = 3": r"light: must be tables \[\[light\]\], got 3",
    LAMP + "[[light]]\ntype = 'pont'": r"light\[1\]\.type: must be one of .*did you mean 'point'",
    "[[light]]\ntype = 'point'": r"light\[0\]\.position: is missing",
    "[[light]]\ntype = 'point'\nposition = [0, 1]": r"light\[0\]\.position: must be 3 numbers, got \[0, 1\]",
    "[[light]]\ntype = 'point'\nposition = [0, 1, nan]": r"light\[0\]\.position: must be 3 numbers",
    "[[light]]\ntype = 'point'\nposition = [0, 1, true]": r"light\[0\]\.position: must be 3 numbers",
    LAMP + "range = 0": r"light\[0\]\.range: must be",
    LAMP + "intensity = -1": r"light\[0\]\.intensity: must be >= 0",
    LAMP + "intensity = '#12'": r"light\[0\]\.intensity: must be three numbers",
    LAMP + "intensty = 1": r"light\[0\]\.intensty: .*did you mean 'intensity'",
    "[[light]]\ntype = 'spot'\nposition = [0, 1, 2]": r"light\[0\]: needs either direction or target",
    "[[light]]\ntype = 'directional'\ndirection = [0, 0, 0]": r"light\[0\]\.direction: gives no direction",
    SPOT + "outer_deg = 95": r"outer_deg: must be in \[0.001, 90\]",
    "[[material]]\nname = 'a'\nspecular = 1.5": r"material\[0\]\.specular: must be in \[0, 1\], got 1.5",
    "[[material]]\nname = 'a'\n[[material]]\nname = 'a'": r"material\[1\]\.name: is used twice",
    "[[material]]\nname = 'a'\ntexture = 'no.png'": r"material\[0\]\.texture: no such file: 'no.png'",
    "[[geometry]]\nshape = 'box'\nmaterial = 'b'": r"geometry\[0\]\.material: no material is named 'b'; known: none",
    "[[geometry]]\nshape = 'box'\nfile = 'a.glb'": r"geometry\[0\]: needs exactly one of file, procedural and shape",
    "[[geometry]]": r"geometry\[0\]: needs exactly one of file, procedural and shape, has none",
    "[[geometry]]\nfile = 'no.glb'": r"geometry\[0\]\.file: no such file: 'no.glb'",
    "[[geometry]]\nshape = 'box'\nscale = 0": r"geometry\[0\]\.scale: must not be zero",
    "[[geometry]]\nshape = 'box'\nsize = [1, 0, 1]": r"geometry\[0\]: size must be positive",
    "[[geometry]]\nshape = 'sphere'\nsegments = 1000000": r"geometry\[0\]\.segments: must be .* in \[1, 2048\]",
    "[[geometry]]\nshape = 'box'\nkeep = ['light']": r"geometry\[0\]\.keep: must be a list out of lights",
    "[[geometry]]\nprocedural = 'citty'": r"geometry\[0\]\.procedural: no scene is named 'citty'.*did you mean 'city'",
    "[[geometry]]\nprocedural = 'city'\ntriangles = 0": r"geometry\[0\]\.triangles: must be a whole number",
    "[environment]\nintensity = 1": r"environment: needs either file or color",
    "[environment]\ncolor = 1\nfile = 'a.exr'": r"environment: needs either file or color",
    "[[medium]]\nlow = [0,0,0]\nhigh = [0,1,1]": r"medium\[0\]: .*high must exceed low",
    BOX + "asymmetry = 1": r"medium\[0\]\.asymmetry: must be in \[-0.99, 0.99\]",
    "[[camera]]\neye = [0,0,0]\ntarget = [0,0,0]": r"camera\[0\]: eye and target must differ",
    VIEW + "width = 0": r"camera\[0\]\.width: must be a whole number in \[1, 32768\]",
    VIEW + "near = 2\nfar = 1": r"camera\[0\]: far must be greater than near",
    VIEW + "fov_deg = 50\nview_height = 1": r"camera\[0\]\.fov_deg: does not go with",
    f"[[camera]]\neye = [0,0,1{'0' * 400}]\ntarget = [0,0,1]": r"camera\[0\]\.eye: must be 3 numbers",
}


@pytest.mark.parametrize("text", BAD, ids=lambda t: t.replace("\n", " ")[:60])
def test_mistakes_name_file_key_and_reason(tmp_path: Path, text: str) -> None:
    with pytest.raises(SceneFileError, match=BAD[text]) as caught:
        scene_of(tmp_path, text)
    assert str(caught.value).startswith(str(tmp_path / "scene.toml"))


def test_files_inside_are_named_with_their_own_reason(tmp_path: Path) -> None:
    for name in ("a.glb", "a.png", "a.npy"):
        (tmp_path / name).write_bytes(b"nonsense")
    with pytest.raises(SceneFileError, match=r"scene\.toml: geometry\[0\]\.file: .*a\.glb: damaged"):
        scene_of(tmp_path, "[[geometry]]\nfile = 'a.glb'")
    with pytest.raises(SceneFileError, match=r"scene\.toml: material\[0\]\.texture: .*a\.png"):
        scene_of(tmp_path, "[[material]]\nname = 'a'\ntexture = 'a.png'")
    with pytest.raises(SceneFileError, match=r"scene\.toml: medium\[0\]\.density_file: .*a\.npy: damaged"):
        scene_of(tmp_path, "[[medium]]\nlow = [0,0,0]\nhigh = [1,1,1]\ndensity_file = 'a.npy'")


def test_environment_picture(tmp_path: Path, data_dir: Path) -> None:
    scene = scene_of(tmp_path, f"[environment]\nfile = '{data_dir / 'envmaps' / 'museum.exr'}'")
    assert scene.environment is not None
    assert scene.environment.radiance.shape == (256, 512, 3)


def test_mitsuba_volume(tmp_path: Path, data_dir: Path) -> None:
    path = data_dir / "volumes" / "mitsuba_volume.vol"
    scene = scene_of(tmp_path, f"[[medium]]\nlow = [0,0,0]\nhigh = [1,1,1]\ndensity_file = '{path}'")
    density = scene.media[0].density
    assert isinstance(density, torch.Tensor)
    assert density.shape == (53, 45, 44)
    assert float(density.max()) == pytest.approx(1.85, abs=0.01)


# ----------------------------------------------------- what geometry brings along


def lit(folder: Path) -> None:
    lights = [{"type": "point", "intensity": 8.0}]
    glb = Glb(
        extensions={"KHR_lights_punctual": {"lights": lights}},
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        scenes=[{"nodes": [0, 1]}],
        nodes=[{"mesh": 0, "extensions": {"KHR_lights_punctual": {"light": 0}}}, {"camera": 0, "name": "own"}],
    )
    glb.mesh()
    glb.write(folder / "lit.glb")


def test_lights_and_cameras_of_a_file_stay_unless_the_scene_has_its_own(tmp_path: Path) -> None:
    lit(tmp_path)
    geometry = "[[geometry]]\nfile = 'lit.glb'\n"
    light = "[[light]]\ntype = 'point'\nposition = [0,0,0]\n"
    scene = scene_of(tmp_path, geometry)
    assert (len(scene.lights), list(scene.cameras)) == (1, ["own"])
    scene = scene_of(tmp_path, light + geometry)
    assert (len(scene.lights), list(scene.cameras)) == (1, ["own"])
    assert scene.lights[0].name == "point"
    scene = scene_of(tmp_path, light + geometry + "keep = ['lights']")
    assert (len(scene.lights), list(scene.cameras)) == (2, [])


def test_kept_lights_and_cameras_move_along(tmp_path: Path) -> None:
    lit(tmp_path)
    scene = scene_of(tmp_path, "[[geometry]]\nfile = 'lit.glb'\nscale = 2\ntranslate = [1, 0, 0]")
    light = scene.lights[0]
    assert isinstance(light, PointLight)
    assert (light.position.tolist(), light.intensity.tolist()) == ([1, 0, 0], [32, 32, 32])
    assert scene.cameras["own"].eye[0].tolist() == [1, 0, 0]
    with pytest.raises(SceneFileError, match=r"geometry\[0\]: lights, cameras and media can only .*'keep'"):
        scene_of(tmp_path, "[[geometry]]\nfile = 'lit.glb'\nscale = [1, 2, 1]")
    scene = scene_of(tmp_path, "[[geometry]]\nfile = 'lit.glb'\nscale = [1, 2, 1]\nkeep = []")
    assert scene.bounds[1].tolist() == [1, 2, 0]


def similarity() -> torch.Tensor:
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] = rotation_xyz(torch.tensor([10.0, 20.0, 30.0])) * 1.7
    matrix[:3, 3] = torch.tensor([1.0, 2.0, 3.0])
    return matrix


def test_moved_cameras_see_the_moved_scene_as_before(full: Scene) -> None:
    matrix = similarity()
    assert similarity_scale(matrix) == pytest.approx(1.7)
    points = torch.rand(20, 3, dtype=torch.float64)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    for camera in full.cameras.values():
        before, depth = camera.project(points)
        after, new_depth = place_cameras(camera, matrix).project(moved)
        torch.testing.assert_close(after, before, rtol=0, atol=1e-8)
        torch.testing.assert_close(new_depth, depth * 1.7)


def test_moved_lights_light_the_moved_scene_as_before(full: Scene) -> None:
    matrix = similarity()
    point, sun, spot, window = (place_light(light, matrix) for light in full.lights)
    assert isinstance(point, PointLight)
    old = full.lights[0]
    assert isinstance(old, PointLight)
    here = torch.tensor([0.3, 0.2, 0.1], dtype=torch.float64)
    there = matrix[:3, :3] @ here + matrix[:3, 3]
    before = old.intensity / (here - old.position).square().sum()
    torch.testing.assert_close(point.intensity / (there - point.position).square().sum(), before, rtol=1e-5, atol=0)
    assert point.range == pytest.approx(20.0 * 1.7, rel=1e-6)
    assert isinstance(sun, DirectionalLight)
    assert isinstance(spot, SpotLight)
    assert isinstance(window, RectLight)
    assert window.area == pytest.approx(2.0 * 1.7**2, rel=1e-5)
    turn = matrix[:3, :3] / 1.7
    torch.testing.assert_close(
        sun.direction.double(), turn @ torch.tensor([0.0, -1.0, 0.0]).double(), rtol=0, atol=1e-6
    )
    torch.testing.assert_close(spot.direction.double(), turn @ torch.tensor([0, -0.6, 0.8]).double(), rtol=0, atol=1e-6)


def test_moved_media_keep_their_optical_depth(full: Scene) -> None:
    matrix = torch.diag(torch.tensor([2.0, 2.0, 2.0, 1.0], dtype=torch.float64))
    smoke = place_medium(full.media[0], matrix)
    old = full.media[0]
    torch.testing.assert_close((smoke.high - smoke.low) * smoke.scattering, (old.high - old.low) * old.scattering)


def test_rotations() -> None:
    turn = rotation_xyz(torch.tensor([90.0, 0.0, 0.0]))
    torch.testing.assert_close(
        turn @ torch.tensor([0.0, 1, 0]).double(), torch.tensor([0.0, 0, 1]).double(), atol=1e-12, rtol=0
    )
    both = rotation_xyz(torch.tensor([30.0, 50.0, 70.0]))
    parts = [rotation_xyz(torch.eye(3)[k] * a) for k, a in enumerate((30.0, 50.0, 70.0))]
    torch.testing.assert_close(both, parts[2] @ parts[1] @ parts[0])


# ----------------------------------------------------------------------- shapes

SHAPES = {
    "shape = 'box'\nsize = [2, 3, 4]": (24.0, (2, 3, 4)),
    "shape = 'sphere'\nradius = 2\nsegments = 128": (4 / 3 * math.pi * 8, (4, 4, 4)),
    "shape = 'cylinder'\nradius = 2\nheight = 3\nsegments = 128": (12 * math.pi, (4, 3, 4)),
    "shape = 'cone'\nradius = 2\nheight = 3\nsegments = 128": (4 * math.pi, (4, 3, 4)),
    "shape = 'torus'\nradius = 2\ntube = 0.5\nsegments = 128": (2 * math.pi**2 * 2 * 0.25, (5, 1, 5)),
}


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float((a * torch.linalg.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("text", SHAPES)
def test_closed_shapes_have_their_volume(tmp_path: Path, text: str) -> None:
    from torchrender.scene.info import scene_info

    scene = scene_of(tmp_path, f"[[geometry]]\n{text}")
    mesh = scene.meshes[0]
    expected, extent = SHAPES[text]
    assert volume(mesh) == pytest.approx(expected, rel=5e-3)
    low, high = scene.bounds
    assert (high - low).tolist() == pytest.approx(extent)
    assert scene_info(scene)["closed"]
    assert scene_info(scene)["degenerate_triangles"] == 0
    assert mesh.normals is not None
    corner = mesh.normals[mesh.faces]
    assert float((corner * scene.geometry.face_normals[:, None]).sum(-1).min()) > 0.95


def test_open_shapes(tmp_path: Path) -> None:
    plane = scene_of(tmp_path, "[[geometry]]\nshape = 'plane'\nsize = [4, 2]\nsegments = 3\ntiles = 5").geometry
    assert plane.triangle_count == 18
    assert plane.bounds.tolist() == [[-2, 0, -1], [2, 0, 1]]
    assert plane.face_normals.tolist() == [[0, 1, 0]] * 18
    assert plane.uv is not None
    assert float(plane.uv.max()) == 5
    quad = scene_of(
        tmp_path, "[[geometry]]\nshape = 'quad'\ncorner = [0,0,0]\nedge_u = [1,0,0]\nedge_v = [0,1,0]"
    ).geometry
    assert quad.face_normals.tolist() == [[0, 0, 1]] * 2


def test_placement_is_known_where_nothing_is_placed(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[[geometry]]\nshape = 'box'\nqqq = 1")
    with pytest.raises(SceneFileError, match=r"known: .*rotate_deg, scale, .*translate"):
        load(tmp_path / "a.toml")


def test_files_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_bytes(b"\xef\xbb\xbfname = 'marked'\n[[geometry]]\nshape = 'box'\n")
    assert load(tmp_path / "a.toml").name == "marked"


def test_phong_keys_beside_those_of_metal_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text("[[material]]\nname = 'a'\nroughness = 0.5\nshininess = 5\n")
    with pytest.raises(SceneFileError, match=r"material\[0\].*shininess is of Phong materials"):
        load(tmp_path / "a.toml")
