"""Hard cases of point splatting (specification 06, section 12)."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from point_scenes import joined, random_cloud, sheet_cloud, sphere_cloud
from torchrender.errors import InputError
from torchrender.points.cloud import PointCloud
from torchrender.points.codec import compress
from torchrender.points.draw import render_points
from torchrender.points.options import PointImage, SplatOptions
from torchrender.points.select import SelectionOptions
from torchrender.points.tree import PatchOptions, build_patches
from torchrender.scene.camera import Cameras

MODES = ("adaptive", "full", "reconstruction", "low_pass", "squares")
CAMERA = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=48, height=40, near=0.01)


def check(drawn: PointImage) -> PointImage:
    """No NaN anywhere, finite where something is, and consistent masks."""
    assert bool(torch.isfinite(drawn.image).all()) and bool(torch.isfinite(drawn.weight).all())
    assert bool((torch.isfinite(drawn.depth) == drawn.mask).all()) and not bool(drawn.depth.isnan().any())
    return drawn


def one_point(position=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0), radius=0.2) -> PointCloud:
    return PointCloud(position=torch.tensor([position]).double(), normal=torch.tensor([normal]).float(),
                      radius=torch.tensor([radius]), color=torch.ones(1, 3))  # fmt: skip


@pytest.mark.parametrize("mode", MODES)
def test_a_single_point_is_a_disc(mode):
    drawn = check(render_points(one_point(), CAMERA, SplatOptions(filter=mode)))
    mask = drawn.mask[0]
    assert bool(mask.any())
    assert torch.equal(mask, mask.flip(0)) and torch.equal(mask, mask.flip(1))
    assert float(drawn.depth[0][mask].max()) == pytest.approx(3.0, rel=1e-5)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("tilt", [0.0, 1e-14, 1e-9, 1e-4])
def test_edge_on_discs(mode, tilt):
    normal = (math.cos(tilt), 0.0, math.sin(tilt))
    drawn = check(render_points(one_point(normal=normal), CAMERA, SplatOptions(filter=mode)))
    assert int(drawn.mask.sum()) < 48 * 3 if mode != "squares" else True
    found = drawn.statistics[0]
    assert found.drawn + found.degenerate + found.back <= 1


@pytest.mark.parametrize("mode", MODES)
def test_zero_and_nan_normals_face_the_eye(mode):
    cloud = sheet_cloud(12, spacing=0.1)
    known = render_points(cloud, CAMERA, SplatOptions(filter=mode, shading="none"))
    for wrong in (0.0, math.nan, math.inf):
        lost = PointCloud(position=cloud.position, normal=torch.full_like(cloud.normal, wrong), radius=cloud.radius,
                          color=cloud.color)  # fmt: skip
        drawn = check(render_points(build_patches(lost), CAMERA, SplatOptions(filter=mode, shading="none")))
        assert float((drawn.mask != known.mask).float().mean()) < 0.05
        assert bool((drawn.image[drawn.mask] > 0.999).all())


def test_points_that_have_no_normal_at_all_are_drawn():
    """On a line, at one place: neighbours tell nothing, each point faces the eye."""
    line = torch.zeros(30, 3)
    line[:, 0] = torch.linspace(-1, 1, 30)
    drawn = check(render_points(PointCloud(position=line), CAMERA))
    assert int(drawn.mask[0].any(0).sum()) > 20
    assert bool(check(render_points(PointCloud(position=torch.zeros(9, 3)), CAMERA)).mask.any())
    assert bool(check(render_points(PointCloud(position=torch.zeros(1, 3)), CAMERA)).mask.any())


def test_zero_negative_and_nan_radii_are_estimated():
    cloud = sheet_cloud(20, spacing=0.1)
    radius = cloud.radius.clone()
    radius[::4], radius[1::4], radius[2::8] = 0.0, math.nan, -1.0
    whole = PointCloud(position=cloud.position, normal=cloud.normal, radius=radius).completed()
    assert bool((whole.radius > 0).all())
    # Diagonal neighbours are the sixth on a grid, sides of the sheet aside.
    inner = cloud.position[:, :2].abs().amax(1) < 0.8
    estimated = ~(torch.isfinite(radius) & (radius > 0)) & inner
    torch.testing.assert_close(whole.radius[estimated], torch.full_like(radius[estimated], 0.75 * 0.1 * 2**0.5))
    assert bool(check(render_points(whole, CAMERA)).mask.any())


@pytest.mark.parametrize("count", [2, 64, 65, 20_000])
def test_identical_points(count):
    cloud = PointCloud(position=torch.full((count, 3), 0.1), normal=torch.tensor([0.0, 0.0, 1.0]).expand(count, 3),
                       radius=torch.full((count,), 0.05), color=torch.rand(count, 3))  # fmt: skip
    patches = build_patches(cloud)
    assert int(patches.headers.count.sum()) == count
    drawn = check(render_points(patches, CAMERA))
    assert bool(drawn.mask.any())
    packed = check(render_points(compress(patches), CAMERA))
    assert torch.equal(packed.mask, drawn.mask)
    mean = check(render_points(patches, CAMERA, SplatOptions(shading="none", filter="full"))).image[drawn.mask]
    torch.testing.assert_close(mean, cloud.color.mean(0).expand_as(mean), atol=2e-3, rtol=0)


@pytest.mark.parametrize("mode", MODES)
def test_points_behind_and_on_the_camera_plane(mode):
    behind = [one_point((0.0, 0.0, z)) for z in (3.0, 3.0 - 1e-12, 2.995, 3.1, 50.0)]
    for cloud in behind:
        drawn = check(render_points(cloud, CAMERA, SplatOptions(filter=mode, selection=SelectionOptions(cull=False))))
        assert not bool(drawn.mask.any())
    # Points beside the eye in its own plane, with radii that reach in front of it.
    beside = joined(*(one_point((x, 0.0, 3.0), radius=2.0) for x in (-1.0, -1e-9, 0.0, 0.5)))
    drawn = check(render_points(beside, CAMERA, SplatOptions(filter=mode)))
    assert not bool(drawn.mask.any())


def test_an_eye_inside_the_model_sees_what_lies_ahead():
    cloud = sphere_cloud(4000)
    inwards = replace(cloud, normal=-cloud.normal)
    camera = Cameras.look_at([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], width=64, height=64, near=0.01)
    drawn = check(render_points(inwards, camera))
    assert bool(drawn.mask.all())
    assert float((drawn.depth - 1.0).abs().max()) < 0.5
    assert not bool(render_points(cloud, camera).mask.any())


def test_opposing_normals_in_one_patch():
    cloud = random_cloud(50, seed=2)
    cloud = replace(cloud, position=cloud.position - 5.0, normal=torch.cat([cloud.normal[:25], -cloud.normal[:25]]))
    patches = build_patches(cloud)
    assert float(patches.headers.cone[:, 3].max()) > math.pi / 2
    assert bool(check(render_points(patches, CAMERA)).mask.any())


@pytest.mark.parametrize("mode", MODES)
def test_radii_over_a_range_of_ten_to_the_fourth(mode):
    """The smallest points keep their place beside the largest: their weights differ by ten to the eighth."""
    small = replace(sheet_cloud(30, z=0.5, spacing=0.01, color=(1.0, 0.0, 0.0)), radius=torch.full((900,), 2e-4))
    large = one_point((0.0, 0.0, -1.0), radius=2.0)
    drawn = check(render_points(joined(small, large), CAMERA, SplatOptions(filter=mode, shading="none")))
    assert float(drawn.image[0, 20, 24, 0]) == pytest.approx(1.0, abs=0.05)
    if mode not in ("reconstruction", "low_pass"):
        assert float(drawn.image[0, 20, 24, 1]) < 0.05
        assert bool(drawn.mask[0, 10, 12])


def test_very_large_splats_are_counted_and_cost_no_more_than_the_image():
    drawn = check(render_points(one_point((0.0, 0.0, 2.0), radius=1e6), CAMERA))
    assert bool(drawn.mask.all())
    found = drawn.statistics[0]
    assert (found.capped, found.large, found.evaluations) == (1, 1, 48 * 40)


@pytest.mark.parametrize("offset", [1e5, 1e7, -1e9])
def test_far_from_the_origin(offset):
    cloud = sphere_cloud(3000)
    near = render_points(cloud, CAMERA)
    moved = replace(cloud, position=cloud.position + offset)
    shift = torch.full((3,), offset, dtype=torch.float64)
    camera = Cameras.look_at(shift + torch.tensor([0.0, 0.0, 3.0]), shift, width=48, height=40, near=0.01)
    far = check(render_points(moved, camera))
    tolerance = 1e-3 if abs(offset) < 1e8 else 0.02
    assert float((far.mask != near.mask).float().mean()) < 0.01
    both = far.mask & near.mask
    assert float((far.image - near.image)[both].abs().mean()) < tolerance


@pytest.mark.parametrize("scale", [1e-12, 1e-6, 1e6, 1e12])
def test_scenes_of_any_size_look_alike(scale):
    cloud = sphere_cloud(3000)
    other = replace(cloud, position=cloud.position * scale, radius=cloud.radius * scale)
    first = render_points(cloud, CAMERA)
    camera = Cameras.look_at([0.0, 0.0, 3.0 * scale], [0.0, 0.0, 0.0], width=48, height=40, near=0.01 * scale)
    second = check(render_points(other, camera))
    assert float((first.mask != second.mask).float().mean()) < 0.005
    torch.testing.assert_close(first.image[first.mask & second.mask], second.image[first.mask & second.mask],
                               atol=2e-2, rtol=0)  # fmt: skip


def test_a_million_points_in_one_pixel():
    g = torch.Generator().manual_seed(0)
    count = 1_000_000
    position = torch.randn(count, 3, generator=g).double() * 1e-4
    cloud = PointCloud(position=position, normal=torch.tensor([0.0, 0.0, 1.0]).expand(count, 3),
                       radius=torch.full((count,), 1e-5), color=torch.full((count, 3), 0.5))  # fmt: skip
    patches = build_patches(cloud, PatchOptions(max_points=65536))
    drawn = check(render_points(patches, CAMERA, SplatOptions(shading="none")))
    assert drawn.statistics[0].nodes < 0.02 * count
    every = SplatOptions(shading="none", selection=SelectionOptions(level="deepest"))
    whole = check(render_points(patches, CAMERA, every))
    assert whole.statistics[0].drawn == count and 1 <= int(whole.mask.sum()) <= 9
    torch.testing.assert_close(whole.image[whole.mask], torch.full((int(whole.mask.sum()), 3), 0.5))


def test_an_image_of_one_pixel_and_sides_that_fit_no_tile():
    for width, height in ((1, 1), (33, 1), (31, 65)):
        camera = Cameras.look_at([0.0, 0.0, 3.0], [0.0, 0.0, 0.0], width=width, height=height)
        assert bool(check(render_points(sphere_cloud(500), camera)).mask.any())


def test_points_at_the_borders_of_the_image_are_not_cut_off():
    """A wider image shows the same pixels: nothing depends on where a border cuts a splat's box."""
    cloud = sphere_cloud(3000)
    camera = Cameras.look_at([0.0, 0.0, 2.0], [0.0, 0.0, 0.0], width=64, height=64, fov_deg=80)
    whole = {m: render_points(cloud, camera, SplatOptions(filter=m)) for m in MODES}
    part = camera.sub_camera(21, 18, 25, 29)
    for mode, picture in whole.items():
        cut = render_points(cloud, part, SplatOptions(filter=mode))
        torch.testing.assert_close(cut.image[0], picture.image[0, 18:47, 21:46], atol=1e-4, rtol=0)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_no_point_makes_a_nan(data):
    """Positions, normals and radii over many orders of magnitude, in every mode."""
    count = data.draw(st.integers(1, 12))
    seed = data.draw(st.integers(0, 10**6))
    g = torch.Generator().manual_seed(seed)
    size = 10.0 ** (torch.rand(count, 1, generator=g).double() * 16 - 8)
    cloud = PointCloud(
        position=torch.randn(count, 3, generator=g).double() * size,
        normal=torch.randn(count, 3, generator=g) * (torch.rand(count, 1, generator=g) > 0.2),
        radius=(10.0 ** (torch.rand(count, generator=g) * 16 - 8)).float(),
    )
    options = SplatOptions(
        filter=data.draw(st.sampled_from(MODES)),
        choice=data.draw(st.sampled_from(["patch", "point"])),
        test=data.draw(st.sampled_from(["area", "eigen"])),
        shading=data.draw(st.sampled_from(["point", "pixel", "none"])),
        two_sided=data.draw(st.booleans()),
    )
    check(render_points(build_patches(cloud), CAMERA, options))


@pytest.mark.parametrize("value", [2.0, -0.5])
def test_opacities_outside_their_range_are_refused(value):
    with pytest.raises(InputError, match=r"opacity must lie in \[0, 1\]"):
        PointCloud(position=torch.zeros(2, 3).double(), opacity=torch.tensor([0.5, value]))
    near = PointCloud(position=torch.zeros(1, 3).double(), opacity=torch.tensor([1.00001]))
    assert near.opacity is not None and float(near.opacity) == 1.0
