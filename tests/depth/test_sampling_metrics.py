"""Metrics of depth images: closed cases, laws, and agreement of the two redundancies as resolution grows."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from sampling_scenes import front, ring, soup, wall
from torchrender.depth.kinds import median_triangle_pixels, sample_kinds
from torchrender.depth.options import METHODS, SamplingOptions
from torchrender.depth.picture import COLORS, kinds_picture
from torchrender.depth.sample import sample_depth_images
from torchrender.depth.sampling_metrics import SamplingMetricOptions, SamplingMetrics, Share, sampling_metrics
from torchrender.depth.viewpoints import cameras_between, halton, viewpoints_inside
from torchrender.errors import InputError, OptionError
from torchrender.numerics.color import linear_from_srgb
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

PIXEL = SamplingOptions()
VISIBLE = SamplingOptions(redundancy="visibility")
FEW = SamplingMetricOptions(frames=4, stride=2)


@pytest.fixture(scope="module")
def nest() -> Scene:
    return build("nest", triangles=3000)


def measure(
    scene: Scene, cameras: Cameras, options: SamplingOptions, metrics: SamplingMetricOptions
) -> list[SamplingMetrics]:
    """Conventional, non-redundant, depth peeling."""
    methods = ("conventional", "nonredundant", "depth_peeling")
    sets = [sample_depth_images(scene, cameras, replace(options, method=m)) for m in methods]
    return sampling_metrics(scene, cameras, sets, metrics)


@pytest.mark.parametrize("options", [PIXEL, VISIBLE], ids=["pixel", "visibility"])
def test_laws(nest: Scene, options: SamplingOptions) -> None:
    conventional, nonredundant, peeling = measure(nest, ring(nest, 64), options, FEW)
    assert all(share.value == 0 for share in conventional.hidden)
    assert all(share.value is None for share in conventional.useful)
    assert all(share.value == 0 for share in nonredundant.redundant)
    assert all(share.value is not None and share.value < 0.05 for share in peeling.redundant)
    assert conventional.redundant[0].value == 0
    assert conventional.redundant[2].value is not None
    assert conventional.redundant[2].value > 0.3
    for m in (conventional, nonredundant, peeling):
        assert len(m.available) == 4
        assert m.mean_available.value is not None
        assert m.least_available is not None
        assert 0 < m.least_available <= m.mean_available.value <= 1
        assert all(0 <= share.value <= 1 for share in (*m.filled, *m.hidden_of_all))
    assert nonredundant.hidden[2].value is not None
    assert nonredundant.hidden[2].value > 0.1


def test_visible_availability_is_best_for_nonredundant_images(nest: Scene) -> None:
    conventional, nonredundant, peeling = measure(
        nest, ring(nest, 64), VISIBLE, SamplingMetricOptions(frames=6, stride=2)
    )
    assert nonredundant.mean_available.value > conventional.mean_available.value
    assert nonredundant.least_available > peeling.least_available


def test_everything_of_two_walls() -> None:
    # Three identical views of two walls: conventional images repeat, the second non-redundant image holds the far
    # wall, which no view between needs, and the third is empty.
    scene, cameras = soup(wall(1.0, centre=(0.013, 0.0)), wall(2.0, centre=(0.013, 0.0))), front(16)[[0, 0, 0]]
    for options in (PIXEL, VISIBLE):
        conventional, nonredundant, peeling = measure(scene, cameras, options, SamplingMetricOptions(frames=2))
        assert [s.value for s in conventional.redundant] == [0, 1, 1]
        for m in (nonredundant, peeling):
            assert [s.value for s in m.filled] == [1, 1, 0]
            assert [s.value for s in m.redundant] == [0, 0, None]
            assert [s.value for s in m.hidden] == [0, 1, None]
            assert [s.value for s in m.hidden_of_all] == [0, 1, 0]
            assert [s.value for s in m.useful] == [None, 0, None]
            assert m.available == (1.0, 1.0)


def test_an_empty_scene_has_no_shares() -> None:
    empty = soup()
    for options in (PIXEL, VISIBLE):
        for m in measure(empty, front(8)[[0, 0]], options, SamplingMetricOptions(frames=2)):
            assert all(s.value is None for s in (*m.redundant, *m.hidden, *m.useful))
            assert all(s.value == 0 for s in m.filled)
            assert m.available == ()
            assert m.mean_available.value is None
            assert m.least_available is None


def test_pixel_metrics_approach_visibility_metrics() -> None:
    scene = build("nest", triangles=3000)
    cameras = ring(scene, 64)
    wanted = measure(scene, cameras, VISIBLE, SamplingMetricOptions(frames=2))[0].redundant[2].value
    gaps = []
    for size in (32, 64, 128, 256):
        got = measure(scene, cameras.scaled(size / 64), PIXEL, SamplingMetricOptions(frames=1))[0].redundant[2].value
        assert got is not None
        assert wanted is not None
        gaps.append(abs(got - wanted))
    assert gaps[0] > gaps[1] > gaps[2] > gaps[3]


def test_standard_error_of_a_share() -> None:
    assert Share.of(0, 0) == Share(None, 0.0, 0)
    share = Share.of(25, 100)
    assert share.value == 0.25
    assert share.error == pytest.approx(math.sqrt(0.25 * 0.75 / 100))
    generator = torch.Generator().manual_seed(0)
    draws = (torch.rand(2000, 100, generator=generator) < 0.25).double().mean(dim=1)
    assert float(draws.std()) == pytest.approx(share.error, rel=0.1)


def test_halton_points() -> None:
    assert halton(4, 2).tolist() == [0.5, 0.25, 0.75, 0.125]
    torch.testing.assert_close(halton(3, 3), torch.tensor([1 / 3, 2 / 3, 1 / 9], dtype=torch.float64))
    assert torch.equal(halton(10, 2)[4:], halton(6, 2, first=5))


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6])
def test_views_between_lie_between(count: int) -> None:
    scene = build("nest", triangles=3000)
    cameras = ring(scene, 16, count=count)
    views = viewpoints_inside(cameras, 40)
    low, high = cameras.eye.amin(dim=0), cameras.eye.amax(dim=0)
    assert bool(((views.eye >= low - 1e-9) & (views.eye <= high + 1e-9)).all())
    identity = views.rotation @ views.rotation.transpose(1, 2)
    torch.testing.assert_close(identity, torch.eye(3, dtype=torch.float64).expand_as(identity))
    assert bool((torch.linalg.det(views.rotation) > 0.99).all())
    if count >= 2:
        spread = views.eye.std(dim=0).norm() / cameras.eye.std(dim=0).norm()
        assert 0.2 < float(spread) < 1.0
    corners = cameras_between(cameras, torch.eye(count))
    torch.testing.assert_close(corners.camera_from_world, cameras.camera_from_world)


def test_views_between_three_fill_their_triangle() -> None:
    eyes = torch.tensor([[0.0, 0.0, 3.0], [1.0, 0.0, 3.0], [0.2, 0.9, 3.2]], dtype=torch.float64)
    cameras = Cameras.cat([Cameras.look_at(eye, (0.0, 0.0, 0.0), width=8, height=8) for eye in eyes.tolist()])
    found = viewpoints_inside(cameras, 200).eye
    weights = torch.linalg.lstsq(
        torch.cat([eyes.T, torch.ones(1, 3)]), torch.cat([found.T, torch.ones(1, 200)])
    ).solution
    assert float(weights.min()) >= -1e-9
    torch.testing.assert_close(weights.mean(dim=1), torch.full((3,), 1 / 3, dtype=torch.float64), atol=0.02, rtol=0)
    assert float(weights.amax(dim=1).min()) > 0.85


def test_means_of_any_orientations_are_rotations() -> None:
    """A mean of turns by half about three axes is a reflection, or near one: the nearest turn is asked for."""
    generator = torch.Generator().manual_seed(2)
    some = torch.linalg.qr(torch.randn(12, 3, 3, generator=generator, dtype=torch.float64)).Q
    some = some * torch.linalg.det(some).sign()[:, None, None]
    halves = torch.stack([torch.diag(torch.tensor(d)) for d in ((1.0, -1, -1), (-1.0, 1, -1), (-1.0, -1, 1))]).double()
    for rotations in (halves, *some.split(3)):
        one = Cameras.look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), width=8, height=8)
        matrix = torch.eye(4, dtype=torch.float64).repeat(3, 1, 1)
        matrix[:, :3, :3] = rotations
        cameras = replace(Cameras.cat([one] * 3), camera_from_world=matrix)
        found = cameras_between(cameras, torch.tensor([[0.3, 0.36, 0.34], [0.8, 0.1, 0.1]])).rotation
        torch.testing.assert_close(found @ found.transpose(1, 2), torch.eye(3, dtype=torch.float64).expand(2, 3, 3))
        torch.testing.assert_close(torch.linalg.det(found), torch.ones(2, dtype=torch.float64))


def test_orientations_that_cancel_out_still_give_a_camera() -> None:
    eye, ahead = (0.0, 0.0, 0.0), ((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
    cameras = Cameras.cat([Cameras.look_at(eye, target, width=8, height=8) for target in ahead])
    middle = cameras_between(cameras, torch.tensor([[0.5, 0.5]]))
    assert bool(torch.isfinite(middle.camera_from_world).all())
    assert float(torch.linalg.det(middle.rotation[0])) == pytest.approx(1.0)


def test_sets_must_agree(nest: Scene) -> None:
    cameras = ring(nest, 16)
    sets = [sample_depth_images(nest, cameras, o) for o in (PIXEL, VISIBLE)]
    with pytest.raises(InputError, match="redundancy"):
        sampling_metrics(nest, cameras, sets)
    other = sample_depth_images(nest, cameras, SamplingOptions(size=(8, 8)))
    with pytest.raises(InputError, match="size"):
        sampling_metrics(nest, cameras, [sets[0], other])
    with pytest.raises(InputError, match="at least one"):
        sampling_metrics(nest, cameras, [])
    with pytest.raises(OptionError, match="frames"):
        SamplingMetricOptions(frames=0)


@pytest.mark.parametrize("method", METHODS)
def test_pictures_show_the_kinds(nest: Scene, method: str) -> None:
    cameras = ring(nest, 48)
    images = sample_depth_images(nest, cameras, SamplingOptions(method=method))
    kinds = sample_kinds(nest, cameras, images, frames=5)
    assert not bool((kinds.redundant & kinds.hidden & (method == "conventional")).any())
    assert not bool((kinds.useful & ~kinds.hidden).any())
    assert not bool((kinds.hidden & ~images.covered).any())
    assert bool(kinds.redundant.any()) == (method == "conventional")
    assert bool(kinds.useful.any()) == (method != "conventional")
    picture = kinds_picture(images, kinds)
    assert tuple(picture.shape) == (3, 48, 48, 3)
    assert bool((picture[~images.covered] == 1).all())
    shades = {name: linear_from_srgb(torch.tensor(rgb)) for name, rgb in COLORS.items()}
    for name, mask in (("redundant", kinds.redundant), ("useful", kinds.useful)):
        pixels = picture[mask]
        assert bool((pixels.argmax(dim=-1) == int(shades[name].argmax())).all())


def test_metrics_agree_with_the_pictures(nest: Scene) -> None:
    cameras = ring(nest, 48)
    images = sample_depth_images(nest, cameras, PIXEL)
    kinds = sample_kinds(nest, cameras, images, frames=5)
    m = sampling_metrics(nest, cameras, [images], SamplingMetricOptions(frames=5))[0]
    for number in range(3):
        hidden = int(kinds.hidden[number].sum())
        assert m.hidden[number].value == pytest.approx(hidden / int(images.covered[number].sum()))
        if hidden:
            assert m.useful[number].value == pytest.approx(int(kinds.useful[number].sum()) / hidden)


def test_median_triangle_size() -> None:
    images = sample_depth_images(soup(wall(1.0, half=0.25)), front(32), PIXEL)
    assert median_triangle_pixels(soup(wall(1.0, half=0.25)), images) == pytest.approx(0.5 * 16 * 16)
    nothing = sample_depth_images(soup(), front(8), PIXEL)
    assert median_triangle_pixels(soup(), nothing) is None
