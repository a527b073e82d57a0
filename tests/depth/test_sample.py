"""Sets of depth images: the acceptance list of specification 01."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from sampling_scenes import front, ring, soup, wall
from torchrender.buffers import DepthImages
from torchrender.depth.holders import images_holder
from torchrender.depth.nonredundant import fragment_tests
from torchrender.depth.options import SamplingOptions
from torchrender.depth.peeling import central_camera
from torchrender.depth.probes import Probes, pixel_redundant
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.sample import sample_depth_images, sample_offset_images
from torchrender.depth.samples import some_views
from torchrender.depth.viewpoints import cameras_between
from torchrender.errors import InputError, OptionError
from torchrender.raster import FragmentTests, rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

PIXEL = SamplingOptions()
VISIBLE = SamplingOptions(redundancy="visibility")
PLAIN = SamplingOptions(redundancy="visibility", visibility_test="plain")
MODES = pytest.mark.parametrize("options", [PIXEL, VISIBLE], ids=["pixel", "visibility"])
FIELDS = ("depth", "triangle", "object_id", "barycentric", "position", "normal", "color", "layer", "truncated")


@pytest.fixture(scope="module")
def nest() -> Scene:
    return build("nest", triangles=3000)


def conventional(scene: Scene, images: DepthImages) -> DepthImages:
    return sample_depth_images(scene, images.cameras, SamplingOptions(method="conventional"))


def check_record(images: DepthImages) -> None:
    """Shapes and empty pixels as the record promises, nothing but numbers in it."""
    empty = ~images.covered
    shape = tuple(images.triangle.shape)
    assert all(tuple(getattr(images, name).shape[:3]) == shape for name in FIELDS)
    assert torch.equal(empty, torch.isinf(images.depth))
    assert bool((images.normal[empty] == 0).all())
    assert bool((images.position[empty] == 0).all())
    assert bool((images.object_id[empty] == -1).all())
    length = images.normal[images.covered].norm(dim=-1)
    torch.testing.assert_close(length, torch.ones_like(length))
    toward = images.cameras.eye[:, None, None] - images.position
    assert bool(((toward.float() * images.normal).sum(-1)[images.covered] > 0).all())
    assert bool(empty[images.truncated].all())
    assert all(bool(torch.isfinite(getattr(images, name)).all()) for name in ("position", "normal", "color"))


@pytest.mark.parametrize("method", ["conventional", "nonredundant", "depth_peeling"])
@MODES
def test_records_are_clean(nest: Scene, method: str, options: SamplingOptions) -> None:
    images = sample_depth_images(nest, ring(nest, 40), replace(options, method=method, shade=True))
    check_record(images)
    assert SamplingOptions(**images.parameters) == replace(options, method=method, shade=True)
    assert bool((images.color[images.covered].amax(-1) > 0).all())
    assert int(images.covered.sum()) > 500


@MODES
def test_image_zero_is_the_conventional_one(nest: Scene, options: SamplingOptions) -> None:
    images = sample_depth_images(nest, ring(nest, 40), options)
    first = conventional(nest, images)
    for name in FIELDS:
        assert torch.equal(getattr(images, name)[0], getattr(first, name)[0]), name


@pytest.mark.parametrize("options", [PIXEL, VISIBLE, PLAIN], ids=["pixel", "captured", "plain"])
def test_no_stored_sample_is_redundant(nest: Scene, options: SamplingOptions) -> None:
    images = sample_depth_images(nest, ring(nest, 40), options)
    rays = RayVisibility(nest, options) if options.redundancy == "visibility" else None
    for number in range(1, 3):
        probes = Probes.of(images, number)
        assert len(probes) > 50
        assert not bool(images_holder(nest, rays, images, number)(probes).any())


@MODES
def test_new_first_hits_are_kept(nest: Scene, options: SamplingOptions) -> None:
    images = sample_depth_images(nest, ring(nest, 40), options)
    first = conventional(nest, images)
    rays = RayVisibility(nest, options) if options.redundancy == "visibility" else None
    for number in (1, 2):
        probes = Probes.of(first, number)
        new = probes[~images_holder(nest, rays, images, number)(probes)]
        columns, rows = new.pixels.unbind(1)
        assert len(new) > 20
        assert torch.equal(images.triangle[number, rows, columns], new.triangle)
        assert torch.equal(images.depth[number, rows, columns], new.depth)
        assert bool((images.layer[number, rows, columns] == 0).all())


def test_one_pass_equals_algorithm_1(nest: Scene) -> None:
    """The rasterised pass against the loop of the specification: peel, test, go on behind what is redundant."""
    images = sample_depth_images(nest, ring(nest, 64), PIXEL)
    for number in (1, 2):
        camera, tests = images.cameras[number], fragment_tests(PIXEL, some_views(images, slice(number)))
        found = torch.full((64, 64), -1)
        open_pixels, layers = torch.ones(64, 64, dtype=torch.bool), torch.zeros(64, 64, dtype=torch.int32)
        peel = None
        for _ in range(64):
            layer = rasterize_visibility(nest.geometry, camera, cull="back", tests=peel)
            open_pixels &= layer.covered[0]
            probes = Probes.of(layer, 0)
            columns, rows = probes.pixels.unbind(1)
            redundant = torch.zeros(64, 64, dtype=torch.bool)
            redundant[rows, columns] = pixel_redundant(probes, tests, nest.geometry)
            store = open_pixels & ~redundant
            found[store] = layer.triangle[0][store]
            open_pixels &= redundant
            layers[open_pixels] += 1
            eps = PIXEL.relative_tolerance * layer.depth.double() + PIXEL.scene_tolerance * nest.diagonal
            peel = FragmentTests(beyond=layer.depth + eps, skip=layer.triangle)
        assert not bool(open_pixels.any())
        # Surfaces closer than eps_t that are no copies of each other may be told apart differently.
        assert float((found != images.triangle[number]).double().mean()) <= 1e-3
        assert float((layers != images.layer[number]).double().mean()) <= 5e-3


@pytest.mark.parametrize("method", ["nonredundant", "depth_peeling"])
@MODES
def test_order_of_triangles_does_not_matter(method: str, options: SamplingOptions) -> None:
    scene = build("city", triangles=2000)
    geometry = scene.geometry
    order = torch.randperm(geometry.triangle_count, generator=torch.Generator().manual_seed(3))
    plain, shuffled = (
        Scene(meshes=(Mesh(vertices=geometry.vertices, faces=geometry.faces.long()[rows]),))
        for rows in (torch.arange(len(order)), order)
    )
    cameras = ring(scene, 40)
    a, b = (sample_depth_images(s, cameras, replace(options, method=method)) for s in (plain, shuffled))
    torch.testing.assert_close(a.depth, b.depth, rtol=1e-6, atol=0)
    same = torch.where(b.covered, order[b.triangle.clamp_min(0)], -1) == a.triangle
    assert float((~same).double().mean()) < 1e-3  # equal depths go to the lower id


@MODES
def test_identical_viewpoints_peel(options: SamplingOptions) -> None:
    # The walls' diagonals pass no pixel centre: there rays and rasteriser may choose differently.
    scene, cameras = soup(wall(1.0, centre=(0.013, 0.0)), wall(2.0, centre=(0.013, 0.0))), front(16)[[0, 0]]
    images = sample_depth_images(scene, cameras, options)
    layers = sample_depth_images(scene, cameras, replace(options, method="depth_peeling"))
    assert bool(images.covered.all())
    for name in ("depth", "triangle", "layer"):
        assert torch.equal(getattr(images, name)[1], getattr(layers, name)[1]), name
    assert bool((images.triangle[1] // 2 == 1).all())


@MODES
def test_outside_earlier_frustums_nothing_is_redundant(options: SamplingOptions) -> None:
    scene = soup(wall(2.0))
    cameras = front(16)
    apart = front(16, eye=(5.0, 0.0, 0.0))
    images = sample_depth_images(scene, type(cameras).cat([cameras, apart]), options)
    assert torch.equal(images.triangle[1], conventional(scene, images).triangle[1])
    assert bool(images.covered.all())


@MODES
def test_runs_repeat_exactly(nest: Scene, options: SamplingOptions) -> None:
    cameras = ring(nest, 40)
    a, b = (sample_depth_images(nest, cameras, options) for _ in range(2))
    assert all(torch.equal(getattr(a, name), getattr(b, name)) for name in FIELDS)


@pytest.mark.parametrize("method", ["conventional", "nonredundant", "depth_peeling"])
@MODES
def test_offset_images_sit_on_pixel_corners(method: str, options: SamplingOptions) -> None:
    scene = soup(wall(1.0, half=0.2), wall(2.0))
    images = sample_depth_images(scene, front(16)[[0, 0]], replace(options, method=method))
    offset = sample_offset_images(scene, images)
    check_record(offset)
    assert tuple(offset.depth.shape) == (2, 17, 17)
    corners = (images.cameras.pixel_centres() - 0.5).expand(2, 16, 16, 2)
    torch.testing.assert_close(offset.cameras.rays()[1][:, :16, :16], images.cameras.rays(corners)[1])
    # Near the optical axis image 0 shows the small wall; image 1 the large one, or conventionally the small one again.
    assert int(offset.triangle[0, 7, 7]) // 2 == 0
    assert int(offset.triangle[1, 7, 7]) // 2 == (0 if method == "conventional" else 1)
    assert int(offset.triangle[0, 0, 0]) // 2 == 1


def test_offset_images_compare_with_the_images_themselves(nest: Scene) -> None:
    images = sample_depth_images(nest, ring(nest, 40), PIXEL)
    offset = sample_offset_images(nest, images)
    for number in (1, 2):
        tests = fragment_tests(PIXEL, some_views(images, slice(number)))
        assert not bool(pixel_redundant(Probes.of(offset, number), tests, nest.geometry).any())
    assert int(offset.covered[1].sum()) > 50


def test_peeled_layers_lie_behind_each_other(nest: Scene) -> None:
    options = SamplingOptions(method="depth_peeling", layers=5)
    layers = sample_depth_images(nest, ring(nest, 48), options)
    assert len(layers) == 5
    for number in range(1, 5):
        covered = layers.covered[number]
        assert bool(layers.covered[number - 1][covered].all())
        assert bool((layers.depth[number] > layers.depth[number - 1])[covered].all())
        assert bool((layers.layer[number][covered] == number).all())


def test_central_camera_looks_from_the_centroid(nest: Scene) -> None:
    cameras = ring(nest, 16)
    middle = central_camera(cameras)
    torch.testing.assert_close(middle.eye[0], cameras.eye.mean(dim=0))
    pixels, _ = middle.project(nest.bounds.mean(dim=0)[None])
    torch.testing.assert_close(pixels[0, 0], torch.tensor([8.0, 8.0], dtype=torch.float64), atol=0.05, rtol=0)


def test_better_copies_are_kept() -> None:
    # The floor is first seen at a grazing angle, then from above: only the quality-aware test samples it again.
    floor = [(x, -1.0, z) for x, z in ((-2, -8), (-2, 0), (2, 0), (-2, -8), (2, 0), (2, -8))]
    scene = soup(floor)
    camera = type(front()).look_at
    grazing = camera((0.0, -0.8, 2.0), (0.0, -0.99, -4.0), width=32, height=32, fov_deg=60)
    above = camera((0.0, 2.0, -4.0), (0.0, -1.0, -4.01), width=32, height=32, fov_deg=40)
    cameras = type(grazing).cat([grazing, replace(above, intrinsics=grazing.intrinsics)])
    plain = sample_depth_images(scene, cameras, PIXEL).covered[1].sum()
    better = sample_depth_images(scene, cameras, SamplingOptions(quality_ratio=4.0)).covered[1].sum()
    assert int(better) > int(plain) + 100


def test_depth_and_identity_drops_most_subpixel_repeats() -> None:
    scene = build("tree", triangles=20000)
    cameras = ring(scene, 64, spread=0.01)
    identity = sample_depth_images(scene, cameras, PIXEL).covered[1:].sum()
    agreeing = sample_depth_images(scene, cameras, SamplingOptions(pixel_test="depth_identity")).covered[1:].sum()
    assert int(agreeing) < 0.8 * int(identity)


def test_options_and_cameras_are_checked(nest: Scene) -> None:
    for bad, name in (
        ({"method": "x"}, "method"),
        ({"redundancy": "strict"}, "redundancy"),
        ({"max_skips": 0}, "max_skips"),
        ({"visibility_tolerance": 1.0}, "visibility_tolerance"),
        ({"relative_tolerance": 0.0}, "relative_tolerance"),
        ({"quality_ratio": 0.5}, "quality_ratio"),
        ({"size": (0, 4)}, "size"),
        ({"layers": 0}, "layers"),
    ):
        with pytest.raises(OptionError, match=name):
            SamplingOptions(**bad)
    with pytest.raises(InputError, match="at least one"):
        sample_depth_images(nest, front()[[]])
    flat = replace(front(), orthographic=True, far=torch.tensor([9.0]))
    with pytest.raises(InputError, match="perspective"):
        sample_depth_images(nest, flat)
    assert tuple(sample_depth_images(nest, front(), SamplingOptions(size=(20, 10))).depth.shape) == (1, 10, 20)


@pytest.mark.parametrize("pixel_test", ["identity", "captured"])
def test_without_layer_counts_the_samples_are_the_same(pixel_test: str) -> None:
    scene = build("tree", triangles=3000)
    cameras = ring(scene, 64)
    counted, quick = (
        sample_depth_images(scene, cameras, SamplingOptions(pixel_test=pixel_test, count_layers=count))
        for count in (True, False)
    )
    assert int(counted.layer.max()) > 0 and int(quick.layer.max()) == 0
    # Copies in the plane of a known surface, which only the count finds, are the only difference.
    assert float((counted.triangle != quick.triangle).double().mean()) < 2e-3
    assert bool((quick.depth <= counted.depth).all())


def copies(count: int) -> Scene:
    """A small wall so many times in one place before a large one."""
    return soup(*[wall(2.0, half=0.4)] * count, wall(4.0))


def test_coplanar_copies_of_what_is_known_are_passed_and_counted() -> None:
    """The first image holds one of three copies; the second sees past the others to what the first did not."""
    scene = copies(3)
    cameras = Cameras.cat([front(16), front(16, eye=(0.5, 0.0, 0.0))])
    images = sample_depth_images(scene, cameras, SamplingOptions(count_layers=True))
    new = images.triangle[1] >= 6  # of the large wall
    behind = rasterize_visibility(scene.geometry, cameras[1]).triangle[0] < 6
    seen = new & behind
    assert int(seen.sum()) > 3
    assert bool((images.layer[1][seen] == 3).all()), images.layer[1][seen].unique()


def test_more_copies_than_may_be_passed_are_told() -> None:
    cameras = Cameras.cat([front(16), front(16, eye=(0.5, 0.0, 0.0))])
    images = sample_depth_images(copies(6), cameras, SamplingOptions(count_layers=True, max_skips=2))
    behind = rasterize_visibility(copies(6).geometry, cameras[1]).triangle[0] < 12
    assert bool(images.truncated[1][behind].any()) and not bool(images.truncated[0].any())
    assert bool((images.triangle[1][images.truncated[1]] == -1).all())


def test_three_viewpoints_stand_as_far_apart_as_they_are_spread() -> None:
    scene = soup(wall(4.0, half=1.0), wall(6.0, half=1.0))
    eyes = ring(scene, 8, spread=0.3).eye
    for a, b in ((0, 1), (1, 2), (2, 0)):
        assert float((eyes[a] - eyes[b]).norm()) == pytest.approx(0.3 * scene.diagonal, rel=1e-9)


def test_a_camera_between_opposite_ones_is_no_mirror() -> None:
    """Turned half around each axis in turn: the mean matrix mirrors, the rotation nearest to it does not."""
    turns = torch.diag_embed(torch.tensor([[-1.0, -1, 1, 1], [1, -1, -1, 1], [-1, 1, -1, 1]], dtype=torch.float64))
    one = front(8)
    three = replace(Cameras.cat([one] * 3), camera_from_world=turns @ one.camera_from_world)
    found = cameras_between(three, torch.tensor([[0.3, 0.3, 0.4]], dtype=torch.float64))
    assert float(torch.linalg.det(found.rotation)[0]) == pytest.approx(1.0)
