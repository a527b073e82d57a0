"""Camera paths: through their poses, at constant speed, clear of the furniture."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import torch

from torchrender.errors import InputError, SceneFileError
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.path import CameraPath, built_in_path, load_path, walks_of
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build


def path(closed: bool = False) -> CameraPath:
    eyes = torch.tensor([[0.0, 1.0, 0.0], [1.0, 1.0, 0.2], [2.0, 1.5, 1.0], [2.0, 1.0, 3.0]])
    return CameraPath(
        eyes=eyes, targets=eyes + torch.tensor([0.0, 0.0, -1.0]), fov_deg=torch.full((4,), 50.0), closed=closed
    )


def test_a_path_goes_from_the_first_pose_to_the_last_at_constant_speed() -> None:
    cameras = path().cameras(200, width=32, height=24, near=0.1)
    eye = cameras.eye
    assert len(cameras) == 200 and (cameras.width, cameras.height) == (32, 24)
    assert torch.allclose(eye[0], path().eyes[0]) and torch.allclose(eye[-1], path().eyes[-1])
    steps = eye.diff(dim=0).norm(dim=1)
    assert float(steps.max() / steps.min()) < 1.02
    assert float(steps.sum()) == pytest.approx(path().length, rel=1e-3)
    for pose in path().eyes:
        assert float((eye - pose).norm(dim=1).min()) < float(steps.max())


def test_a_closed_path_comes_back_without_a_corner() -> None:
    eye = path(closed=True).cameras(240, width=8, height=8, near=0.1).eye
    steps = torch.cat([eye, eye[:1]]).diff(dim=0)
    assert float(steps.norm(dim=1).max() / steps.norm(dim=1).min()) < 1.05
    unit = torch.nn.functional.normalize(torch.cat([steps, steps[:1]]), dim=1)
    assert float((unit[1:] * unit[:-1]).sum(1).min()) > 0.85


def test_an_eye_that_rests_turns_evenly() -> None:
    targets = torch.tensor([[0.0, 0.0, -5.0], [1.0, 0.0, -5.0], [2.0, 0.0, -5.0]])
    resting = CameraPath(eyes=torch.zeros(3, 3), targets=targets, fov_deg=torch.full((3,), 50.0))
    cameras = resting.cameras(5, width=8, height=8, near=0.1)
    assert not bool(cameras.eye.any())
    assert torch.allclose(cameras.forward[2], torch.nn.functional.normalize(targets[1].double(), dim=0), atol=1e-9)
    assert len(resting.cameras(1, width=8, height=8, near=0.1)) == 1


@pytest.mark.parametrize(("name", "walk"), [(n, w) for n in ("living_room", "washroom") for w in ("walk1", "walk2")])
@pytest.mark.parametrize("seed", [0, 3])
def test_walks_do_not_touch_anything(name: str, walk: str, seed: int) -> None:
    scene = build(name, triangles=12000)
    eye = built_in_path(scene, walk, seed).cameras(60, width=8, height=8, near=0.01).eye
    steps = eye.diff(dim=0)
    caster = RayCaster(scene.geometry)
    assert not bool(caster.occluded(eye[:-1], steps, t_max=1.0).any())
    around = torch.nn.functional.normalize(torch.randn(64, 3, generator=torch.Generator().manual_seed(0)), dim=1)
    origins, directions = eye[:, None].expand(-1, 64, 3), around.double().expand(60, 64, 3)
    assert float(caster.first_hit(origins, directions).t.min()) > 0.12
    low, high = scene.bounds
    assert bool(((eye > low) & (eye < high)).all())


def test_seeds_repeat() -> None:
    scene = build("washroom", triangles=8000)
    first, again, other = (built_in_path(scene, "walk1", seed).eyes for seed in (1, 1, 2))
    assert torch.equal(first, again) and not torch.equal(first, other)
    assert walks_of(scene) == ("walk1", "walk2") and walks_of(Scene()) == ()


def test_every_scene_has_an_orbit() -> None:
    for scene in (build("cornell_box"), Scene()):
        cameras = built_in_path(scene, "orbit").cameras(7, width=16, height=16, near=0.1)
        start = scene.camera(width=16, height=16)
        assert torch.allclose(cameras.eye[3], start.eye[0], atol=1e-6)
        assert torch.allclose(cameras.forward[3], start.forward[0], atol=1e-6)
    with pytest.raises(InputError, match="orbit"):
        built_in_path(build("cornell_box"), "walk1")


def test_path_files(tmp_path) -> None:
    poses = [{"eye": [0, 1, 0], "target": [0, 1, -1]}, {"eye": [1, 1, 0], "target": [1, 1, -1], "fov": 40.0}]
    (tmp_path / "a.json").write_text(json.dumps({"pose": poses, "ends": "closed"}))
    (tmp_path / "a.toml").write_text(
        'ends = "closed"\n[[pose]]\neye = [0, 1, 0]\ntarget = [0, 1, -1]\n'
        "[[pose]]\neye = [1, 1, 0]\ntarget = [1, 1, -1]\nfov = 40\n"
    )
    first, second = load_path(tmp_path / "a.json"), load_path(tmp_path / "a.toml")
    assert first.closed and second.closed and first.fov_deg.tolist() == [60.0, 40.0]
    assert torch.equal(first.eyes, second.eyes) and torch.equal(first.targets, second.targets)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[[pose]]\neye = [0, 0, 0]\ntarget = [0, 0, 1]\n", "2 poses"),
        ("", "empty"),
        ("[[pose]]\neye = [0, 0]\ntarget = [0, 0, 1]\n", "3 numbers"),
        ("[[pose]]\ntarget = [0, 0, 1]\n", "missing"),
        ("[[pose]]\neye = [0, 0, 0]\ntarget = [0, 0, 1]\nfow = 3\n", "fov"),
        ('ends = "round"\n', "open"),
        ("[[pose]]\neye = [0, 0, 0]\ntarget = [0, 0, 0]\n" * 2, "differs"),
        ("not toml", "TOML"),
    ],
)
def test_bad_path_files_are_named(tmp_path, text: str, reason: str) -> None:
    (tmp_path / "p.toml").write_text(text)
    with pytest.raises(SceneFileError, match=reason):
        load_path(tmp_path / "p.toml")
    (tmp_path / "p.json").write_text("[1")
    with pytest.raises(SceneFileError, match="JSON"):
        load_path(tmp_path / "p.json")
    with pytest.raises(SceneFileError):
        load_path(tmp_path / "none.toml")


def test_bad_paths_are_named() -> None:
    with pytest.raises(InputError, match="2 poses"):
        CameraPath(eyes=torch.zeros(1, 3), targets=torch.ones(1, 3), fov_deg=torch.ones(1))
    with pytest.raises(InputError, match="targets"):
        CameraPath(eyes=torch.zeros(2, 3), targets=torch.ones(3, 3), fov_deg=torch.ones(2))
    with pytest.raises(InputError, match="finite"):
        CameraPath(eyes=torch.full((2, 3), torch.nan), targets=torch.ones(2, 3), fov_deg=torch.ones(2))
    with pytest.raises(InputError, match="frames"):
        path().cameras(0, width=8, height=8, near=0.1)


@pytest.mark.parametrize("view_height", [3.0, 300.0])
def test_an_orbit_of_an_orthographic_camera_stays_orthographic(view_height: float) -> None:
    """It sees as much, at any size, between the same limits: pixels per unit are no focal length."""
    size = view_height / 3
    first = Cameras.orthographic_view(
        [3 * size, 2 * size, 4 * size], [0.0, 0.0, 0.0], width=64, height=48, view_height=view_height,
        near=-size, far=90 * size,
    )  # fmt: skip
    scene = Scene(meshes=[Mesh.box(size)], cameras={"plan": first})
    path = built_in_path(scene, "orbit")
    made = path.cameras(5, width=80, height=40, near=0.01)
    assert made.orthographic and (made.width, made.height) == (80, 40)
    torch.testing.assert_close(made.intrinsics[:, 1, 1], torch.full((5,), 40 / view_height, dtype=torch.float64))
    assert made.near.tolist() == [-size] * 5 and made.far.tolist() == [90 * size] * 5
    torch.testing.assert_close(made.eye[2], first.eye[0])
    torch.testing.assert_close(made.forward[2], first.forward[0])
    assert bool((made.eye[0] - made.eye[-1]).norm() > 0.5 * size)
    with pytest.raises(InputError, match="one orthographic camera"):
        replace(path, orthographic=Cameras.look_at([0, 0, 1], [0, 0, 0], width=8, height=8))
