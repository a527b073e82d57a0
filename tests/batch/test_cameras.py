"""Cameras of files, grids, and rows of data pipelines."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from torchrender.batch import Renderer
from torchrender.batch.cameras import grid_cameras, read_cameras
from torchrender.errors import InputError, OptionError, SceneFileError
from torchrender.pipeline.options import RenderOptions, shadow_choices
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load

ROW = {"eye": [1.0, 2.0, 3.0], "target": [0.0, 0.5, 0.0], "fov": 40.0, "name": "first"}


def write(path: Path, content: object) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_rows_are_the_cameras_they_describe(tmp_path: Path) -> None:
    looking = Cameras.look_at([1.0, 2.0, 3.0], [0.0, 0.5, 0.0], width=40, height=30, fov_deg=40.0)
    pose = looking.opengl()[0][0].tolist()
    wide = 2 * math.atan(math.tan(math.radians(20.0)) * 40 / 30)
    found = read_cameras(write(tmp_path / "a.json", [ROW]), width=40, height=30)
    frame = {"file_path": "./train/r_7.png", "transform_matrix": pose, "rotation": 1}
    nerf = {"camera_angle_x": wide, "frames": [frame]}
    other = read_cameras(write(tmp_path / "transforms.json", nerf), width=40, height=30)
    lines = "\n".join(json.dumps({"matrix": pose, "fov_deg": 40.0}) for _ in range(2))
    third = read_cameras(write(tmp_path / "c.jsonl", lines), width=40, height=30)
    for one in (found, other, third):
        torch.testing.assert_close(one.cameras[0].camera_from_world, looking.camera_from_world)
        torch.testing.assert_close(one.cameras[0].intrinsics, looking.intrinsics)
    assert (found.names, other.names, third.names) == (("first",), ("r_7",), ("000000", "000001"))
    assert other.not_used == ("rotation",) and not other.bad


POSE = torch.eye(4).tolist()
TOP = {"fl_x": 900.0, "fl_y": 880.0, "cx": 330.0, "cy": 200.0, "w": 640, "h": 480.0}


@pytest.mark.parametrize(
    ("top", "row", "wanted"),
    [
        (TOP, {}, (900.0, 880.0, 330.0, 200.0)),
        ({}, TOP, (900.0, 880.0, 330.0, 200.0)),
        (TOP, {"fl_x": 500.0, "fl_y": 500.0, "cx": 320}, (500.0, 500.0, 320.0, 200.0)),
        (TOP, {"fl_x": 500.0}, (500.0, 500.0, 330.0, 200.0)),
        (TOP, {"camera_angle_x": math.pi / 2}, (320.0, 320.0, 330.0, 200.0)),
        ({**TOP, "camera_angle_x": 1.0}, {}, (900.0, 880.0, 330.0, 200.0)),
        ({"camera_angle_x": math.pi / 2, "cx": 300, "cy": 250, "w": 640, "h": 480}, {}, (320.0, 320.0, 300.0, 250.0)),
        ({"camera_angle_x": math.pi / 2, "camera_angle_y": math.pi / 2, "w": 640, "h": 480}, {},
         (320.0, 240.0, 320.0, 240.0)),
        ({"camera_angle_y": math.pi / 2}, {}, (240.0, 240.0, 320.0, 240.0)),
        ({"fov_deg": 90.0}, {}, (240.0, 240.0, 320.0, 240.0)),
        ({"fov": 20.0}, {"fov_deg": 90.0}, (240.0, 240.0, 320.0, 240.0)),
        ({}, {}, (240 / math.tan(math.radians(25.0)),) * 2 + (320.0, 240.0)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("by", ["pose", "eye"])
def test_lenses_are_those_of_nerf_programs(
    tmp_path: Path, top: dict[str, float], row: dict[str, float], wanted: tuple[float, ...], by: str
) -> None:
    """Of rows, and of the object around them; the same picture at another size."""
    place = {"transform_matrix": POSE} if by == "pose" else {"eye": [0, 0, 0], "target": [0, 0, -1]}
    file = write(tmp_path / "transforms.json", {**top, "frames": [{**place, **row}]})
    for scale in (1, 2):
        found = read_cameras(file, width=640 * scale, height=480 * scale)
        k = found.cameras.intrinsics[0]
        assert [float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])] == pytest.approx(
            [scale * one for one in wanted]
        )
        assert not found.bad and not found.not_used


def test_what_of_a_nerf_file_is_not_used_is_named_once(tmp_path: Path) -> None:
    frames = [{"transform_matrix": POSE, "sharpness": 3.0, "file_path": f"{n}.png"} for n in range(3)]
    top = {**TOP, "k1": 0.1, "k2": 0.0, "p1": 0, "camera_model": "OPENCV", "aabb_scale": 16, "frames": frames}
    assert read_cameras(write(tmp_path / "a.json", top), width=64, height=48).not_used == (
        "k1", "aabb_scale", "sharpness",
    )  # fmt: skip
    fisheye = {**top, "camera_model": "OPENCV_FISHEYE", "fov": 30.0}
    found = read_cameras(write(tmp_path / "b.json", fisheye), width=64, height=48).not_used
    assert {"camera_model", "fl_x", "fl_y"} < set(found)
    nowhere = {"fl_x": 900.0, "frames": frames}
    with pytest.raises(SceneFileError, match="fl_x needs w and h"):
        read_cameras(write(tmp_path / "c.json", nowhere), width=64, height=48)


def test_bad_rows_are_named_and_left_out(tmp_path: Path) -> None:
    wrong = {
        "eye": {"eye": [1, 2]},
        "fov": {"fov": "wide"},
        "target is missing": {"target": None},
        "twice": {"name": "first"},
        "differ": {"eye": [0.0, 0.5, 0.0]},
        "plain": {"name": "../y"},
        "near": {"near": math.nan},
        "shape": {"matrix": [[1, 0], [0, 1]]},
    }
    rows = [ROW, *({**ROW, "name": f"r{n}", **row} for n, row in enumerate(wrong.values())), 7, {**ROW, "name": "end"}]
    found = read_cameras(write(tmp_path / "a.json", {"cameras": rows}), width=8, height=8)
    assert found.names == ("first", "end") and len(found.bad) == 9
    assert [line.split(":")[0] for line in found.bad] == [f"row {n}" for n in range(1, 10)]
    for line, why in zip(found.bad, (*wrong, "table"), strict=True):
        assert why in line


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "no JSON"), ("[]", "no cameras"), ("{}", "cameras or frames"), ('{"cameras": 3}', "list"), ("[1]", "row 0")],
)
def test_files_without_cameras_are_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(SceneFileError, match=message):
        read_cameras(write(tmp_path / "a.json", text), width=8, height=8)
    with pytest.raises(SceneFileError, match="no such file"):
        read_cameras(tmp_path / "b.json", width=8, height=8)


def test_a_grid_looks_four_ways_from_each_cell() -> None:
    scene = load("cornell_box")
    grid = grid_cameras(scene, (2, 1, 3), width=8, height=8)
    assert len(grid.cameras) == len(set(grid.names)) == 24 and grid.names[0] == "000_000_000_east"
    low, high = scene.bounds
    places = grid.cameras.opengl()[0][:, :3, 3]
    assert bool(((places > low) & (places < high)).all())
    ahead = grid.cameras.camera_from_world[:4, 2, :3]
    turned = torch.tensor([[1.0, 0, -1, 0], [0, 1, 0, -1], [-1, 0, 1, 0], [0, -1, 0, 1]], dtype=torch.float64)
    torch.testing.assert_close(ahead @ ahead.T, turned, atol=1e-9, rtol=0)
    with pytest.raises(InputError, match="at least one cell"):
        grid_cameras(scene, (2, 0, 3), width=8, height=8)
    with pytest.raises(InputError, match=f"a grid of 999x999x999 cells has {4 * 999**3} cameras, a batch at most"):
        grid_cameras(scene, (999, 999, 999), width=8, height=8)


def test_rows_of_a_pipeline_are_rendered() -> None:
    scene = load("cornell_box")
    camera = Cameras.look_at([0.3, 0.25, -0.7], [0.3, 0.25, 0.3], width=16, height=12, fov_deg=45.0)
    rows = {"eye": np.array([[0.3, 0.25, -0.7]]), "target": np.array([[0.3, 0.25, 0.3]]), "fov_deg": np.array([45.0])}
    made = Renderer("cornell_box", 16, 12, shadows="hard")({**rows, "id": np.array([3])})
    wanted = render(scene, camera, options=RenderOptions(**shadow_choices("hard"))).to_srgb()[0]
    assert made["picture"].dtype == np.uint8 and made["picture"].shape == (1, 12, 16, 3) and made["id"].tolist() == [3]
    assert np.abs(made["picture"][0] / 255.0 - wanted.numpy()).max() <= 0.5 / 255 + 1e-6
    pose = {"camera_to_world": camera.opengl()[0].numpy(), "fov_deg": [45.0]}
    depth = Renderer("cornell_box", 16, 12, what="depth", outputs=("depth",))(pose)["depth"]
    assert depth.shape == (1, 12, 16) and np.isfinite(depth).mean() > 0.5
    for wrong, message in (({"eye": rows["eye"]}, "eye and target"), ({**rows, "fov_deg": None}, "fov_deg")):
        wrong = {name: value for name, value in wrong.items() if value is not None}
        with pytest.raises(InputError, match=message):
            Renderer("cornell_box", 16, 12)(wrong)
    with pytest.raises(OptionError, match="unknown 'budget_ms'"):
        Renderer("cornell_box", budget_ms=5)
