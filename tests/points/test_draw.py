"""Points drawn by EWA: against a slow twin, and by laws."""

from __future__ import annotations

import math
from dataclasses import replace

import numba
import numpy as np
import pytest
import torch

from point_scenes import checker, checkered_ground, joined, psnr, random_cloud, sheet_cloud, sphere_cloud
from torchrender.errors import CameraError, OptionError
from torchrender.kernels.points import ewa
from torchrender.points.cloud import PointCloud
from torchrender.points.draw import patch_modes, render_points, widest
from torchrender.points.options import SplatOptions
from torchrender.points.select import SelectionOptions, select_patches
from torchrender.points.tree import PatchOptions, build_patches
from torchrender.scene.camera import Cameras

DEEPEST = SelectionOptions(level="deepest")
NEAR_FAR = {"near": 0.1, "far": 100.0}


def slow_ellipse(o, n, r, k, mode, options):
    """Matrix H of the cut-off ellipse and the factor before the Gaussian."""
    fx, skew, fy = k[0, 0], k[0, 1], k[1, 1]
    a = np.array([
        [fx / o[2], skew / o[2], -(fx * o[0] + skew * o[1]) / o[2] ** 2],
        [0.0, fy / o[2], -fy * o[1] / o[2] ** 2],
    ])  # fmt: skip
    covariance = a @ (np.eye(3) - np.outer(n, n)) @ a.T
    det = fx * fy * abs(o @ n) / o[2] ** 3
    h = {
        "full": r * r * covariance + options.low_pass_radius**2 * np.eye(2),
        "reconstruction": r * r * covariance,
        "low_pass": options.low_pass_radius**2 * np.eye(2),
    }[mode]
    if mode == "reconstruction":
        least = np.linalg.eigvalsh(h)[0]
        h = h + max(1e-4 - least, 0) * np.eye(2)
    return h, det / (2 * math.pi * options.gaussian_width**2 * math.sqrt(np.linalg.det(h)))


def slow_splat(cloud: PointCloud, camera: Cameras, mode: str, options: SplatOptions):
    """Both passes, point by point and pixel by pixel (specification 06, section 7)."""
    k, near = camera.intrinsics[0].numpy(), float(camera.near[0])
    centres = camera.transform(cloud.position)[0].numpy()
    normals = cloud.normal.double().numpy() @ camera.rotation[0].numpy().T
    height, width = camera.height, camera.width
    fragments = []
    for o, n, r, color in zip(centres, normals, cloud.radius.double().numpy(), cloud.color.double().numpy()):
        if o[2] <= near or n @ o >= 0:
            continue
        h, scale = slow_ellipse(o, n, r, k, mode, options)
        u = (k[0, 0] * o[0] + k[0, 1] * o[1]) / o[2] + k[0, 2]
        v = k[1, 1] * o[1] / o[2] + k[1, 2]
        inverse = np.linalg.inv(h)
        for y in range(height):
            for x in range(width):
                d = np.array([x + 0.5 - u, y + 0.5 - v])
                q = d @ inverse @ d
                if q > 1:
                    continue
                py = (y + 0.5 - k[1, 2]) / k[1, 1]
                px = (x + 0.5 - k[0, 2] - k[0, 1] * py) / k[0, 0]
                slope = n @ np.array([px, py, 1.0])
                # A plane seen from its other side in this pixel lies beyond the horizon.
                z = (n @ o) / slope if slope < 0 else math.inf
                pixel = o[2] / max(k[0, 0], k[1, 1])
                tangent = math.tan(math.acos(min(1.0, -(n @ o) / np.linalg.norm(o))))
                spread = options.low_pass_radius * pixel * min(max(tangent, 1.0), 16.0)
                z = o[2] if mode == "low_pass" else min(max(z, o[2] - r), o[2] + r)
                epsilon = options.depth_tolerance * (r + (pixel if mode == "reconstruction" else spread))
                fragments.append((y, x, z, epsilon, scale * math.exp(-q / (2 * options.gaussian_width**2)), color))
    nearest = np.full((height, width), math.inf)
    for y, x, z, *_ in fragments:
        nearest[y, x] = min(nearest[y, x], z)
    total, image, depth = np.zeros((height, width)), np.zeros((height, width, 3)), np.zeros((height, width))
    for y, x, z, epsilon, w, color in fragments:
        if z <= nearest[y, x] + epsilon:
            total[y, x] += w
            image[y, x] += w * color
            depth[y, x] += w * z
    covered = total > 0
    image[covered] /= total[covered][:, None]
    depth = np.where(covered, depth / np.where(covered, total, 1), math.inf)
    return image, depth, total


def twin_camera() -> Cameras:
    """Off-centre principal point, fx != fy, skew."""
    camera = Cameras.look_at([0.3, 0.4, 9.0], [0.1, 0.0, 0.0], width=45, height=38, near=0.1, far=100.0)
    k = torch.tensor([[[60.0, 3.0, 15.0], [0.0, 44.0, 25.0], [0.0, 0.0, 1.0]]], dtype=torch.float64)
    return replace(camera, intrinsics=k)


@pytest.mark.parametrize("mode", ["full", "reconstruction"])
def test_pictures_are_those_of_a_slow_twin(mode):
    g = torch.Generator().manual_seed(3)
    cloud = random_cloud(60, seed=3)
    cloud = replace(cloud, position=cloud.position - 5.0, radius=torch.rand(60, generator=g) * 0.6 + 0.1)
    options = SplatOptions(filter=mode, shading="none", selection=DEEPEST)
    camera = twin_camera()
    drawn = render_points(cloud, camera, options)
    image, depth, weight = slow_splat(cloud, camera, mode, options)
    usual = float(cloud.radius.double().mean()) ** 2
    np.testing.assert_array_equal(drawn.mask[0].numpy(), weight > 0)
    np.testing.assert_allclose(drawn.weight[0].numpy(), weight * usual, rtol=2e-3, atol=1e-6 * weight.max() * usual)
    np.testing.assert_allclose(drawn.image[0].numpy(), image, atol=2e-3)
    np.testing.assert_allclose(drawn.depth[0].numpy(), depth, rtol=1e-4)
    assert 0.1 < float(drawn.mask.float().mean()) < 1.0


@pytest.mark.parametrize("r_h", [0.5, 1.0, 1.5, 2.0])
def test_low_pass_stamps_are_those_of_a_slow_twin_but_for_their_places(r_h):
    """Stamps stand at sixteenths of a pixel: points at such places give exactly the twin's picture."""
    g = torch.Generator().manual_seed(5)
    camera = Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=32, height=24, fov_deg=45, **NEAR_FAR)
    places = torch.rand(50, 2, generator=g).double() * torch.tensor([32.0, 24.0]).double()
    places = ((places * 16).floor() + 0.5) / 16
    world = camera.unproject(places[None], torch.full((1, 50), 4.0).double())[0]
    normal = torch.tensor([0.0, 0.0, 1.0]).expand(50, 3).contiguous()
    cloud = PointCloud(position=world, normal=normal, radius=torch.full((50,), 0.01),
                       color=torch.rand(50, 3, generator=g))  # fmt: skip
    options = SplatOptions(filter="low_pass", shading="none", selection=DEEPEST, low_pass_radius=r_h)
    drawn = render_points(cloud, camera, options)
    image, depth, weight = slow_splat(cloud, camera, "low_pass", options)
    np.testing.assert_array_equal(drawn.mask[0].numpy(), weight > 0)
    np.testing.assert_allclose(drawn.image[0].numpy(), image, atol=1e-4)
    np.testing.assert_allclose(drawn.weight[0].numpy(), weight * 1e-4, rtol=1e-4)
    np.testing.assert_allclose(drawn.depth[0].numpy(), depth, rtol=1e-5)


@pytest.mark.parametrize("mode", ["adaptive", "full", "reconstruction", "low_pass", "squares"])
@pytest.mark.parametrize("level", ["auto", "deepest"])
def test_constant_colour_stays_constant(mode, level):
    cloud = replace(sphere_cloud(8000), color=torch.tensor([0.3, 0.7, 0.1]).expand(8000, 3).contiguous())
    camera = cloud.camera(width=150, height=150)
    options = SplatOptions(filter=mode, shading="none", selection=SelectionOptions(level=level))
    drawn = render_points(cloud, camera, options)
    assert bool(drawn.mask.any())
    colors = drawn.image[drawn.mask]
    assert float((colors - torch.tensor([0.3, 0.7, 0.1])).abs().max()) < 1e-6


@pytest.mark.parametrize("mode", ["adaptive", "full"])
@pytest.mark.parametrize("distance", [1.0, 4.0, 30.0])
@pytest.mark.parametrize("tilt", [0.0, 1.2])
def test_a_dense_plane_has_no_holes(mode, distance, tilt):
    cloud = sheet_cloud(120)
    eye = [0.0, distance * math.sin(tilt), distance * math.cos(tilt)]
    camera = Cameras.look_at(eye, [0.0, 0.0, 0.0], width=128, height=128, near=0.01)
    drawn = render_points(cloud, camera, SplatOptions(filter=mode))
    _, rays = camera.rays()
    t = -camera.eye[0, 2] / rays[0, ..., 2]
    hit = camera.eye[0] + t[..., None] * rays[0]
    inside = (hit[..., :2].abs() < 2.9).all(-1) & (t > 0)
    assert int(inside.sum()) > 100
    assert bool(drawn.mask[0][inside].all())


def test_depth_is_that_of_the_plane():
    camera = Cameras.look_at([0.5, 1.0, 3.0], [0.0, 0.0, 0.0], width=96, height=96)
    drawn = render_points(sheet_cloud(100), camera)
    _, rays = camera.rays()
    t = (-camera.eye[0, 2] / rays[0, ..., 2])[drawn.mask[0]]
    inner = t < 3.6
    torch.testing.assert_close(drawn.depth[0][drawn.mask[0]][inner].double(), t[inner], rtol=0.01, atol=0)


def test_culled_and_unculled_pictures_agree():
    patches = build_patches(sphere_cloud(40_000))
    for eye, fov in (([0.0, 0.0, 3.0], 45), ([0.4, 0.3, 1.3], 30), ([0.0, 0.0, 0.5], 60)):
        camera = Cameras.look_at(eye, [0.2, 0.1, 0.0], width=96, height=80, fov_deg=fov)
        culled, whole = (
            render_points(patches, camera, SplatOptions(selection=SelectionOptions(cull=cull)))
            for cull in (True, False)
        )
        assert culled.statistics[0].nodes < whole.statistics[0].nodes
        assert float((culled.image - whole.image).abs().max()) < 1e-6
        assert torch.equal(culled.mask, whole.mask)


@pytest.mark.parametrize("choice", ["patch", "point"])
@pytest.mark.parametrize("test", ["area", "eigen"])
def test_no_thresholds_is_full_ewa_bit_by_bit(choice, test):
    patches = build_patches(sphere_cloud(5000))
    camera = patches.camera(width=120, height=120)
    first = render_points(
        patches, camera, SplatOptions(low_pass_below=0.0, reconstruction_above=math.inf, choice=choice, test=test)
    )
    second = render_points(patches, camera, SplatOptions(filter="full"))
    for name in ("image", "depth", "weight"):
        assert torch.equal(getattr(first, name), getattr(second, name))


def blocks(image: torch.Tensor) -> torch.Tensor:
    """Means over blocks of 16 by 16 pixels."""
    height, width = image.shape
    return image.reshape(height // 16, 16, width // 16, 16).mean(dim=(1, 3))


def ground_pictures():
    """The checkered ground at 128² in each mode and a reference of 16 by 16 rays a pixel, near and far half."""
    cloud = build_patches(checkered_ground(), PatchOptions(max_points=256))
    camera = Cameras.look_at([0.0, 1.5, 0.0], [0.0, 0.0, -8.0], width=128, height=128, fov_deg=50, near=0.1)
    fine = camera.scaled(16)
    _, rays = fine.rays()
    t = -camera.eye[0, 1] / rays[0, ..., 1]
    hit = camera.eye[0] + t[..., None] * rays[0]
    inside = (t > 0) & (hit[..., 0].abs() < 4) & (hit[..., 2] < -1) & (hit[..., 2] > -24)
    share, value = blocks(inside.double()), blocks(torch.where(inside, checker(hit[..., 0], hit[..., 2]).double(), 0.0))
    whole = share > 0.999
    distance = blocks(torch.where(inside, t, 0.0))
    modes = ("full", "adaptive", "reconstruction", "low_pass")
    pictures = {
        m: render_points(cloud, camera, SplatOptions(filter=m, choice="point", shading="none", selection=DEEPEST))
        for m in modes
    }
    far = whole & (distance > 12)
    quality = {m: (psnr(p.image[0, ..., 0][whole], value[whole]), psnr(p.image[0, ..., 0][far], value[far]))
               for m, p in pictures.items()}  # fmt: skip
    return pictures, quality


def test_ground_plane_quality_by_mode():
    pictures, quality = ground_pictures()
    assert quality["adaptive"][1] >= quality["reconstruction"][1] + 5.0
    assert abs(quality["adaptive"][0] - quality["full"][0]) < 0.3
    assert quality["adaptive"][0] > quality["low_pass"][0]
    assert quality["full"][0] > 16.0 and quality["full"][1] > 20.0
    found, full = pictures["adaptive"].statistics[0], pictures["full"].statistics[0]
    assert min(found.full, found.reconstruction, found.low_pass) > 0
    assert found.evaluations < full.evaluations


@pytest.mark.parametrize("mode", ["adaptive", "full", "squares"])
def test_the_rear_of_two_sheets_never_shows(mode):
    front = sheet_cloud(60, z=0.0, color=(1.0, 0.0, 0.0))
    rear = sheet_cloud(60, z=-1.0, color=(0.0, 1.0, 0.0))
    camera = Cameras.look_at([0.2, 0.1, 3.0], [0.0, 0.0, 0.0], width=96, height=96, fov_deg=40)
    drawn = render_points(joined(front, rear), camera, SplatOptions(filter=mode, shading="none"))
    inside = drawn.depth[0] < 3.5
    assert int(inside.sum()) > 1000
    assert float(drawn.image[0][inside][:, 1].max()) < 1e-3


def test_a_thin_double_wall_shows_the_side_that_faces():
    """Closer together than the tolerance: only the back-face test can tell them apart."""
    front = sheet_cloud(60, z=0.0, color=(1.0, 0.0, 0.0))
    rear = sheet_cloud(60, z=-0.01, color=(0.0, 1.0, 0.0), facing=-1.0)
    camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=64, height=64)
    drawn = render_points(joined(front, rear), camera, SplatOptions(shading="none"))
    assert float(drawn.image[..., 1].max()) == 0.0
    behind = Cameras.look_at([0.0, 0.0, -3.0], [0.0, 0.0, 0.0], width=64, height=64)
    drawn = render_points(joined(front, rear), behind, SplatOptions(shading="none"))
    assert float(drawn.image[..., 0].max()) == 0.0


def test_moving_away_draws_ever_fewer_points():
    patches = build_patches(sphere_cloud(60_000))
    options = SplatOptions(two_sided=True)
    drawn = []
    for distance in (1.5, 2.0, 3.0, 5.0, 8.0, 15.0, 40.0, 150.0):
        camera = Cameras.look_at([0.0, 0.0, distance], [0.0, 0.0, 0.0], width=128, height=128, fov_deg=100)
        drawn.append(render_points(patches, camera, options).statistics[0].nodes)
    assert drawn == sorted(drawn, reverse=True) and drawn[-1] < 0.01 * drawn[0]


def test_a_batch_is_its_cameras_one_by_one_in_any_order():
    patches = build_patches(sphere_cloud(5000))
    eyes = torch.tensor([[0.0, 0.0, 3.0], [2.0, 1.0, 1.0], [0.0, 4.0, 0.1]])
    cameras = Cameras.look_at(eyes, [0.0, 0.0, 0.0], width=70, height=50)
    batch, reverse = render_points(patches, cameras), render_points(patches, cameras[[2, 1, 0]])
    for number in range(3):
        single = render_points(patches, cameras[number])
        for name in ("image", "depth", "weight"):
            assert torch.equal(getattr(batch, name)[number], getattr(single, name)[0])
            assert torch.equal(getattr(reverse, name)[2 - number], getattr(single, name)[0])
    assert batch.image.shape == (3, 50, 70, 3)


def test_threads_do_not_change_the_picture():
    patches = build_patches(sphere_cloud(20_000))
    camera = patches.camera(width=100, height=100)
    many = render_points(patches, camera)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = render_points(patches, camera)
    finally:
        numba.set_num_threads(before)
    assert torch.equal(many.image, one.image) and torch.equal(many.weight, one.weight)


def test_modes_follow_size_on_screen_and_silhouettes_are_full():
    patches = build_patches(sphere_cloud(30_000), PatchOptions(max_points=256))
    modes = {}
    for distance in (1.6, 400.0):
        camera = Cameras.look_at([0.0, 0.0, distance], [0.0, 0.0, 0.0], width=512, height=512, fov_deg=20)
        options = SplatOptions(selection=DEEPEST)
        found = select_patches(patches.headers, camera, options.selection, two_sided=False, margin=1.0)
        chosen = patch_modes(patches, camera, options, found)
        assert bool((chosen[found.silhouette] == ewa.FULL).all())
        modes[distance] = set(chosen[~found.silhouette].tolist())
    assert modes[1.6] == {ewa.RECONSTRUCTION} and modes[400.0] == {ewa.LOW_PASS}


def test_the_widest_angle_counts_the_principal_point():
    camera = Cameras.look_at([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], width=200, height=100, fov_deg=90)
    assert widest(camera) == pytest.approx(math.sqrt(1 + 4 + 1))
    assert widest(camera.sub_camera(100, 50, 200, 100)) == pytest.approx(math.sqrt(1 + 16 + 4))


def test_lambert_by_point_and_by_pixel():
    cloud = sphere_cloud(30_000, colored=False)
    camera = Cameras.look_at([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], width=96, height=96)
    light = (0.0, 0.6, 0.8)
    lit = {
        s: render_points(cloud, camera, SplatOptions(shading=s, light=light, ambient=0.1)) for s in ("point", "pixel")
    }
    place = camera.unproject(camera.pixel_centres()[None], lit["point"].depth.double().clamp(max=10))[0]
    normal = torch.nn.functional.normalize(place, dim=-1)
    wanted = 0.8 * (0.1 + 0.9 * (normal @ torch.tensor(light).double()).clamp_min(0))
    inner = lit["point"].mask[0] & (place[..., 2] > 0.6)
    for picture in lit.values():
        assert float((picture.image[0, ..., 1].double() - wanted)[inner].abs().max()) < 0.03


def test_two_sided_points_are_seen_from_behind():
    cloud = sheet_cloud(20)
    behind = Cameras.look_at([0.0, 0.0, -3.0], [0.0, 0.0, 0.0], width=32, height=32)
    assert not bool(render_points(cloud, behind).mask.any())
    assert bool(render_points(cloud, behind, SplatOptions(two_sided=True)).mask.any())
    assert bool(render_points(replace(cloud, two_sided=True), behind).mask.any())


def test_a_background_fills_what_no_point_covers():
    camera = Cameras.look_at([0.0, 0.0, 5.0], [0.0, 0.0, 0.0], width=32, height=32)
    drawn = render_points(sheet_cloud(3), camera, SplatOptions(background=(0.1, 0.2, 0.3)))
    empty = ~drawn.mask
    assert bool(empty.any()) and bool(torch.isinf(drawn.depth[empty]).all())
    assert torch.equal(drawn.image[empty], torch.tensor([0.1, 0.2, 0.3]).expand(int(empty.sum()), 3))


def test_wrong_options_and_cameras_are_named():
    for wrong in (
        {"gaussian_width": 0.1},
        {"filter": "bilinear"},
        {"reconstruction_above": 0.5},
        {"low_pass_radius": math.nan},
        {"light": (0.0, 0.0, 0.0)},
    ):
        with pytest.raises(OptionError, match=next(iter(wrong))):
            SplatOptions(**wrong)
    camera = replace(Cameras.look_at([0.0, 0.0, 1.0], [0.0, 0.0, 0.0], width=8, height=8, far=9.0), orthographic=True)
    with pytest.raises(CameraError, match="perspective"):
        render_points(sheet_cloud(3), camera)
