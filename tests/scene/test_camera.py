"""Cameras: laws of projection, batches, windows and frusta."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import CameraError
from torchrender.scene.camera import Cameras, framing_camera
from torchrender.scene.model import resized

finite = st.floats(-5, 5, allow_nan=False)
point = st.tuples(finite, finite, finite)


def some_cameras(orthographic=False):
    cameras = Cameras.look_at(
        torch.tensor([[1.0, 2, 3], [-4, 1, 0.5], [0, 6, 0.1]]), (0.2, 0.1, 0), width=64, height=48, near=0.1, far=20
    )
    k = cameras.intrinsics.clone()
    k[:, 0, 1] = 1.5  # skew
    k[:, 0, 0] *= 1.2
    if orthographic:
        k[:, :2, :2] *= 0.1
    return Cameras(cameras.camera_from_world, k, 64, 48, cameras.near, cameras.far, orthographic=orthographic)


@pytest.mark.parametrize("orthographic", [False, True])
@settings(deadline=None, max_examples=30)
@given(pixel=st.tuples(st.floats(-100, 200), st.floats(-100, 200)), depth=st.floats(0.01, 1e4))
def test_unproject_inverts_project(orthographic, pixel, depth):
    cameras = some_cameras(orthographic)
    pixels = torch.tensor(pixel, dtype=torch.float64).expand(3, 1, 2)
    points = cameras.unproject(pixels, torch.full((3, 1), depth, dtype=torch.float64))
    back, z = cameras.project(points)
    torch.testing.assert_close(back, pixels, atol=1e-6, rtol=1e-9)
    torch.testing.assert_close(z, torch.full_like(z, depth), atol=1e-8, rtol=1e-9)


@pytest.mark.parametrize("orthographic", [False, True])
def test_the_ray_parameter_is_camera_depth(orthographic):
    cameras = some_cameras(orthographic)
    origins, directions = cameras.rays()
    depth = torch.rand(3, 48, 64, dtype=torch.float64) + 0.5
    points = cameras.unproject(cameras.pixel_centres().expand(3, 48, 64, 2), depth)
    torch.testing.assert_close(origins + depth[..., None] * directions, points)


def test_axes_are_right_down_forward():
    camera = Cameras.look_at((0, 0, 5), (0, 0, 0), width=100, height=100)
    right, down, forward = camera.rotation[0]
    torch.testing.assert_close(torch.linalg.cross(right, down), forward)
    pixels, z = camera.project(torch.tensor([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]))
    assert float(pixels[0, 0, 0]) > 50 and float(pixels[0, 1, 1]) < 50 and float(z[0, 2]) == pytest.approx(4.0)
    torch.testing.assert_close(camera.eye[0], torch.tensor([0.0, 0, 5], dtype=torch.float64))


def test_an_orthographic_view_is_as_tall_as_it_says():
    cameras = Cameras.orthographic_view(
        torch.tensor([[0.0, 0, 5], [0, 0, 9]]), (0, 0, 0), width=60, height=40, view_height=2.0
    )
    assert cameras.orthographic and len(cameras) == 2
    pixel, depth = cameras.project(torch.tensor([[0.0, 1.0, 0.0], [1.5, -1.0, 2.0]], dtype=torch.float64))
    wanted = torch.tensor([[30.0, 0.0], [60.0, 40.0]], dtype=torch.float64).expand(2, 2, 2)
    torch.testing.assert_close(pixel, wanted)
    torch.testing.assert_close(depth, torch.tensor([[5.0, 3.0], [9.0, 7.0]], dtype=torch.float64))
    for height in (0.0, -1.0, math.inf, math.nan, "2"):
        with pytest.raises(CameraError, match="view_height must be above 0 and finite"):
            Cameras.orthographic_view((0, 0, 5), (0, 0, 0), width=60, height=40, view_height=height)


def test_the_opening_angle_is_vertical():
    camera = Cameras.look_at((0, 0, 0), (0, 0, -1), width=200, height=100, fov_deg=60)
    edge = torch.tensor([[0.0, math.tan(math.radians(30)), -1.0]], dtype=torch.float64)
    pixels, _ = camera.project(edge)
    torch.testing.assert_close(pixels[0, 0], torch.tensor([100.0, 0.0], dtype=torch.float64), atol=1e-9, rtol=0)


def test_points_behind_have_no_image_but_a_depth():
    camera = Cameras.look_at((0, 0, 5), (0, 0, 0), width=10, height=10)
    pixels, z = camera.project(torch.tensor([[0.0, 0, 6], [0, 0, 5], [0, 0, 0]]))
    assert torch.isnan(pixels[0, :2]).all() and torch.isfinite(pixels[0, 2]).all()
    torch.testing.assert_close(z[0], torch.tensor([-1.0, 0, 5], dtype=torch.float64))


@pytest.mark.parametrize("orthographic", [False, True])
@settings(deadline=None, max_examples=40)
@given(p=point)
def test_frustum_planes_agree_with_projection(orthographic, p):
    cameras = some_cameras(orthographic)
    points = torch.tensor([p], dtype=torch.float64)
    pixels, z = cameras.project(points)
    planes = cameras.frustum_planes()
    distance = (planes[..., :3] * points[0]).sum(-1) + planes[..., 3]
    inside = (pixels >= 0).all(-1)[:, 0] & (pixels[:, 0, 0] <= 64) & (pixels[:, 0, 1] <= 48)
    inside &= (z[:, 0] >= cameras.near) & (z[:, 0] <= cameras.far)
    clear = (distance.abs() > 1e-9).all(-1)
    assert torch.equal((distance >= 0).all(-1)[clear], inside[clear])
    torch.testing.assert_close(planes[..., :3].norm(dim=-1), torch.ones(3, 6, dtype=torch.float64))


def test_windows_and_the_offset_camera():
    camera = some_cameras()[0]
    p = torch.tensor([[0.3, -0.2, 0.4]])
    whole, _ = camera.project(p)
    part, _ = camera.sub_camera(10, 5, 20, 30).project(p)
    torch.testing.assert_close(part, whole - torch.tensor([10.0, 5.0]))
    corners = camera.sub_camera(-0.5, -0.5, 65, 49)
    origins, directions = corners.rays()
    _, direct = camera.rays(torch.tensor([[[7.0, 3.0]]], dtype=torch.float64))
    torch.testing.assert_close(directions[0, 3, 7], direct[0, 0])
    assert (corners.width, corners.height) == (65, 49)
    assert origins.shape == (1, 49, 65, 3)


def test_scaling_and_resizing_keep_the_view():
    camera = some_cameras()[1]
    p = torch.tensor([[0.3, -0.2, 0.4]])
    whole, _ = camera.project(p)
    twice, _ = camera.scaled(2).project(p)
    torch.testing.assert_close(twice, whole * 2)
    plain = Cameras.look_at((0, 0, 5), (0, 0, 0), width=100, height=50)
    wide = resized(plain, 300, 100)
    torch.testing.assert_close(wide.intrinsics, Cameras.look_at((0, 0, 5), (0, 0, 0), width=300, height=100).intrinsics)


def test_batches_split_and_join():
    cameras = some_cameras()
    again = Cameras.cat([cameras[0], cameras[1:]])
    assert torch.equal(again.camera_from_world, cameras.camera_from_world)
    assert len(cameras[-1]) == 1 and torch.equal(cameras[-1].eye[0], cameras.eye[2])
    with pytest.raises(CameraError, match="share"):
        Cameras.cat([cameras, cameras.scaled(2)])
    with pytest.raises(CameraError, match="empty"):
        Cameras.cat([])


def test_footprint_is_the_width_of_a_pixel():
    for orthographic in (False, True):
        cameras = some_cameras(orthographic)
        depth = torch.full((3, 1), 2.0, dtype=torch.float64)
        a, b = (
            cameras.unproject(torch.tensor(p, dtype=torch.float64).expand(3, 1, 2), depth) for p in ((5.0, 5), (5, 6))
        )
        assert bool(((a - b).norm(dim=-1) <= cameras.footprint(depth) * 1.01).all())


@pytest.mark.parametrize(("width", "height"), [(100, 100), (300, 80), (60, 240)])
def test_the_framing_camera_sees_every_box(width, height):
    boxes = torch.tensor([[[-1.0, 0, -3], [2, 1, 4]], [[5, 0, 0], [6, 8, 1]]])
    camera = framing_camera(boxes, width=width, height=height)
    corners = torch.cartesian_prod(*[torch.tensor([0, 1])] * 3)
    points = boxes[:, corners, torch.arange(3)].reshape(-1, 3)
    pixels, z = camera.project(points)
    assert bool((pixels >= 0).all()) and bool((pixels[..., 0] <= width).all() & (pixels[..., 1] <= height).all())
    assert bool((z >= camera.near).all() & (z <= camera.far).all())
    assert float(camera.near) < 2e-3 * float(z.max()), "whoever goes on from here comes closer"
    edge = torch.minimum(pixels, torch.tensor([width, height]) - pixels).amin(1)[0]
    assert float((edge / torch.tensor([width, height])).min()) < 0.05  # and it fills the image


@pytest.mark.parametrize("scale", [1e-4, 3e3])
def test_framing_does_not_depend_on_units(scale):
    boxes = torch.tensor([[[-1.0, 0, -3], [2, 1, 4]], [[5, 0, 0], [6, 8, 1]]], dtype=torch.float64)
    usual, camera = (framing_camera(boxes * s, width=120, height=90) for s in (1.0, scale))
    for name in ("eye", "near", "far"):
        torch.testing.assert_close(getattr(camera, name), scale * getattr(usual, name), rtol=1e-9, atol=0)
    torch.testing.assert_close(camera.rotation, usual.rotation)
    torch.testing.assert_close(camera.intrinsics, usual.intrinsics)


def test_framing_nothing_and_a_point():
    for boxes in (torch.zeros(0, 2, 3), torch.full((1, 2, 3), 7.0)):
        camera = framing_camera(boxes, width=20, height=20)
        assert bool(torch.isfinite(camera.camera_from_world).all())


def test_wrong_shapes_and_values_are_named():
    good = some_cameras()
    with pytest.raises(CameraError, match="camera_from_world"):
        Cameras(torch.eye(4), good.intrinsics, 4, 4, 0.1, 1.0)
    leaning = torch.eye(4, dtype=torch.float64)[None].clone()
    leaning[0, 3, 0] = 0.5
    with pytest.raises(CameraError, match="camera_from_world must have the last row 0, 0, 0, 1"):
        Cameras(camera_from_world=leaning, intrinsics=torch.eye(3)[None], width=8, height=8)
    with pytest.raises(CameraError, match="intrinsics"):
        Cameras(good.camera_from_world, good.intrinsics[:2], 4, 4, 0.1, 1.0)
    with pytest.raises(CameraError, match="focal"):
        Cameras(good.camera_from_world, -good.intrinsics, 4, 4, 0.1, 1.0)
    with pytest.raises(CameraError, match="rotation"):
        Cameras(torch.zeros(3, 4, 4), good.intrinsics, 4, 4, 0.1, 1.0)
    with pytest.raises(CameraError, match="far"):
        Cameras(good.camera_from_world, good.intrinsics, 4, 4, 0.1, math.inf, orthographic=True)
    with pytest.raises(CameraError, match="points"):
        good.project(torch.zeros(5, 2))


def test_pixels_that_do_not_fit_are_refused_by_name() -> None:
    one = Cameras.look_at([0, 0, 3], [0, 0, 0], width=8, height=6)
    for pixels in (torch.zeros(5, 2), torch.zeros(1, 5, 3), torch.zeros(2)):
        with pytest.raises(CameraError, match=r"pixels must have shape \(1, ..., 2\), got"):
            one.rays(pixels)
    with pytest.raises(CameraError, match=r"depth must have shape \(1, ...\), got \(6, 8\)"):
        one.unproject(one.pixel_centres(), torch.ones(6, 8))
    with pytest.raises(CameraError, match=r"pixels must have shape \(1, 6, 7, 2\) as depth has, got \(6, 8, 2\)"):
        one.unproject(one.pixel_centres(), torch.ones(1, 6, 7))
    assert one.rays(torch.zeros(1, 0, 2))[0].shape == (1, 0, 3)


def test_no_eyes_are_no_cameras() -> None:
    """As a part of a batch with nothing in it."""
    none = torch.zeros(0, 3)
    looking = Cameras.look_at(none, [0.0, 0.0, 0.0], width=4, height=3)
    flat = Cameras.orthographic_view(none, none, width=4, height=3, view_height=2.0)
    for empty in (looking, flat, Cameras.cat([looking, looking[0:0]])):
        assert len(empty) == 0 and empty.eye.shape == (0, 3)
        assert tuple(empty.rays()[1].shape) == (0, 3, 4, 3)
    one = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=4, height=3)
    assert len(Cameras.cat([looking, one])) == 1
    with pytest.raises(CameraError, match="eye, target and up must be one or equally many, got 0, 2, 1"):
        Cameras.look_at(none, torch.zeros(2, 3), width=4, height=3)
    with pytest.raises(CameraError, match="cameras must not be empty: an empty batch has a size of pictures, too"):
        Cameras.cat([])
