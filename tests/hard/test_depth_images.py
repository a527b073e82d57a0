"""Hard numerical cases of depth-image sampling (specification 01, section 11)."""

from __future__ import annotations

import math

import pytest
import torch

from sampling_scenes import front, ring, soup, triangle, wall
from torchrender.buffers import DepthImages
from torchrender.depth.options import METHODS, SamplingOptions
from torchrender.depth.probes import Probes, pixel_redundant
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.sample import sample_depth_images
from torchrender.depth.sampling_metrics import SamplingMetricOptions, sampling_metrics
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

PIXEL = SamplingOptions()
VISIBLE = SamplingOptions(redundancy="visibility")
MODES = pytest.mark.parametrize("options", [PIXEL, VISIBLE], ids=["pixel", "visibility"])
ALL = pytest.mark.parametrize("method", METHODS)


def clean(images: DepthImages) -> DepthImages:
    for name in ("barycentric", "position", "normal", "color"):
        assert bool(torch.isfinite(getattr(images, name)).all()), name
    assert not bool(torch.isnan(images.depth).any())
    assert torch.equal(images.covered, torch.isfinite(images.depth))
    return images


def judge(scene: Scene, camera: Cameras, probes: Probes) -> tuple[bool, bool]:
    image = rasterize_visibility(scene.geometry, camera, cull="back")
    pixel = pixel_redundant(probes, FragmentTests(earlier=image), scene.geometry)
    rays = RayVisibility(scene, VISIBLE).seen(probes.points(), probes.triangle, camera)
    return bool(pixel[0]), bool(rays[0])


@pytest.mark.parametrize("back", [0.0, 1.0, 2.0, 2.0 - 1e-12, 3.0])
def test_points_behind_or_on_the_near_plane_are_not_redundant(back: float) -> None:
    # The wall stands at depth 2 of the probing camera; the other camera stands before, in, or behind it.
    scene = soup(wall(2.0))
    probes = Probes(front(8), torch.tensor([[4, 4]]), torch.tensor([2.0]), torch.tensor([0]))
    near = 0.5
    verdict = judge(scene, front(8, eye=(0.0, 0.0, -back), near=near), probes)
    assert verdict == ((True, True) if back < 1.4 else (False, False))


@pytest.mark.parametrize(("shift", "inside"), [(0.0, True), (-0.25, True), (-0.5625, False), (-0.75, False)])
def test_the_right_border_is_outside(shift: float, inside: bool) -> None:
    # Pixel 7 of the probing camera has its centre at u = 7.5; the shift moves that in pixels of the other camera.
    scene = soup(wall(1.0))
    probes = Probes(front(8), torch.tensor([[7, 4]]), torch.tensor([1.0]), torch.tensor([0]))
    camera = front(8)
    k = camera.intrinsics.clone()
    k[:, 0, 2] -= shift
    moved = type(camera)(camera.camera_from_world, k, 8, 8, camera.near, camera.far)
    assert judge(scene, moved, probes)[1] == inside
    k[:, 0, 2] = camera.intrinsics[:, 0, 2] + 0.5  # exactly u = 8: half-open
    assert judge(scene, type(camera)(camera.camera_from_world, k, 8, 8, camera.near, camera.far), probes) == (
        False,
        False,
    )


@MODES
def test_grazing_triangles_do_not_repeat(options: SamplingOptions) -> None:
    # A long triangle almost along the view: stepping by eps alone would meet it again and again.
    sliver = [(-0.5, -0.001, -0.5), (0.5, -0.001, -0.5), (0.0, -0.0010001, -400.0)]
    scene = soup(sliver, wall(500.0, half=400.0))
    images = clean(sample_depth_images(scene, front(33)[[0, 0, 0]], options))
    assert int(images.layer.max()) <= 2
    assert not bool(images.truncated.any())


@MODES
def test_coplanar_duplicates_are_one_surface(options: SamplingOptions) -> None:
    # Three copies of the near wall under other ids, then the far wall: view 1 must look behind all of them.
    scene = soup(wall(1.0), wall(1.0), wall(1.0 + 1e-7), wall(2.0))
    images = clean(sample_depth_images(scene, front(15)[[0, 0]], options))
    assert bool((images.triangle[0] // 2 == 0).all())  # the lowest id wins
    assert bool((images.triangle[1] // 2 == 3).all())
    layers = sample_depth_images(scene, front(15)[[0, 0]], SamplingOptions(method="depth_peeling"))
    assert bool((layers.triangle[1] // 2 == 3).all())


def test_unequal_copies_that_touch_a_known_surface_do_not_send_the_search_in_circles() -> None:
    # Image 0 knows the first wall. The two others round to one float32 depth, with the higher id a hair in front: each
    # lies behind the other by one of the two measures.
    scene = soup(wall(1.0), wall(1.0 + 4e-8), wall(1.0 + 2e-8), wall(1.0 + 3e-8), wall(2.0))
    for options in (SamplingOptions(), SamplingOptions(max_skips=2), SamplingOptions(pixel_test="captured")):
        images = clean(sample_depth_images(scene, front(15)[[0, 0, 0]], options))
        assert bool(((images.triangle[1] // 2 == 4) | images.truncated[1]).all())
        assert not bool(images.truncated[1].any()) or options.max_skips == 2


@MODES
def test_shared_edges_and_t_junctions_use_up_no_layer(options: SamplingOptions) -> None:
    # A quad of one large and two small triangles that meet in a T-junction on the diagonal, through pixel centres.
    a, b, c, d, m = (-1.0, -1.0, -2.0), (1.0, -1.0, -2.0), (1.0, 1.0, -2.0), (-1.0, 1.0, -2.0), (0.0, 0.0, -2.0)
    scene = soup([a, b, c], [a, m, d], [m, c, d], wall(4.0))
    layers = sample_depth_images(scene, front(16)[[0, 0]], SamplingOptions(method="depth_peeling"))
    inside = layers.triangle[0] < 3
    assert int(inside.sum()) == 256
    assert bool((layers.triangle[1] >= 3).all())
    images = clean(sample_depth_images(scene, front(16)[[0, 0]], options))
    assert bool((images.triangle[1] >= 3).all())


@ALL
@MODES
def test_degenerate_triangles_are_ignored_and_ids_kept(method: str, options: SamplingOptions) -> None:
    point, line = [(0.1, 0.1, -1.0)] * 3, [(-1.0, 0.0, -1.0), (0.0, 0.0, -1.0), (1.0, 0.0, -1.0)]
    tiny = [(1e-9 * x, 1e-9 * y, -0.5) for x, y in ((0, 0), (1, 0), (0, 1))]
    scene = soup(point, line, tiny, wall(2.0))
    images = clean(
        sample_depth_images(scene, front(9)[[0, 0]], SamplingOptions(method=method, redundancy="visibility"))
    )
    pixel = clean(sample_depth_images(scene, front(9)[[0, 0]], SamplingOptions(method=method)))
    for found in (images, pixel):
        assert bool((found.triangle[0] >= 3).all())
    del options


@ALL
@MODES
def test_viewpoints_inside_and_on_surfaces(method: str, options: SamplingOptions) -> None:
    scene = soup(wall(0.0), wall(0.005), wall(1.0), wall(2.0))
    near = 0.01
    cameras = front(12, near=near)[[0, 0]]
    images = clean(sample_depth_images(scene, cameras, SamplingOptions(method=method, redundancy=options.redundancy)))
    assert float(images.depth.min()) > near
    assert bool((images.triangle[0] // 2 == 2).all())


@MODES
def test_fully_redundant_images_are_empty_and_measurable(options: SamplingOptions) -> None:
    scene, cameras = soup(wall(1.0, centre=(0.013, 0.0))), front(16)[[0, 0, 0]]
    images = clean(sample_depth_images(scene, cameras, options))
    assert not bool(images.covered[1:].any())
    assert bool((images.layer[1:] == 1).all())
    metrics = sampling_metrics(scene, cameras, [images], SamplingMetricOptions(frames=3))[0]
    assert [s.value for s in metrics.redundant] == [0.0, None, None]
    assert metrics.least_available == 1.0


@ALL
@MODES
@pytest.mark.parametrize("count", [1, 16])
def test_one_and_sixteen_cameras(method: str, options: SamplingOptions, count: int) -> None:
    scene = build("nest", triangles=3000)
    chosen = SamplingOptions(method=method, redundancy=options.redundancy)
    images = clean(sample_depth_images(scene, ring(scene, 12, count=count), chosen))
    assert len(images) == count
    assert bool(images.covered[0].any())
    if method != "conventional" and count == 16:
        assert int(images.covered[15].sum()) < int(images.covered[0].sum()) // 2


@MODES
def test_giving_up_is_told(options: SamplingOptions) -> None:
    # Six walls, two looks: the third identical view finds two redundant walls and gives up.
    scene = soup(*(wall(float(d), centre=(0.013, 0.0)) for d in range(1, 7)))
    chosen = SamplingOptions(redundancy=options.redundancy, max_skips=2)
    images = clean(sample_depth_images(scene, front(8)[[0, 0, 0]], chosen))
    assert bool(images.covered[:2].all())
    assert not bool(images.truncated[:2].any())
    assert bool(images.truncated[2].all())
    assert not bool(images.covered[2].any())
    assert bool((images.layer[2] >= 2).all())


@ALL
@MODES
def test_far_from_the_origin(method: str, options: SamplingOptions) -> None:
    """A scene a million units away samples as it does at home."""
    shift = torch.tensor([1e6, -2e6, 5e5], dtype=torch.float64)
    here = soup(triangle(1.0, (2.0, 2.0), (6.0, 2.5), (3.0, 6.0)), wall(2.0, centre=(0.013, 0.0)))
    moved = here.geometry.vertices + shift
    there = soup([tuple(p) for p in moved.tolist()])
    chosen = SamplingOptions(method=method, redundancy=options.redundancy)
    eyes = [(0.0, 0.0, 0.0), (0.05, 0.02, 0.0)]
    home = Cameras.cat([front(16, eye=e) for e in eyes])
    away = Cameras.cat([front(16, eye=(torch.tensor(e, dtype=torch.float64) + shift).tolist()) for e in eyes])
    a, b = sample_depth_images(here, home, chosen), clean(sample_depth_images(there, away, chosen))
    assert float((a.triangle != b.triangle).double().mean()) < 0.01
    both = (a.triangle == b.triangle) & a.covered
    torch.testing.assert_close(a.depth[both], b.depth[both], rtol=1e-5, atol=1e-5)


@ALL
@MODES
def test_an_empty_scene(method: str, options: SamplingOptions) -> None:
    chosen = SamplingOptions(method=method, redundancy=options.redundancy)
    images = clean(sample_depth_images(soup(), front(8)[[0, 0]], chosen))
    assert not bool(images.covered.any())
    assert not bool(images.truncated.any())


def test_surfaces_edge_on_to_an_earlier_view() -> None:
    """A plane through the eye of the earlier view: footprints there are infinite, nothing divides by zero."""
    floor = [(-3.0, 0.0, -1.0), (3.0, 0.0, -1.0), (0.0, 0.0, -9.0)]
    scene = soup(floor, wall(20.0))
    level = front(17)
    above = Cameras.look_at((0.0, 3.0, 0.0), (0.0, 0.0, -4.0), width=17, height=17, fov_deg=53.13010235415598)
    for extra in ({"quality_ratio": 4.0}, {"pixel_test": "depth_identity"}):
        images = clean(sample_depth_images(scene, Cameras.cat([level, above]), SamplingOptions(**extra)))
        assert bool((images.triangle[1] == 0).any())
    assert math.isfinite(float(images.position.abs().max()))
