"""Every way in gives the same picture, every way out leads back, and what is no camera is refused by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import CameraError, ViewWarning
from torchrender.raster import rasterize_depth
from torchrender.scene.camera import Cameras
from torchrender.scene.cameras.doors import rotation_of
from torchrender.scene.load import load

WIDTH, HEIGHT = 64, 48
EYE, TARGET = [2.0, 1.6, 2.4], [-1.0, 1.0, -1.0]


@pytest.fixture(scope="module")
def camera() -> Cameras:
    return Cameras.look_at(EYE, TARGET, width=WIDTH, height=HEIGHT, fov_deg=60.0)


def quaternion_of(turn: np.ndarray) -> list[float]:
    """Of a rotation without half turns: w first."""
    w = math.sqrt(1 + np.trace(turn)) / 2
    return [w, *(np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (4 * w))]


def doors(camera: Cameras) -> dict[str, Cameras]:
    """The same camera through every door."""
    k, turn, offset = (one[0].numpy() for one in camera.opencv())
    size = {"width": WIDTH, "height": HEIGHT}
    whole = np.eye(4)
    whole[:3, :3], whole[:3, 3] = turn, offset
    shifted = k.copy()
    shifted[:2, 2] -= 0.5
    # OpenGL by hand: the axes of the camera in the world are right, up and backward.
    c2w = np.eye(4)
    c2w[:3, 0], c2w[:3, 1], c2w[:3, 2], c2w[:3, 3] = turn[0], -turn[1], -turn[2], EYE
    fov_x = math.degrees(2 * math.atan(WIDTH / 2 / k[0, 0]))
    scaled = c2w.copy()
    scaled[:3, :3] *= 3.0
    return {
        "opencv": Cameras.from_opencv(k, turn, offset, **size),
        "opencv column": Cameras.from_opencv(k.tolist(), turn.tolist(), offset[:, None], **size),
        "opencv 4x4": Cameras.from_opencv(k, whole, **size),
        "opencv 3x4": Cameras.from_opencv(k, whole[:3], **size),
        "opencv centres at 0": Cameras.from_opencv(shifted, turn, offset, pixel_center=0, **size),
        "opengl": Cameras.from_opengl(c2w, fov_deg=60.0, **size),
        "opengl 3x4": Cameras.from_opengl(c2w[:3], fov_x_deg=fov_x, **size),
        "opengl K": Cameras.from_opengl(c2w, K=k, **size),
        "gltf": Cameras.from_gltf(scaled, yfov=math.radians(60.0), **size),
        "colmap": Cameras.from_colmap(
            quaternion_of(turn), offset, model="PINHOLE", params=[k[0, 0], k[1, 1], k[0, 2], k[1, 2]], **size
        ),
        "colmap radial": Cameras.from_colmap(
            quaternion_of(turn), offset, model="SIMPLE_RADIAL", params=[k[0, 0], k[0, 2], k[1, 2], 0.0], **size
        ),
    }


def test_every_door_gives_the_same_camera_and_picture(camera) -> None:
    scene = load("cornell_box")
    wanted = rasterize_depth(scene, camera)
    assert bool(torch.isfinite(wanted).any())
    for name, one in doors(camera).items():
        torch.testing.assert_close(one.camera_from_world, camera.camera_from_world, atol=1e-12, rtol=0, msg=name)
        torch.testing.assert_close(one.intrinsics, camera.intrinsics, atol=1e-9, rtol=0, msg=name)
        torch.testing.assert_close(rasterize_depth(scene, one), wanted, atol=1e-5, rtol=0, msg=name)


def test_points_fall_where_opencv_says(camera) -> None:
    import cv2

    points = np.array([[-0.5, 1.0, -0.3], [0.2, 0.4, 0.1], [-1.0, 1.5, -2.0]])
    k, turn, offset = (one[0].numpy() for one in camera.opencv())
    wanted, _ = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], offset, k, None)
    found, _ = camera.project(torch.from_numpy(points))
    np.testing.assert_allclose(found[0].numpy(), wanted[:, 0], atol=1e-9)


@given(seed=st.integers(0, 2**31), centre=st.sampled_from([0, 0.5]))
@settings(max_examples=25, deadline=None)
def test_ways_out_lead_back(seed: int, centre: float) -> None:
    random = torch.Generator().manual_seed(seed)
    count = 3
    turn = rotation_of(torch.randn(count, 4, generator=random, dtype=torch.float64))
    offset = torch.randn(count, 3, generator=random, dtype=torch.float64) * 100
    k = torch.eye(3, dtype=torch.float64).repeat(count, 1, 1)
    k[:, 0, 0], k[:, 1, 1] = 50 + 100 * torch.rand(2, count, generator=random, dtype=torch.float64)
    k[:, :2, 2] = 60 * torch.rand(count, 2, generator=random, dtype=torch.float64)
    k[:, 0, 1] = 0.3
    made = Cameras.from_opencv(k, turn, offset, width=80, height=60, pixel_center=centre)
    for one, other in zip(made.opencv(pixel_center=centre), (k, turn, offset), strict=True):
        torch.testing.assert_close(one, other, atol=1e-9, rtol=0)
    c2w, lens = made.opengl()
    back = Cameras.from_opengl(c2w, K=lens, width=80, height=60)
    torch.testing.assert_close(back.camera_from_world, made.camera_from_world, atol=1e-9, rtol=0)


def test_a_batch_shares_one_lens() -> None:
    k = [[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]
    poses = torch.eye(4).repeat(5, 1, 1)
    made = Cameras.from_opencv(k, poses, width=64, height=48)
    assert len(made) == 5
    assert made.near.tolist() == [0.01] * 5
    assert made.far.isinf().all()


def test_near_and_far_have_defaults() -> None:
    made = Cameras(torch.eye(4)[None], torch.tensor([[[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]]), 64, 48)
    assert made.near.tolist() == [0.01]
    assert made.far.tolist() == [math.inf]


K = [[50.0, 0, 32], [0, 50, 24], [0, 0, 1]]
MIRROR, LARGE, SHEAR = np.diag([1.0, 1, -1]), 2.5 * np.eye(3), np.eye(3) + 0.2 * np.eye(3, k=1)
SIZE = {"width": 64, "height": 48}


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Cameras.from_opencv(K, MIRROR, [0, 0, 0], **SIZE), r"R mirrors"),
        (lambda: Cameras.from_opencv(K, LARGE, [0, 0, 0], **SIZE), r"R scales by 2\.5"),
        (lambda: Cameras.from_opencv(K, SHEAR, [0, 0, 0], **SIZE), r"R is no rotation"),
        (lambda: Cameras.from_opencv(K, np.stack([np.eye(3), MIRROR]), [0, 0, 0], **SIZE), r"R\[1\] mirrors"),
        (lambda: Cameras.from_opencv(K, np.eye(2), [0, 0, 0], **SIZE), r"R must have shape \(3, 3\)"),
        (lambda: Cameras.from_opencv(np.eye(4), np.eye(3), [0, 0, 0], **SIZE), r"K must have shape \(3, 3\)"),
        (lambda: Cameras.from_opencv(K, np.eye(4).T + np.eye(4, k=-3), **SIZE), r"R must have the last row"),
        (lambda: Cameras.from_opencv(K, np.eye(3), [0, 0], **SIZE), r"t must have shape \(3\)"),
        (lambda: Cameras.from_opencv(K, np.eye(3), [0, math.nan, 0], **SIZE), r"t must be finite"),
        (
            lambda: Cameras.from_opencv(K, np.eye(3), [0, 0, 0], pixel_center=1, **SIZE),
            r"pixel_center must be 0 or 0\.5",
        ),
        (lambda: Cameras.from_opencv([K] * 2, [np.eye(4)] * 3, **SIZE), r"as many K as poses"),
        (lambda: Cameras.from_opengl(np.eye(4), **SIZE), r"give one of fov_deg, fov_x_deg and K"),
        (lambda: Cameras.from_opengl(np.eye(4), fov_deg=200.0, **SIZE), r"fov_deg must be in"),
        (lambda: Cameras.from_opengl(np.diag([1.0, 1, -1, 1]), fov_deg=50.0, **SIZE), r"c2w mirrors"),
        (
            lambda: Cameras.from_colmap([0, 0, 0, 0], [0, 0, 0], model="SIMPLE_PINHOLE", params=[50, 32, 24], **SIZE),
            "qvec",
        ),
        (
            lambda: Cameras.from_colmap([1, 0, 0, 0], [0, 0, 0], model="FISHEYE", params=[1], **SIZE),
            "model must be one of",
        ),
        (
            lambda: Cameras.from_colmap([1, 0, 0, 0], [0, 0, 0], model="RADIAL", params=[50, 32, 24, 0.1, 0], **SIZE),
            "undistort",
        ),
    ],
)
def test_what_is_no_camera_is_refused_by_name(make, told: str) -> None:
    with pytest.raises(CameraError, match=told):
        make()


def test_rounded_matrices_of_files_are_made_exact() -> None:
    turn = rotation_of(torch.tensor([[0.3, 0.5, -0.2, 0.8]], dtype=torch.float64))
    made = Cameras.from_opencv(K, (turn * 1e5).round() / 1e5, [1, 2, 3], **SIZE)
    product = made.rotation[0] @ made.rotation[0].T
    torch.testing.assert_close(product, torch.eye(3, dtype=torch.float64), atol=1e-12, rtol=0)
    torch.testing.assert_close(made.rotation, turn, atol=1e-4, rtol=0)


def test_orthographic_cameras_have_no_pinhole() -> None:
    box = Cameras(torch.eye(4)[None], torch.tensor([K]), 64, 48, torch.tensor(0.0), torch.tensor(1.0), True)
    with pytest.raises(CameraError, match="perspective"):
        box.opencv()


@pytest.mark.parametrize(("row", "column"), [(1, 0), (2, 0), (2, 1), (2, 2)])
def test_matrices_that_are_no_intrinsics_are_refused(row: int, column: int) -> None:
    k = np.array([[30.0, 0.5, 16], [0, 30, 12], [0, 0, 1]])
    Cameras.from_opencv(k, np.eye(3), [0, 0, 2], width=32, height=24)
    k[row, column] += 4
    with pytest.raises(CameraError, match="transposed"):
        Cameras.from_opencv(k, np.eye(3), [0, 0, 2], width=32, height=24)


def test_angles_in_radians_and_foreign_intrinsics_are_doubted() -> None:
    with pytest.warns(ViewWarning, match="fov_deg is 0.87 degrees, the view of a telescope: if it is in radians"):
        Cameras.look_at([0, 0, 3], [0, 0, 0], width=8, height=6, fov_deg=0.87)
    with pytest.warns(ViewWarning, match="fov_x_deg is 1.2 degrees"):
        Cameras.from_opengl(torch.eye(4), fov_x_deg=1.2, width=8, height=6)
    K = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]
    told = r"K has its principal point at \(320, 240\), far from the middle of 320 x 240 pixels: if K is of pictures of"
    with pytest.warns(ViewWarning, match=told):
        Cameras.from_opencv(K, torch.eye(3), [0, 0, 3], width=320, height=240)
    Cameras.from_opencv(K, torch.eye(3), [0, 0, 3], width=640, height=480)
    Cameras.look_at([0, 0, 3], [0, 0, 0], width=8, height=6, fov_deg=4.0)
