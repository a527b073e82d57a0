from __future__ import annotations

import base64
import io
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from gltf_builder import TRIANGLE, Glb
from torchrender.errors import RepairedWarning, SceneFileError
from torchrender.scene.files.texture_file import MissingTextureWarning
from torchrender.scene.light import DirectionalLight, PointLight, SpotLight
from torchrender.scene.load import load

TURN_Y = [0.0, math.sin(math.pi / 4), 0.0, math.cos(math.pi / 4)]  # 90 degrees about y: z to x, x to -z


def png(color: tuple[int, ...], size: tuple[int, int] = (2, 2)) -> bytes:
    stream = io.BytesIO()
    Image.new("RGBA" if len(color) == 4 else "RGB", size, color).save(stream, "PNG")
    return stream.getvalue()


def with_material(material: dict[str, object], *pictures: bytes) -> Glb:
    glb = Glb(materials=[material], nodes=[{"mesh": 0}])
    glb.mesh(material=0, TEXCOORD_0=glb.accessor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    for k, data in enumerate(pictures):
        glb.json.setdefault("images", []).append({"bufferView": glb.view(data), "mimeType": "image/png"})
        glb.json.setdefault("textures", []).append({"source": k})
    return glb


# ------------------------------------------------------------------------ nodes


def test_node_hierarchy(tmp_path: Path) -> None:
    """Scale, then rotation, then translation, then the same of the parent; every node is one object."""
    glb = Glb(
        nodes=[
            {"children": [1], "translation": [10, 0, 0], "rotation": TURN_Y},
            {"mesh": 0, "scale": [2, 3, 4], "translation": [0, 0, 5], "children": [2], "name": "outer"},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 1, 1, 1], "name": "inner"},
        ]
    )
    glb.mesh()
    scene = load(glb.write(tmp_path / "a.glb"))
    assert [m.name for m in scene.meshes] == ["outer", "inner"]
    assert [m.object_id for m in scene.meshes] == [0, 1]

    def expected(p: np.ndarray) -> np.ndarray:
        x, y, z = (p * [2, 3, 4] + [0, 0, 5]).T
        return np.stack([z + 10, y, -x], axis=1)

    triangle = np.array(TRIANGLE)
    np.testing.assert_allclose(scene.meshes[0].vertices.numpy(), expected(triangle), atol=1e-6)
    np.testing.assert_allclose(scene.meshes[1].vertices.numpy(), expected(triangle + 1), atol=1e-6)


def test_normals_that_are_not_finite_are_said_and_not_known(tmp_path: Path) -> None:
    vertices = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(vertices, NORMAL=glb.accessor(np.array([[0.0, 0, 1], [0, np.nan, 1], [1, 0, 0]])))
    with pytest.warns(RepairedWarning, match=r"normals that are NaN or infinite: taken as not known \(1\)"):
        geometry = load(glb.write(tmp_path / "a.glb")).geometry
    assert geometry.normals is not None and geometry.normals.tolist() == [[0, 0, 1], [0, 0, 0], [1, 0, 0]]


@pytest.mark.parametrize("scale", [[1, 1, 1], [2, 3, 4], [-1, 1, 1], [-1, -2, -3], [1, -1, -1]])
def test_normals_stay_perpendicular_and_outside(tmp_path: Path, scale: list[float]) -> None:
    vertices = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    normal = np.full((3, 3), 1 / math.sqrt(3))
    glb = Glb(nodes=[{"mesh": 0, "scale": scale, "rotation": [0.1, 0.2, 0.3, 0.9]}])
    glb.mesh(vertices, NORMAL=glb.accessor(normal))
    geometry = load(glb.write(tmp_path / "a.glb")).geometry
    assert geometry.normals is not None
    torch.testing.assert_close(geometry.normals, geometry.face_normals.expand(3, 3), rtol=0, atol=1e-6)
    # The origin lies behind the face, whatever the transform.
    assert float((geometry.face_normals[0].double() * geometry.vertices[0]).sum()) > 0


def test_missing_normals_are_computed(tmp_path: Path) -> None:
    """Two faces at 20 degrees share smooth normals, at 90 degrees they do not."""
    for angle, count in ((20, 4), (90, 6)):
        a = math.radians(angle)
        vertices = [[0, 0, 0], [0, 0, 1], [1, 0, 0], [-math.cos(a), -math.sin(a), 0]]
        glb = Glb(nodes=[{"mesh": 0}])
        glb.mesh(vertices, [0, 1, 2, 0, 3, 1])
        assert len(load(glb.write(tmp_path / "a.glb")).meshes[0].vertices) == count


def test_nodes_must_form_trees(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"children": [1]}, {"children": [0], "mesh": 0}])
    glb.mesh()
    with pytest.raises(SceneFileError, match=r"nodes\[0\]: is reached twice"):
        load(glb.write(tmp_path / "loop.glb"))


# ---------------------------------------------------------------------- cameras


def test_cameras_look_along_minus_z(tmp_path: Path) -> None:
    lens = {"yfov": math.radians(60), "aspectRatio": 2.0, "znear": 0.5, "zfar": 50.0}
    glb = Glb(
        cameras=[{"type": "perspective", "perspective": lens}],
        nodes=[
            {"children": [1, 2], "translation": [0, 2, 0], "rotation": TURN_Y},
            {"camera": 0, "name": "eye"},
            {"mesh": 0},
        ],
    )
    glb.mesh()
    scene = load(glb.write(tmp_path / "a.glb"))
    camera = scene.cameras["eye"]
    torch.testing.assert_close(camera.eye[0], torch.tensor([0.0, 2.0, 0.0]).double())
    torch.testing.assert_close(camera.forward[0], torch.tensor([-1.0, 0.0, 0.0]).double(), rtol=0, atol=1e-12)
    assert (camera.width, camera.height) == (1440, 720)
    # y up in the world is up in the picture; 30 degrees above the axis is the upper border; right is -z here.
    top = torch.tensor([[-1.0, 2 + math.tan(math.radians(30)), 0.0], [-1.0, 2.0, -0.1]], dtype=torch.float64)
    pixels, depth = camera.project(top)
    torch.testing.assert_close(pixels[0, 0], torch.tensor([720.0, 0.0]).double(), rtol=0, atol=1e-9)
    assert float(pixels[0, 1, 0]) > 720
    assert depth[0].tolist() == pytest.approx([1.0, 1.0])
    assert (float(camera.near), float(camera.far)) == (0.5, 50.0)


def test_orthographic_and_infinite_cameras(tmp_path: Path) -> None:
    glb = Glb(
        cameras=[
            {"type": "orthographic", "orthographic": {"xmag": 2.0, "ymag": 1.0, "znear": 0.0, "zfar": 9.0}},
            {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}},
        ],
        nodes=[{"children": [1, 2], "mesh": 0}, {"camera": 0, "name": "a"}, {"camera": 1, "name": "a"}],
    )
    glb.mesh()
    flat, wide = load(glb.write(tmp_path / "a.glb")).cameras.values()
    assert flat.orthographic
    pixels, _ = flat.project(torch.tensor([[2.0, 1.0, -3.0]], dtype=torch.float64))
    assert pixels[0, 0].tolist() == [flat.width, 0.0]
    assert not wide.orthographic
    assert math.isinf(float(wide.far))


def test_scaled_camera_nodes_stay_rigid(tmp_path: Path) -> None:
    glb = Glb(
        cameras=[{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}],
        nodes=[{"scale": [3, 3, 3], "children": [1], "mesh": 0}, {"camera": 0, "translation": [0, 0, 2]}],
    )
    glb.mesh()
    camera = next(iter(load(glb.write(tmp_path / "a.glb")).cameras.values()))
    rotation = camera.rotation[0]
    torch.testing.assert_close(rotation @ rotation.T, torch.eye(3).double())
    assert camera.eye[0].tolist() == [0.0, 0.0, 6.0]


# ----------------------------------------------------------------------- lights


def test_punctual_lights(tmp_path: Path) -> None:
    lights = [
        {"type": "point", "color": [1.0, 0.5, 0.0], "intensity": 8.0, "name": "lamp"},
        {"type": "spot", "range": 7.5, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.5}},
        {"type": "directional", "intensity": 3.0},
    ]
    nodes: list[dict[str, object]] = [
        {"extensions": {"KHR_lights_punctual": {"light": k}}, "rotation": TURN_Y, "translation": [k, 0, 0]}
        for k in range(3)
    ]
    glb = Glb(
        extensions={"KHR_lights_punctual": {"lights": lights}},
        scenes=[{"nodes": [0, 1, 2, 3]}],
        nodes=[*nodes, {"mesh": 0}],
    )
    glb.mesh()
    point, spot, sun = load(glb.write(tmp_path / "a.glb")).lights
    assert isinstance(point, PointLight)
    assert (point.name, point.intensity.tolist()) == ("lamp", [8.0, 4.0, 0.0])
    assert isinstance(spot, SpotLight)
    assert spot.position.tolist() == [1.0, 0.0, 0.0]
    torch.testing.assert_close(spot.direction, torch.tensor([-1.0, 0.0, 0.0]))
    assert (point.range, spot.range) == (math.inf, 7.5)
    assert (spot.inner_deg, spot.outer_deg) == pytest.approx((math.degrees(0.2), math.degrees(0.5)))
    assert isinstance(sun, DirectionalLight)
    torch.testing.assert_close(sun.direction, torch.tensor([-1.0, 0.0, 0.0]))
    assert sun.irradiance.tolist() == [3.0, 3.0, 3.0]


@pytest.mark.parametrize("value", [0, -2.5, "far"])
def test_a_range_of_nothing_is_an_error(value: object, tmp_path: Path) -> None:
    lights = [{"type": "point", "range": value}]
    glb = Glb(
        extensions={"KHR_lights_punctual": {"lights": lights}},
        scenes=[{"nodes": [0, 1]}],
        nodes=[{"extensions": {"KHR_lights_punctual": {"light": 0}}}, {"mesh": 0}],
    )
    glb.mesh()
    with pytest.raises(SceneFileError, match=r"lights\[0\]\.range"):
        load(glb.write(tmp_path / "a.glb"))


# -------------------------------------------------------------------- materials


def test_textures_are_decoded_and_shared(tmp_path: Path) -> None:
    entry = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0.0}}
    glb = with_material(entry, png((188, 0, 255)))
    glb.json["materials"].append({**entry, "name": "other"})
    glb.mesh(material=1, TEXCOORD_0=0)
    glb.json["nodes"] = [{"mesh": 0, "children": [1]}, {"mesh": 1}]
    scene = load(glb.write(tmp_path / "a.glb"))
    first, second = (m.diffuse_texture for m in scene.materials)
    assert first is not None
    assert first is second
    assert first[0, 0].tolist() == pytest.approx([0.5029, 0.0, 1.0], abs=1e-4)
    # Texture coordinates count from the lower left here, from the upper left in the file.
    assert scene.meshes[0].uv is not None
    assert scene.meshes[0].uv.tolist() == [[0.0, 1.0], [1.0, 1.0], [0.0, 0.0]]


def test_missing_texture_is_a_warning(tmp_path: Path) -> None:
    glb = with_material({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 0, 0, 1]}})
    glb.json["textures"], glb.json["images"] = [{"source": 0}], [{"uri": "gone.png"}]
    with pytest.warns(
        MissingTextureWarning,
        match=r"a\.glb: materials\[0\]: texture .*: file 'gone.png' cannot be read \(No such file",
    ):
        scene = load(glb.write(tmp_path / "a.glb"))
    assert scene.materials[0].diffuse_texture is None
    (told,) = scene.report.plain()["not_used"]
    assert told.startswith("materials[0]: texture ") and "gone.png" in told, "whoever sees no warning reads it there"


# --------------------------------------------------------------------- accessors


def test_vertex_colours_and_normalised_integers(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(COLOR_0=glb.accessor([[255, 0, 51, 255]] * 3, "uint8", normalized=True))
    colors = load(glb.write(tmp_path / "a.glb")).meshes[0].colors
    assert colors is not None
    torch.testing.assert_close(colors, torch.tensor([[1.0, 0.0, 0.2]]).expand(3, 3))


def test_interleaved_and_sparse_accessors(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}])
    rows = np.hstack([np.array(TRIANGLE), np.full((3, 3), 9.0)]).astype(np.float32)
    view = glb.view(rows.tobytes())
    glb.json["bufferViews"][view]["byteStride"] = 24
    sparse = {
        "count": 1,
        "indices": {"bufferView": glb.view(np.array([2], np.uint8).tobytes()), "componentType": 5121},
        "values": {"bufferView": glb.view(np.array([5, 6, 7], np.float32).tobytes())},
    }
    glb.json["accessors"].append(
        {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}
    )
    glb.json["meshes"] = [{"primitives": [{"attributes": {"POSITION": 0}}]}]
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert sorted(mesh.vertices.tolist()) == sorted([*TRIANGLE[:2], [5.0, 6.0, 7.0]])


@pytest.mark.parametrize(
    ("mode", "faces"),
    [(4, [[0, 1, 2]]), (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]), (6, [[0, 1, 2], [0, 2, 3], [0, 3, 4]])],
)
def test_lists_strips_and_fans(tmp_path: Path, mode: int, faces: list[list[int]]) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], dtype=float)
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(vertices, NORMAL=glb.accessor(np.tile([0.0, 0, 1], (5, 1))))
    glb.json["meshes"][0]["primitives"][0]["mode"] = mode
    assert load(glb.write(tmp_path / "a.glb")).meshes[0].faces.tolist() == faces


def test_text_gltf_with_data_uri_and_with_files(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}], scenes=[{"nodes": [0]}])
    glb.mesh()
    (tmp_path / "the data.bin").write_bytes(glb.binary)
    for uri in ("the%20data.bin", "data:application/octet-stream;base64," + base64.b64encode(glb.binary).decode()):
        parts = {**glb.json, "buffers": [{"byteLength": len(glb.binary), "uri": uri}]}
        (tmp_path / "a.gltf").write_text(json.dumps(parts))
        assert load(tmp_path / "a.gltf").geometry.triangle_count == 1
