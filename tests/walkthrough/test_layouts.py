"""Folders of RGB-D photos in every layout that is read, and what is said where they are wrong."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from torchrender.errors import CameraError, ImageFileError, OptionError, SceneFileError
from torchrender.walkthrough.frames.json_file import write_json_sequence
from torchrender.walkthrough.frames.layouts import load_rgbd
from torchrender.walkthrough.frames.record import CaptureWarning
from walkthrough_scenes import capture

COUNT = 3


@pytest.fixture(scope="module")
def frames():
    return capture(COUNT, 48).frames


def put(path: Path, codes: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if codes.ndim == 3:
        codes = np.ascontiguousarray(codes[..., ::-1])
    assert cv2.imwrite(str(path), codes)


def depth_codes(frame, scale: float) -> np.ndarray:
    return np.rint(frame.depth * scale).astype(np.uint16)


def quaternion(frame) -> str:
    pose = frame.world_from_camera
    return " ".join(f"{v:.12f}" for v in (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()))


def rows(matrix: np.ndarray) -> str:
    return "\n".join(" ".join(f"{v:.12f}" for v in row) for row in matrix) + "\n"


def tum(folder: Path, frames) -> None:
    color, depth, truth = ["# color"], ["# depth"], ["# truth"]
    # Written out of order: times count.
    for n, frame in reversed(list(enumerate(frames))):
        put(folder / f"rgb/{n}.png", frame.color)
        put(folder / f"depth/{n}.png", depth_codes(frame, 5000))
        color.append(f"{n + 0.001:.4f} rgb/{n}.png")
        depth.append(f"{n:.4f} depth/{n}.png")
        truth.append(f"{n - 0.002:.4f} {quaternion(frame)}")
    for name, lines in (("rgb", color), ("depth", depth), ("groundtruth", truth)):
        (folder / f"{name}.txt").write_text("\n".join(lines) + "\n")
    (folder / "intrinsics.txt").write_text(lens(frames[0]))


def lens(frame) -> str:
    k = frame.intrinsics
    return f"{k[0, 0]} {k[1, 1]} {k[0, 2] - 0.5} {k[1, 2] - 0.5}\n"


def seven(folder: Path, frames) -> None:
    for n, frame in enumerate(frames):
        put(folder / f"seq-01/frame-{n:06d}.color.png", frame.color)
        codes = depth_codes(frame, 1000)
        codes[0, 0] = 65535
        put(folder / f"seq-01/frame-{n:06d}.depth.png", codes)
        (folder / f"seq-01/frame-{n:06d}.pose.txt").write_text(rows(frame.world_from_camera))
    (folder / "seq-01/intrinsics.txt").write_text(lens(frames[0]))


def redwood(folder: Path, frames) -> None:
    log = ""
    for n, frame in enumerate(frames):
        put(folder / f"image/{n:06d}-color.png", frame.color)
        put(folder / f"depth/{n:06d}-depth.png", depth_codes(frame, 1000))
        log += f"{n} {n} {n + 1}\n" + rows(frame.world_from_camera)
    (folder / "trajectory.log").write_text(log)
    k = frames[0].intrinsics.copy()
    k[:2, 2] -= 0.5
    (folder / "camera.json").write_text(
        json.dumps({"width": 48, "height": 48, "intrinsic_matrix": k.T.reshape(-1).tolist()})
    )


def plain(folder: Path, frames) -> None:
    for n, frame in enumerate(frames):
        put(folder / f"color/{n}.png", frame.color)
        put(folder / f"depth/{n}.png", depth_codes(frame, 1000))
        (folder / "pose").mkdir(exist_ok=True)
        (folder / f"pose/{n}.txt").write_text(rows(frame.world_from_camera))
    k = frames[0].intrinsics.copy()
    k[:2, 2] -= 0.5
    (folder / "intrinsics.txt").write_text(rows(k))


def pose_file(folder: Path, frames) -> None:
    plain(folder, frames)
    for file in (folder / "pose").iterdir():
        file.unlink()
    (folder / "pose").rmdir()
    (folder / "pose.txt").write_text("\n".join(quaternion(f) for f in frames))


def as_json(folder: Path, frames) -> None:
    entries = []
    for n, frame in enumerate(frames):
        put(folder / f"c{n}.png", frame.color)
        np.save(folder / f"d{n}.npy", frame.depth)
        entries.append({"color": f"c{n}.png", "depth": f"d{n}.npy", "pose": frame.world_from_camera.tolist()})
    k = frames[0].intrinsics
    write_json_sequence(folder / "walkthrough.json", entries, [k[0, 0], k[1, 1], k[0, 2], k[1, 2]])


@pytest.mark.parametrize("write", [tum, seven, redwood, plain, pose_file, as_json])
def test_every_layout_gives_the_same_frames(write, frames, tmp_path):
    write(tmp_path, frames)
    found = load_rgbd(tmp_path)
    assert len(found) == COUNT
    for ours, truth in zip(found.frames, frames, strict=True):
        assert np.allclose(ours.world_from_camera, truth.world_from_camera, atol=1e-6)
        assert np.allclose(ours.intrinsics, truth.intrinsics, atol=1e-6)
        assert np.array_equal(ours.read_color(), truth.color)
        depth = ours.read_depth()
        known = depth > 0
        assert known.mean() > 0.99 and np.abs(depth - truth.depth)[known].max() < 6e-4


def test_what_belongs_to_no_pose_is_said(frames, tmp_path):
    plain(tmp_path, frames)
    (tmp_path / "pose/1.txt").unlink()
    (tmp_path / "depth/2.png").unlink()
    with pytest.warns(CaptureWarning, match="1 pictures have no pose"):
        found = load_rgbd(tmp_path)
    assert [f.name for f in found.frames] == ["0", "2"] and found.frames[1].depth is None


def test_usual_intrinsics_are_said(frames, tmp_path):
    plain(tmp_path, frames)
    (tmp_path / "intrinsics.txt").unlink()
    with pytest.warns(CaptureWarning, match="no intrinsics file"):
        found = load_rgbd(tmp_path)
    assert found.frames[0].intrinsics[0, 2] == 320.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        given = load_rgbd(tmp_path, intrinsics=(50, 51, 23.5, 24.5), depth_scale=2000)
    assert given.frames[0].intrinsics[1, 2] == 25.0 and given.frames[0].depth_scale == 2000


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("pose/0.txt", "1 2 3\n", "line 1: 4 numbers"),
        ("pose/0.txt", "a b c d\n", "not a number"),
        ("pose/0.txt", "1 0 0 0\n0 1 0 0\n", "four rows"),
        ("intrinsics.txt", "1 2\n3 4\n", "3x3"),
        ("intrinsics.txt", "\x00\xff", "number"),
    ],
)
def test_damaged_text_is_named(file, text, message, frames, tmp_path):
    plain(tmp_path, frames)
    (tmp_path / file).write_text(text)
    with pytest.raises(SceneFileError, match=message) as error:
        load_rgbd(tmp_path)
    assert Path(file).name in str(error.value)


def test_damaged_pictures_are_named(frames, tmp_path):
    plain(tmp_path, frames)
    (tmp_path / "color/0.png").write_bytes(b"\x89PNG nothing")
    (tmp_path / "depth/1.png").write_bytes(b"")
    put(tmp_path / "depth/2.png", frames[0].color)
    found = load_rgbd(tmp_path).frames
    with pytest.raises(ImageFileError, match="damaged"):
        found[0].read_color()
    with pytest.raises(ImageFileError, match="damaged"):
        found[1].read_depth()
    with pytest.raises(ImageFileError, match="one channel"):
        found[2].read_depth()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.update(frames=[]), "frames"),
        (lambda t: t.update(extra=1), "extra"),
        (lambda t: t["frames"][0].update(color="../secret.png"), "inside"),
        (lambda t: t["frames"][0].update(color="/etc/passwd"), "inside"),
        (lambda t: t["frames"][0].update(pose=[[1, 2]]), "16 finite"),
        (lambda t: t["frames"][0].update(pose=(2 * np.eye(4)).tolist()), "rigid"),
        (lambda t: t["frames"][0].update(depht="x"), "depht"),
        (lambda t: t.pop("intrinsics"), "4 finite"),
    ],
)
def test_wrong_json_is_named(change, message, frames, tmp_path):
    as_json(tmp_path, frames)
    table = json.loads((tmp_path / "walkthrough.json").read_text())
    change(table)
    (tmp_path / "walkthrough.json").write_text(json.dumps(table))
    with pytest.raises(SceneFileError, match=message):
        load_rgbd(tmp_path / "walkthrough.json")


def test_folders_that_are_none(tmp_path):
    with pytest.raises(SceneFileError, match="no such folder"):
        load_rgbd(tmp_path / "missing")
    with pytest.raises(SceneFileError, match="known layout"):
        load_rgbd(tmp_path)
    (tmp_path / "x.json").write_text("{")
    with pytest.raises(SceneFileError, match="no JSON"):
        load_rgbd(tmp_path / "x.json")


def test_shared_sequences(data_dir):
    found = load_rgbd(data_dir / "rgbd" / "livingroom1")
    assert len(found) == 27 and found.frames[0].read_color().shape == (480, 640, 3)
    with pytest.warns(CaptureWarning, match="no intrinsics"):
        other = load_rgbd(data_dir / "rgbd" / "slambook2")
    assert len(other) == 5 and float(np.median(other.frames[0].read_depth())) > 0.5


def test_a_folder_without_depth_says_so(tmp_path):
    (tmp_path / "color").mkdir()
    (tmp_path / "pose").mkdir()
    with pytest.raises(SceneFileError, match="no folder depth"):
        load_rgbd(tmp_path)
    (tmp_path / "color").rmdir()
    (tmp_path / "pose").rmdir()
    with pytest.raises(SceneFileError, match="known layout"):
        load_rgbd(tmp_path)


def test_cameras_of_nerf_beside_a_layout_are_said_and_not_used(frames, tmp_path):
    nerf = {"fl_x": 50.0, "cx": 24, "frames": [{"file_path": "color/0.png", "transform_matrix": np.eye(4).tolist()}]}
    (tmp_path / "transforms.json").write_text(json.dumps(nerf))
    with pytest.raises(SceneFileError, match="unknown key"):
        load_rgbd(tmp_path)
    plain(tmp_path, frames)
    with pytest.warns(CaptureWarning, match=r"transforms\.json: has cameras but no depth.*not used"):
        found = load_rgbd(tmp_path)
    assert len(found) == COUNT and np.allclose(found.frames[0].intrinsics, frames[0].intrinsics, atol=1e-6)


MATRIX = [[50, 0, 23.5], [0, 51, 24.5], [0, 0, 1]]


@pytest.mark.parametrize("given", [(50, 51, 23.5, 24.5), np.array([50, 51, 23.5, 24.5]), MATRIX, np.array(MATRIX)])
def test_intrinsics_are_four_numbers_or_a_matrix(given, frames, tmp_path):
    """In every layout, and in a JSON file that is named."""
    as_json(tmp_path, frames)
    for place in (tmp_path, tmp_path / "walkthrough.json"):
        found = load_rgbd(place, intrinsics=given, depth_scale=2000).frames[0]
        assert found.intrinsics.tolist() == [[50, 0, 24], [0, 51, 25], [0, 0, 1]] and found.depth_scale == 2000


@pytest.mark.parametrize(
    "given", [(50, 51, 23.5), 5, "wide", [[50, 0.1, 23.5], [0, 51, 24.5], [0, 0, 1]], (0, 51, 23.5, 24.5),
              (50, 51, np.nan, 24.5), np.zeros((2, 2)), [[1, 2], [3]]],
)  # fmt: skip
def test_other_intrinsics_are_refused_by_name(given, frames, tmp_path):
    plain(tmp_path, frames)
    with pytest.raises(CameraError, match=r"^intrinsics must be fx, fy, cx, cy, or \[\[fx"):
        load_rgbd(tmp_path, intrinsics=given)
    for scale in (0, -1, "much", 1e9):
        with pytest.raises(OptionError, match="depth_scale must be"):
            load_rgbd(tmp_path, depth_scale=scale)
