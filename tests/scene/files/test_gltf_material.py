"""glTF materials: every field, texture and sampler, and what is said of the rest."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from gltf_builder import Glb
from torchrender.errors import InputError, NotUsedWarning, RepairedWarning, SceneFileError
from torchrender.scene.files.gltf.materials import MIRROR_IOR
from torchrender.scene.files.gltf.out.materials import downwards
from torchrender.scene.files.gltf.out.write import write_glb
from torchrender.scene.files.gltf.textures import upwards
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene


def picture(color: tuple[int, ...], size: tuple[int, int] = (1, 1), kind: str = "PNG") -> bytes:
    file = io.BytesIO()
    Image.new({1: "L", 3: "RGB", 4: "RGBA"}[len(color)], size, color).save(file, kind, lossless=True)
    return file.getvalue()


def with_material(entry: dict[str, Any], *pictures: bytes, **more: Any) -> Glb:
    """A triangle with two sets of texture coordinates and this material; texture k shows picture k."""
    glb = Glb(nodes=[{"mesh": 0}], materials=[entry], **more)
    uv = [glb.accessor([[k, 0.0], [k, 1.0], [k + 1, 0.0]]) for k in range(2)]
    glb.mesh(material=0, TEXCOORD_0=uv[0], TEXCOORD_1=uv[1])
    if pictures:
        glb.json["images"] = [{"bufferView": glb.view(p)} for p in pictures]
        glb.json.setdefault("textures", [{"source": k} for k in range(len(pictures))])
    return glb


def material_of(glb: Glb, folder: Path) -> Material:
    return load(glb.write(folder / "a.glb")).materials[0]


def test_metallic_roughness(tmp_path: Path) -> None:
    pbr = {"baseColorFactor": [0.2, 0.4, 0.8, 0.5], "metallicFactor": 0.25, "roughnessFactor": 0.3}
    entry = {"pbrMetallicRoughness": pbr, "emissiveFactor": [0.1, 0.2, 0.3], "name": "blue"}
    material = material_of(with_material(entry), tmp_path)
    assert material.name == "blue"
    assert material.diffuse.tolist() == pytest.approx([0.2, 0.4, 0.8])  # linear already
    assert (material.metallic, material.roughness) == (0.25, 0.3)
    assert material.emission.tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert (material.alpha_cutoff, material.blend, material.opacity) == (None, False, 1.0)
    assert not material.double_sided and not material.unlit


def test_a_material_without_any_member_is_a_metal(tmp_path: Path) -> None:
    material = material_of(with_material({}), tmp_path)
    assert (material.metallic, material.roughness, material.diffuse.tolist()) == (1.0, 1.0, [1.0, 1.0, 1.0])


def test_plain_textures_are_not_decoded_as_colours(tmp_path: Path) -> None:
    entry = {
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}, "baseColorTexture": {"index": 0}},
        "normalTexture": {"index": 0, "scale": 2.0},
        "occlusionTexture": {"index": 0, "strength": 0.25},
        "emissiveTexture": {"index": 0},
        "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 5.0}},
    }
    material = material_of(with_material(entry, picture((51, 102, 204))), tmp_path)
    for name in ("metallic_roughness_texture", "normal_texture", "occlusion_texture"):
        assert getattr(material, name)[0, 0].tolist() == pytest.approx([0.2, 0.4, 0.8])
    for name in ("diffuse_texture", "emission_texture"):
        assert getattr(material, name)[0, 0].tolist() == pytest.approx([0.033105, 0.132868, 0.603827], rel=1e-4)
    assert (material.normal_scale, material.occlusion_strength) == (2.0, 0.25)
    assert material.emission.tolist() == [5.0, 5.0, 5.0]


def test_an_emissive_texture_without_factor_does_not_shine(tmp_path: Path) -> None:
    material = material_of(with_material({"emissiveTexture": {"index": 0}}, picture((255, 255, 255))), tmp_path)
    assert material.emission_texture is None and float(material.emission.max()) == 0.0


@pytest.mark.parametrize(
    ("mode", "expected"), [("OPAQUE", (None, False, 1.0)), ("MASK", (0.25, False, 0.6)), ("BLEND", (None, True, 0.6))]
)
def test_alpha_modes(tmp_path: Path, mode: str, expected: tuple[float | None, bool, float]) -> None:
    base = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.6]}
    entry = {"pbrMetallicRoughness": base, "alphaMode": mode, "alphaCutoff": 0.25, "doubleSided": True}
    material = material_of(with_material(entry, picture((255, 255, 255, 51))), tmp_path)
    assert (material.alpha_cutoff, material.blend, material.opacity) == expected
    assert material.diffuse_texture is not None and float(material.diffuse_texture[0, 0, 3]) == pytest.approx(0.2)
    assert material.double_sided


def test_a_cutoff_above_one_hides_everything(tmp_path: Path) -> None:
    material = material_of(with_material({"alphaMode": "MASK", "alphaCutoff": 1.5}), tmp_path)
    assert material.alpha_cutoff is not None and material.opacity < material.alpha_cutoff


def test_extensions(tmp_path: Path) -> None:
    extensions = {
        "KHR_materials_ior": {"ior": 1.33},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [0.1, 0.2, 0.3]},
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.75, "clearcoatRoughnessFactor": 0.25},
        "KHR_materials_sheen": {"sheenColorFactor": [0.4, 0.5, 0.6], "sheenRoughnessFactor": 0.7},
        "KHR_materials_transmission": {"transmissionFactor": 0.9},
        "KHR_materials_unlit": {},
    }
    material = material_of(with_material({"extensions": extensions}), tmp_path)
    assert (material.ior, material.specular_weight, material.unlit) == (1.33, 0.5, True)
    assert material.specular_color.tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert (material.clearcoat, material.clearcoat_roughness, material.transmission) == (0.75, 0.25, 0.9)
    assert material.sheen_color.tolist() == pytest.approx([0.4, 0.5, 0.6]) and material.sheen_roughness == 0.7


def test_two_pictures_become_channels_of_one(tmp_path: Path) -> None:
    coat = {"clearcoatFactor": 1.0, "clearcoatTexture": {"index": 0}, "clearcoatRoughnessTexture": {"index": 1}}
    tint = {"specularColorTexture": {"index": 2}, "specularTexture": {"index": 3}}
    entry = {"extensions": {"KHR_materials_clearcoat": coat, "KHR_materials_specular": tint}}
    pictures = (
        picture((51, 1, 1), (4, 2)),
        picture((1, 102, 1), (2, 4)),
        picture((188, 0, 255)),
        picture((9, 9, 9, 51)),
    )
    material = material_of(with_material(entry, *pictures), tmp_path)
    assert material.clearcoat_texture is not None and material.specular_texture is not None
    assert material.clearcoat_texture.shape[:2] == (4, 4)
    assert material.clearcoat_texture[1, 1, :2].tolist() == pytest.approx([0.2, 0.4])
    assert material.specular_texture[0, 0].tolist() == pytest.approx([0.5029, 0.0, 1.0, 0.2], abs=1e-4)


def test_specular_glossiness_keeps_its_reflectance(tmp_path: Path) -> None:
    gloss = {"diffuseFactor": [0.1, 0.2, 0.3, 1.0], "specularFactor": [0.8, 0.4, 0.0], "glossinessFactor": 0.75}
    entry = {"extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}}
    material = material_of(with_material(entry), tmp_path)
    assert material.diffuse.tolist() == pytest.approx([0.1, 0.2, 0.3])
    assert material.mirror_color.tolist() == pytest.approx([0.8, 0.4, 0.0], abs=1e-6)
    assert material.roughness == pytest.approx(0.25) and material.ior == MIRROR_IOR
    gloss["specularGlossinessTexture"] = {"index": 0}
    material = material_of(with_material(entry, picture((188, 188, 255, 51))), tmp_path)
    assert material.specular_texture is not None and material.metallic_roughness_texture is not None
    assert material.specular_texture[0, 0].tolist() == pytest.approx([0.5029, 0.5029, 1.0], abs=1e-4)
    assert float(material.metallic_roughness_texture[0, 0, 1]) == pytest.approx(1 - 0.75 * 0.2)


WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}


@pytest.mark.parametrize("wrap", WRAPS)
def test_samplers(tmp_path: Path, wrap: str) -> None:
    more = {
        "samplers": [{"wrapS": WRAPS[wrap], "wrapT": 33071, "magFilter": 9728, "minFilter": 9728}],
        "textures": [{"source": 0, "sampler": 0}],
    }
    entry = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}
    scene = load(with_material(entry, picture((1, 2, 3)), **more).write(tmp_path / "a.glb"))
    sampler = scene.materials[0].sampler("diffuse_texture")
    assert (sampler.wrap_u, sampler.wrap_v, sampler.filter) == (wrap, "clamp", "nearest")
    # The only set that the material reads is the mesh's first one.
    uv = scene.meshes[0].uv
    assert sampler.uv_set == 0 and uv is not None
    assert sorted(uv.tolist()) == [[1.0, 0.0], [1.0, 1.0], [2.0, 1.0]]


def test_two_sets_of_texture_coordinates(tmp_path: Path) -> None:
    entry = {
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
        "occlusionTexture": {"index": 0, "texCoord": 1},
    }
    scene = load(with_material(entry, picture((1, 2, 3))).write(tmp_path / "a.glb"))
    sets = [scene.materials[0].sampler(n).uv_set for n in ("diffuse_texture", "occlusion_texture")]
    assert sets == [0, 1] and scene.meshes[0].uv1 is not None


angles = st.floats(-3.0, 3.0)
factors = st.floats(0.1, 4.0)


@settings(deadline=None)
@given(angles, factors, factors, angles, angles, st.floats(0, 1), st.floats(0, 1))
def test_texture_transform_turns_the_way_of_the_format(
    angle: float, sx: float, sy: float, ox: float, oy: float, u: float, v: float
) -> None:
    """``T R S`` on coordinates with v down, against the same map on coordinates with v up."""
    cosine, sine = math.cos(angle), math.sin(angle)
    rotation = np.array([[cosine, sine], [-sine, cosine]])  # of the extension's text
    expected = rotation @ (np.array([sx, sy]) * [u, v]) + [ox, oy]
    matrix = upwards([ox, oy], angle, [sx, sy])
    found = matrix.double().numpy() @ [u, 1 - v, 1]
    np.testing.assert_allclose([found[0], 1 - found[1]], expected, atol=1e-5)
    back = downwards(matrix)
    again = upwards(back["offset"], back["rotation"], back["scale"])
    torch.testing.assert_close(again, matrix, atol=1e-5, rtol=1e-5)


def test_webp_and_its_plain_stand_in(tmp_path: Path) -> None:
    textures = [{"source": 1, "extensions": {"EXT_texture_webp": {"source": 0}}}]
    entry = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    pictures = (picture((255, 0, 0), kind="WEBP"), picture((0, 255, 0)))
    material = material_of(with_material(entry, *pictures, textures=textures), tmp_path)
    assert material.diffuse_texture is not None and material.diffuse_texture[0, 0].tolist() == [1.0, 0.0, 0.0]
    broken = with_material(entry, b"RIFF0000WEBPdamaged", pictures[1], textures=textures)
    with pytest.warns(NotUsedWarning, match="EXT_texture_webp, the plain picture is taken"):
        material = material_of(broken, tmp_path)
    assert material.diffuse_texture is not None and material.diffuse_texture[0, 0].tolist() == [0.0, 1.0, 0.0]


def test_vertex_colours_bring_opacity(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(COLOR_0=glb.accessor([[255, 0, 51, 0], [255, 0, 51, 51], [255, 0, 51, 255]], "uint8", normalized=True))
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert mesh.alpha is not None and sorted(mesh.alpha.tolist()) == pytest.approx([0.0, 0.2, 1.0])


def test_tangents_follow_their_node(tmp_path: Path) -> None:
    """A mirroring node turns the sign of the bitangent, and the normal stays outside."""
    glb = Glb(nodes=[{"mesh": 0, "scale": [-2, 1, 1]}])
    normal, tangent = glb.accessor([[0.0, 0, 1]] * 3), glb.accessor([[1.0, 0, 0, 1]] * 3)
    glb.mesh(NORMAL=normal, TANGENT=tangent)
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert mesh.tangents is not None and mesh.normals is not None
    assert mesh.tangents[0].tolist() == [-1.0, 0.0, 0.0, -1.0] and mesh.normals[0].tolist() == [0.0, 0.0, 1.0]


def variants_file() -> Glb:
    names = {"variants": [{"name": "day"}, {"name": "night"}]}
    glb = Glb(
        nodes=[{"mesh": 0}], materials=[{"name": "plain"}, {"name": "dark"}],
        extensions={"KHR_materials_variants": names},
    )  # fmt: skip
    glb.mesh(material=0)
    mapping = {"mappings": [{"material": 1, "variants": [1]}]}
    glb.json["meshes"][0]["primitives"][0]["extensions"] = {"KHR_materials_variants": mapping}
    return glb


def test_variants(tmp_path: Path) -> None:
    path = variants_file().write(tmp_path / "a.glb")
    chosen = {v: load(path, variant=v).materials[0].name for v in (None, "day", "night")}
    assert chosen == {None: "plain", "day": "plain", "night": "dark"}
    assert "variants day, night" in str(load(path).report)
    with pytest.raises(InputError, match="no variant 'noon'; known: day, night"):
        load(path, variant="noon")


def test_what_is_not_used_is_said_once_by_name(tmp_path: Path) -> None:
    volume = {"extensions": {"KHR_materials_volume": {"thicknessFactor": 1.0}}}
    glb = with_material(volume)
    glb.json["materials"].append(volume)
    with pytest.warns(NotUsedWarning, match=r"a\.glb: not used: KHR_materials_volume \(2\)$") as said:
        scene = load(glb.write(tmp_path / "a.glb"))
    assert len(said) == 1
    assert [str(n) for n in scene.report.not_used] == ["KHR_materials_volume (2)"]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"alphaMode": "DITHER"}, "unknown alphaMode 'DITHER'"),
        ({"pbrMetallicRoughness": {"roughnessFactor": "x"}}, "roughnessFactor: must be a finite number"),
        ({"emissiveFactor": [1, 2]}, "emissiveFactor: must be 3 finite numbers"),
        ({"normalTexture": {"index": 7}}, r"textures\[7\]: there is no such entry"),
    ],
)
def test_bad_values_name_the_material(tmp_path: Path, entry: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneFileError, match=message):
        load(with_material(entry).write(tmp_path / "a.glb"))


def test_a_written_material_comes_back(tmp_path: Path) -> None:
    """Every field of a metallic-roughness material, its textures and samplers."""
    moved = {"offset": [0.1, 0.2], "rotation": 0.5}
    entry = {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": moved}},
            "metallicRoughnessTexture": {"index": 1}, "metallicFactor": 0.5, "roughnessFactor": 0.25,
        },
        "normalTexture": {"index": 1, "scale": 0.5},
        "occlusionTexture": {"index": 1, "strength": 0.5, "texCoord": 1},
        "emissiveFactor": [1, 0.5, 0], "emissiveTexture": {"index": 0},
        "alphaMode": "BLEND",
        "extensions": {
            "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 1}},
            "KHR_materials_transmission": {"transmissionFactor": 0.5},
            "KHR_materials_ior": {"ior": 1.4},
        },
    }  # fmt: skip
    before = load(with_material(entry, picture((10, 200, 90, 128)), picture((10, 200, 90))).write(tmp_path / "a.glb"))
    write_glb(tmp_path / "b.glb", before)
    after = load(tmp_path / "b.glb")
    a, b = before.materials[0], after.materials[0]
    for name, value in vars(a).items():
        other = getattr(b, name)
        if isinstance(value, torch.Tensor):
            torch.testing.assert_close(other, value, atol=1e-3, rtol=1e-3, msg=name)
        elif name == "samplers":
            assert set(value) == set(other)
            for field, sampler in value.items():
                torch.testing.assert_close(other[field].transform, sampler.transform, atol=1e-5, rtol=1e-5)
                assert (other[field].uv_set, other[field].wrap_u) == (sampler.uv_set, sampler.wrap_u)
        else:
            assert other == pytest.approx(value), name
    assert isinstance(after, Scene) and after.meshes[0].uv1 is not None


def test_numbers_out_of_their_range_are_told(tmp_path: Path) -> None:
    pbr = {"metallicFactor": 5.0, "roughnessFactor": -3.0}
    extensions = {"KHR_materials_emissive_strength": {"emissiveStrength": -1.0}}
    entry = {"pbrMetallicRoughness": pbr, "emissiveFactor": [1.0, 1.0, -1.0], "extensions": extensions}
    with pytest.warns(RepairedWarning, match="metallicFactor outside"):
        scene = load(with_material(entry, extensionsUsed=list(extensions)).write(tmp_path / "a.glb"))
    assert (scene.materials[0].metallic, scene.materials[0].roughness) == (1.0, 0.0)
    told = {note.what for note in scene.report.repaired}
    assert told == {
        "metallicFactor outside [0, 1]: set to its nearest end",
        "roughnessFactor outside [0, 1]: set to its nearest end",
        "emissiveStrength outside [0, inf]: set to its nearest end",
        "emissiveFactor below 0: set to it",
    }


def test_a_rotation_of_zero_is_told(tmp_path: Path) -> None:
    glb = with_material({})
    glb.json["nodes"][0]["rotation"] = [0.0, 0.0, 0.0, 0.0]
    with pytest.warns(RepairedWarning, match="rotation of a node is zero, which is none: it is not turned"):
        load(glb.write(tmp_path / "a.glb"))


def test_json_that_is_nested_too_deeply_is_told(tmp_path: Path) -> None:
    (tmp_path / "deep.gltf").write_text("[" * 200_000)
    with pytest.raises(SceneFileError, match=r"damaged or not glTF \(nested too deeply\)"):
        load(tmp_path / "deep.gltf")
