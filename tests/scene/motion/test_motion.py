"""Animations, skins, morph targets and instances: against what the format's text says of each."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

import torchrender as tr
from gltf_builder import TRIANGLE, Glb
from torchrender.errors import InputError, NotUsedWarning, RepairedWarning, SceneFileError
from torchrender.rays import RayCaster
from torchrender.scene.camera import framing_camera
from torchrender.scene.load import load
from torchrender.scene.mesh import concatenate
from torchrender.scene.motion.pose import slerp

QUARTER = [0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4)]  # about z
STILL = [0.0, 0.0, 0.0, 1.0]


def animated(path: str, times: Any, values: Any, interpolation: str = "LINEAR", node: int = 0) -> Glb:
    """A triangle whose node has one animated property, and one more triangle that stands still."""
    glb = Glb(nodes=[{"mesh": 0}, {"mesh": 0}], scenes=[{"nodes": [0, 1]}])
    glb.mesh()
    sampler = {"input": glb.accessor(times), "output": glb.accessor(values), "interpolation": interpolation}
    channel = {"sampler": 0, "target": {"node": node, "path": path}}
    glb.json["animations"] = [{"name": "Walk", "channels": [channel], "samplers": [sampler]}]
    return glb


def corners(scene: tr.Scene, mesh: int = 0) -> np.ndarray:
    return scene.meshes[mesh].vertices.numpy()


@pytest.mark.parametrize(
    ("interpolation", "values", "time", "expected"),
    [
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 0.25, 1.0),
        ("STEP", [[0, 0, 0], [4, 0, 0]], 0.99, 0.0),
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], -3.0, 0.0),
        ("LINEAR", [[0, 0, 0], [4, 0, 0]], 99.0, 4.0),
        # In-tangent, value, out-tangent: the cubic 3t^2 - 2t^3 where both tangents are zero, a line where they are 4.
        ("CUBICSPLINE", [[0] * 3, [0] * 3, [0] * 3, [0] * 3, [4, 0, 0], [0] * 3], 0.25, 4 * (3 / 16 - 2 / 64)),
        ("CUBICSPLINE", [[9] * 3, [0] * 3, [4, 0, 0], [4, 0, 0], [4, 0, 0], [9] * 3], 0.25, 1.0),
    ],
)
def test_translations(tmp_path: Path, interpolation: str, values: Any, time: float, expected: float) -> None:
    path = animated("translation", [0.0, 1.0], np.array(values, float), interpolation).write(tmp_path / "a.glb")
    rest = load(path)
    np.testing.assert_allclose(corners(rest), np.array(TRIANGLE)[rest_order(rest)], atol=1e-9)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotUsedWarning)  # what is shown beyond the animation's time, is said
        timed = load(path, time=time)
    for scene in (timed, rest.at(time), rest.at(time, "Walk"), rest.at(time, 0)):
        np.testing.assert_allclose(corners(scene), corners(rest) + np.array([expected, 0, 0]), atol=1e-6)
        assert scene.meshes[1].vertices.tolist() == rest.meshes[1].vertices.tolist()


def test_the_animation_that_was_named_plays_on(tmp_path: Path) -> None:
    glb = animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]])
    sampler = {"input": glb.accessor([0.0, 2.0]), "output": glb.accessor([[0.0, 0, 0], [0.0, 8.0, 0]])}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    glb.json["animations"].append({"name": "Rise", "channels": [channel], "samplers": [sampler]})
    path = glb.write(tmp_path / "a.glb")
    (tmp_path / "rising.toml").write_text('[[geometry]]\nfile = "a.glb"\nanimation = "Rise"\n')
    rest = corners(load(path))
    for scene in (load(path, animation="Rise"), load(tmp_path / "rising.toml"), load(path).at(1.0, "Rise")):
        np.testing.assert_allclose(corners(scene.at(0.5)), rest + np.array([0, 2.0, 0]), atol=1e-6)
        assert scene.looped(2.5) == 0.5
        np.testing.assert_allclose(corners(scene.at(0.5, "Walk").at(0.25)), rest + np.array([1.0, 0, 0]), atol=1e-6)
    np.testing.assert_allclose(corners(load(path).at(0.5)), rest + np.array([2.0, 0, 0]), atol=1e-6)


def rest_order(scene: tr.Scene) -> list[int]:
    """Which corner of the triangle each vertex is."""
    return [TRIANGLE.index(v) for v in scene.meshes[1].vertices.tolist()]


def test_rotations_go_the_short_way_at_constant_speed(tmp_path: Path) -> None:
    turned = [-v for v in QUARTER]  # the same rotation, the long way round
    rest = load(animated("rotation", [0.0, 1.0], [STILL, turned]).write(tmp_path / "a.glb"))
    for share in (0.0, 0.3, 1.0):
        angle = share * math.pi / 2
        moved = corners(rest.at(share))
        base = corners(rest)
        expected = np.stack(
            [
                math.cos(angle) * base[:, 0] - math.sin(angle) * base[:, 1],
                math.sin(angle) * base[:, 0] + math.cos(angle) * base[:, 1],
                base[:, 2],
            ],
            axis=1,
        )
        np.testing.assert_allclose(moved, expected, atol=1e-6)


def test_quaternions_need_not_be_normalised() -> None:
    half = slerp(np.array(STILL) * 7, np.array(QUARTER) * 0.01, 0.5)
    np.testing.assert_allclose(half, [0, 0, math.sin(math.pi / 8), math.cos(math.pi / 8)], atol=1e-12)
    assert slerp(np.zeros(4), np.zeros(4), 0.5).tolist() == STILL


def test_an_animation_of_one_key_frame_stands_still(tmp_path: Path) -> None:
    rest = load(animated("translation", [0.5], [[1.0, 2.0, 3.0]]).write(tmp_path / "a.glb"))
    assert rest.animations == {"Walk": 0.5}
    for time in (0.0, 0.5, 2.0):
        np.testing.assert_allclose(corners(rest.at(time)), corners(rest) + np.array([1, 2, 3]), atol=1e-9)


def test_what_stands_still_is_shared(tmp_path: Path) -> None:
    rest = load(animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]]).write(tmp_path / "a.glb"))
    later = rest.at(0.5)
    assert later.meshes[1] is rest.meshes[1] and later.meshes[0] is not rest.meshes[0]
    assert later.materials is rest.materials
    assert later.at(0.5).meshes[0] is later.meshes[0]
    assert later.at(None).meshes[0].vertices.tolist() == rest.meshes[0].vertices.tolist()
    # The geometry is the one that would be built anew, and knows the order of its triangles.
    built = concatenate(later.meshes)
    assert "geometry" in later.__dict__
    for name in ("vertices", "normals", "faces"):
        torch.testing.assert_close(getattr(later.geometry, name), getattr(built, name))
    assert later.geometry.order is rest.geometry.order
    assert later.geometry.bounds.tolist() == built.bounds.tolist()


def skinned(weights: Any, joints: Any, **more: Any) -> Glb:
    """A triangle on two joints: the first stands, the second is moved by its node."""
    glb = Glb(
        nodes=[{"mesh": 0, "skin": 0, "translation": [100, 0, 0]}, {}, {"translation": [0, 5, 0], **more}],
        scenes=[{"nodes": [0, 1, 2]}],
    )
    glb.mesh(JOINTS_0=glb.accessor(joints, "uint8"), WEIGHTS_0=glb.accessor(weights))
    glb.json["skins"] = [{"joints": [1, 2]}]
    return glb


def test_skins_ignore_the_place_of_their_node(tmp_path: Path) -> None:
    """Each vertex is moved by the weighted mean of its joints."""
    weights = [[1.0, 0, 0, 0], [0.5, 0.5, 0, 0], [0, 3.0, 0, 0]]  # the last one is no mean yet
    scene = load(skinned(weights, [[0, 1, 0, 0]] * 3).write(tmp_path / "a.glb"))
    found = sorted(map(tuple, scene.meshes[0].vertices.tolist()))
    assert found == sorted([(0.0, 0.0, 0.0), (1.0, 2.5, 0.0), (0.0, 6.0, 0.0)])


def test_vertices_without_weights_hang_on_their_first_joint(tmp_path: Path) -> None:
    glb = skinned([[0.0] * 4] * 3, [[1, 0, 0, 0]] * 3)
    with pytest.warns(RepairedWarning, match=r"vertices without weights: they follow their first joint \(3\)"):
        scene = load(glb.write(tmp_path / "a.glb"))
    assert scene.meshes[0].vertices[:, 1].min() == 5.0


def test_inverse_bind_matrices_lead_into_the_joint(tmp_path: Path) -> None:
    """Bound where it stands, a joint moves nothing; turned by a quarter, it turns the mesh about itself."""
    glb = skinned([[1.0, 0, 0, 0]] * 3, [[1, 0, 0, 0]] * 3, rotation=QUARTER)
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, :3, 3] = [0, -5, 0]
    glb.json["accessors"].append(
        {
            "bufferView": glb.view(bind.transpose(0, 2, 1).astype(np.float32).tobytes()),
            "componentType": 5126, "count": 2, "type": "MAT4",
        }
    )  # fmt: skip
    glb.json["skins"][0]["inverseBindMatrices"] = len(glb.json["accessors"]) - 1
    found = np.array(sorted(load(glb.write(tmp_path / "a.glb")).meshes[0].vertices.tolist()))
    np.testing.assert_allclose(found, sorted([[5, 5, 0], [5, 6, 0], [4, 5, 0]]), atol=1e-6)


def morphing(node: dict[str, Any], **more: Any) -> Glb:
    glb = Glb(nodes=[{"mesh": 0, **node}])
    glb.mesh(**more)
    glb.json["meshes"][0]["primitives"][0]["targets"] = [
        {"POSITION": glb.accessor([[0.0, 0, 2], [0.0, 0, 2], [0.0, 0, 2]])},
        {"POSITION": glb.accessor([[4.0, 0, 0], [0.0, 0, 0], [0.0, 0, 0]])},
    ]
    glb.json["meshes"][0]["weights"] = [0.5, 0.0]
    return glb


def test_morph_targets(tmp_path: Path) -> None:
    """Weights of the node count before those of the mesh; an animation counts before both."""
    scene = load(morphing({}).write(tmp_path / "a.glb"))
    assert scene.meshes[0].vertices[:, 2].tolist() == [1.0] * 3
    glb = morphing({"weights": [0.0, 1.0]})
    samplers = [{"input": glb.accessor([0.0, 1.0]), "output": glb.accessor([0.0, 0.0, 1.0, 0.0])}]
    target = {"node": 0, "path": "weights"}
    glb.json["animations"] = [{"channels": [{"sampler": 0, "target": target}], "samplers": samplers}]
    scene = load(glb.write(tmp_path / "a.glb"))
    assert scene.meshes[0].vertices[:, 2].tolist() == [0.0] * 3 and scene.bounds[1, 0] == 4.0
    assert scene.at(0.25).meshes[0].vertices[:, 2].tolist() == [0.5] * 3


def test_morph_targets_without_positions(tmp_path: Path) -> None:
    normal = [[0.0, 0, 1]] * 3
    glb = Glb(nodes=[{"mesh": 0, "weights": [1.0]}])
    glb.mesh(NORMAL=glb.accessor(normal))
    glb.json["meshes"][0]["primitives"][0]["targets"] = [{"NORMAL": glb.accessor([[1.0, 0, 0]] * 3)}]
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert mesh.normals is not None
    torch.testing.assert_close(mesh.normals[0], torch.tensor([1.0, 0.0, 1.0]) / math.sqrt(2))


def test_derived_normals_follow_morph_targets(tmp_path: Path) -> None:
    """A file without normals: they are those of the bent surface, not of the one at rest."""
    glb = Glb(nodes=[{"mesh": 0, "weights": [1.0]}])
    glb.mesh()
    glb.json["meshes"][0]["primitives"][0]["targets"] = [
        {"POSITION": glb.accessor([[0.0, 0, 0], [0.0, 0, 0], [0.0, -1, 1]])}
    ]
    mesh = load(glb.write(tmp_path / "a.glb")).meshes[0]
    assert mesh.normals is not None
    torch.testing.assert_close(mesh.normals, torch.tensor([[0.0, -1.0, 0.0]]).expand(3, 3), atol=1e-6, rtol=0)


def test_instances(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0, "translation": [0, 0, 7]}])
    glb.mesh()
    attributes = {
        "TRANSLATION": glb.accessor([[0.0, 0, 0], [2.0, 0, 0], [4.0, 0, 0]]),
        "SCALE": glb.accessor([[1.0, 1, 1], [1.0, 1, 1], [-1.0, 1, 1]]),
    }
    glb.json["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    scene = load(glb.write(tmp_path / "a.glb"))
    assert scene.geometry.triangle_count == 3
    assert scene.bounds.tolist() == [[0.0, 0.0, 7.0], [4.0, 1.0, 7.0]]
    # The mirrored one is turned over, so that all face the same way.
    assert scene.geometry.face_normals.tolist() == [[0.0, 0.0, 1.0]] * 3


def test_many_instances_are_refused_before_they_are_made(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}])
    glb.mesh(faces=np.tile([0, 1, 2], 20_000))
    glb.json["nodes"][0]["extensions"] = {
        "EXT_mesh_gpu_instancing": {"attributes": {"SCALE": glb.accessor(np.ones((3000, 3)))}}
    }
    with pytest.raises(SceneFileError, match="declares 60000000 triangles"):
        load(glb.write(tmp_path / "a.glb"))


def test_lights_and_cameras_move_with_their_nodes(tmp_path: Path) -> None:
    glb = animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]])
    glb.json["nodes"][0] |= {"camera": 0, "name": "eye", "extensions": {"KHR_lights_punctual": {"light": 0}}}
    glb.json["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    glb.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 3.0}]}}
    rest = load(glb.write(tmp_path / "a.glb"))
    later = rest.at(0.5)
    assert later.lights[0].position.tolist() == [2.0, 0.0, 0.0]  # type: ignore[union-attr]
    assert later.cameras["eye"].world_from_camera[0, :3, 3].tolist() == [2.0, 0.0, 0.0]
    assert rest.photometric and not tr.Scene().photometric


def test_scene_files_place_moving_files(tmp_path: Path) -> None:
    """What a scene file puts elsewhere moves there, beside what others brought."""
    animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]]).write(tmp_path / "a.glb")
    text = "".join(f"[[geometry]]\nfile = 'a.glb'\ntranslate = [0, 0, {z}]\nscale = 2\n" for z in (0, 10))
    (tmp_path / "s.toml").write_text(text)
    scene = load(tmp_path / "s.toml")
    later = scene.at(0.5)
    for mesh, moved in ((0, 4.0), (1, 0.0), (2, 4.0), (3, 0.0)):
        np.testing.assert_allclose(corners(later, mesh), corners(scene, mesh) + np.array([moved, 0, 0]), atol=1e-9)
    (tmp_path / "t.toml").write_text("[[geometry]]\nfile = 'a.glb'\ntime = 0.5\nanimation = 'Walk'\n")
    np.testing.assert_allclose(corners(load(tmp_path / "t.toml")), corners(scene) / 2 + np.array([2, 0, 0]), atol=1e-9)


def test_scenes_of_a_file(tmp_path: Path) -> None:
    glb = Glb(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [9, 0, 0]}])
    glb.mesh()
    glb.json["scenes"], glb.json["scene"] = [{"nodes": [0], "name": "near"}, {"nodes": [1], "name": "far"}], 0
    path = glb.write(tmp_path / "a.glb")
    assert load(path, subscene="far").bounds[0, 0] == load(path, subscene=1).bounds[0, 0] == 9.0
    with pytest.warns(NotUsedWarning, match="other scenes of the file: far"):
        assert load(path).bounds[0, 0] == 0.0
    with pytest.raises(InputError, match="no scene 'moon'; known: near, far"):
        load(path, subscene="moon")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"interpolation": "WAVE"}, "unknown interpolation 'WAVE'"),
        ({"input": 99}, r"accessors\[99\]: there is no such entry"),
        ({"output": 0}, r"samplers\[0\]\.output: must be 6 finite numbers, there are 9|must be 6 finite"),
    ],
)
def test_bad_animations(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    glb = animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]])
    glb.json["animations"][0]["samplers"][0] |= change
    with pytest.raises(SceneFileError, match=message):
        load(glb.write(tmp_path / "a.glb"))


def test_times_that_fall_are_refused(tmp_path: Path) -> None:
    glb = animated("translation", [1.0, 0.0], [[0.0, 0, 0], [4.0, 0, 0]])
    with pytest.raises(SceneFileError, match="must be finite times that do not fall"):
        load(glb.write(tmp_path / "a.glb"))


def test_bad_skins(tmp_path: Path) -> None:
    glb = skinned([[1.0, 0, 0, 0]] * 3, [[9, 0, 0, 0]] * 3)
    with pytest.raises(SceneFileError, match="joints must be below 2"):
        load(glb.write(tmp_path / "a.glb"))
    glb.json["skins"] = [{"joints": [1, 77]}]
    with pytest.raises(SceneFileError, match=r"nodes\[77\]: there is no such entry"):
        load(glb.write(tmp_path / "a.glb"))


def test_unknown_animations_and_files_that_have_none(tmp_path: Path) -> None:
    path = animated("translation", [0.0, 1.0], [[0.0, 0, 0], [4.0, 0, 0]]).write(tmp_path / "a.glb")
    with pytest.raises(InputError, match="no animation 'Fly'; known: 'Walk'"):
        load(path, animation="Fly")
    with pytest.raises(InputError, match="no animation 'Fly'; known: 'Walk'"):
        load(path).at(0.0, "Fly")
    with pytest.raises(InputError, match="finite number"):
        load(path).at(math.nan)
    with pytest.raises(InputError, match="cornell_box has no animation"):
        load("cornell_box", time=1.0)
    still = tr.Scene()
    assert still.at(3.0).meshes == ()


def test_rays_follow_a_figure_that_walks(data_dir: Path) -> None:
    """The faces stay the same tensor, so that the ray tree follows, and it hits what a new one hits."""
    scene = load(data_dir / "characters" / "CesiumMan.glb")
    moved = scene.at(0.6)
    caster = RayCaster(scene.geometry).following(moved.geometry)
    assert caster is not None and moved.geometry.faces is scene.geometry.faces
    origins, directions = (r.reshape(-1, 3) for r in framing_camera(moved.bounds[None], width=40, height=40).rays())
    first, second = (c.first_hit(origins, directions) for c in (caster, RayCaster(moved.geometry)))
    assert torch.equal(first.triangle, second.triangle) and bool((first.triangle >= 0).any())
    assert not torch.equal(first.triangle, RayCaster(scene.geometry).first_hit(origins, directions).triangle)


def test_deep_trees_and_many_nodes(tmp_path: Path) -> None:
    count = 100_000
    glb = Glb(nodes=[{"children": [k + 1], "translation": [0.001, 0, 0]} for k in range(count)] + [{"mesh": 0}])
    glb.mesh()
    assert load(glb.write(tmp_path / "a.glb")).bounds[0, 0] == pytest.approx(count * 0.001)


def test_a_walking_figure(data_dir: Path) -> None:
    """Feet stay above the floor, the figure keeps its size, and standing still costs nothing."""
    scene = load(data_dir / "characters" / "CesiumMan.glb")
    heights = [float(scene.at(t).bounds[1, 1]) for t in np.linspace(0.0, 2.0, 5)]
    assert max(heights) - min(heights) < 0.1 and min(heights) > 1.4
    assert float(scene.at(0.7).bounds[0, 1]) > -0.05
    spread = [float(scene.at(t).bounds[1, 2] - scene.at(t).bounds[0, 2]) for t in (0.0, 0.5)]
    assert max(spread) < 1.3
