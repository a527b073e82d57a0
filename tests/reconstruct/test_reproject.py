"""Reprojection: pictures and validity from new viewpoints."""

from __future__ import annotations

import gc
import math
import warnings
import weakref

import pytest
import torch

from depth_scenes import both, depth_images, empty_image, front_camera, keep_pixels, psnr, wall, wave
from torchrender.depth.options import SamplingOptions
from torchrender.depth.sample import sample_depth_images
from torchrender.errors import ColorWarning, InputError, OptionError
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.reconstruct import corners
from torchrender.reconstruct.corners import ReconstructOptions, fit_corners
from torchrender.reconstruct.reproject import ReprojectOptions, reproject
from torchrender.scene import shapes
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

SIZE = 96


def colored(mesh: Mesh, shift: list[float], flat: tuple[float, float, float] | None = None) -> Mesh:
    vertices = mesh.vertices.double() + torch.tensor(shift, dtype=torch.float64)
    colors = wave(vertices) if flat is None else torch.tensor(flat).expand(len(vertices), 3)
    return Mesh(vertices=vertices, faces=mesh.faces, colors=colors)


def room() -> Scene:
    """A ball and a box before a wall and above a floor, in smooth colours."""
    floor = shapes.plane(torch.tensor([12.0, 12.0]), 24)
    back = shapes.quad(torch.tensor([-6.0, -1, -4]), torch.tensor([12.0, 0, 0]), torch.tensor([0.0, 7, 0]))
    return Scene(
        meshes=(
            colored(shapes.sphere(0.7, 64), [0.5, 0.0, -0.5]),
            colored(shapes.box(torch.tensor([0.8, 1.4, 0.8])), [-1.2, -0.3, 0.2], (0.8, 0.3, 0.1)),
            colored(floor, [0.0, -1.0, 0.0]),
            colored(back, [0.0, 0.0, 0.0], (0.2, 0.5, 0.7)),
        )
    )


def around(*shifts: float, size: int = SIZE) -> Cameras:
    return Cameras.look_at(
        [[s, 0.8, 5.0] for s in shifts], [0.0, 0.0, 0.0], width=size, height=size, fov_deg=40.0, near=0.01
    )


@pytest.mark.parametrize("color_filter", ["bilinear", "nearest"])
@pytest.mark.parametrize("method", ["hybrid", "grid", "splat"])
def test_colours_have_gradients_and_the_same_values(method: str, color_filter: str) -> None:
    """The torch twin shows what the kernel shows, pinholes included; it is linear, so one difference is exact."""
    images = depth_images(room(), around(-0.3, 0.4, size=48))
    options = ReprojectOptions(method=method, color_filter=color_filter)
    target = around(0.1, 0.9, size=40)
    wanted = reproject(images, target, options=options)
    colors = images.color.double().requires_grad_()
    found = reproject(images, target, colors=colors, options=options)
    torch.testing.assert_close(found.color, wanted.color, atol=2e-6, rtol=0)
    assert torch.equal(found.valid, wanted.valid) and torch.equal(found.source, wanted.source)
    asked = torch.rand(found.color.shape, generator=torch.Generator().manual_seed(1))
    (gradient,) = torch.autograd.grad((found.color * asked).double().sum(), colors)
    step = torch.rand(colors.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    moved = reproject(images, target, colors=(colors + step).detach(), options=options)
    change = ((moved.color.double() - wanted.color.double()) * asked).sum()
    assert float((gradient * step).sum()) == pytest.approx(float(change), rel=1e-4)
    assert not wanted.color.requires_grad and int(wanted.valid.sum()) > 500


@pytest.mark.parametrize("method", ["hybrid", "grid", "splat"])
def test_the_same_camera_gives_the_same_picture(method: str) -> None:
    images = depth_images(room(), around(0.0))
    result = reproject(images, images.cameras, method=method)
    if method == "hybrid":
        assert torch.equal(result.valid, images.covered)
        assert bool(
            ((result.depth - images.depth).abs() <= 2 * images.cameras.footprint(images.depth))[result.valid].all()
        )
    assert float(result.valid.float().mean()) > 0.9
    assert not bool((result.valid & ~images.covered).any()) or method == "splat"
    floor = 25.0 if method == "splat" else 50.0  # discs reach over their neighbours, also at outlines
    assert psnr(result.color, images.color, result.valid & images.covered) >= floor


def test_a_tilted_plane_lands_where_geometry_says() -> None:
    scene = Scene(meshes=(wall(-5.0, tilt_deg=35.0),))
    images = depth_images(scene, front_camera(SIZE))
    camera = front_camera(70, eye=(0.4, -0.3, -0.8), fov_deg=35.0)
    result = reproject(images, camera)
    truth = rasterize(scene, camera)
    assert bool(result.valid.all())
    assert float((result.depth / truth.depth - 1).abs().max()) < 1e-4
    # Vertex colours are linear on the large triangle, so bilinear lookup is exact up to the perspective.
    assert psnr(result.color, truth.color, result.valid) > 45.0
    assert bool((result.source == 0).all())


def test_disocclusions_are_invalid_and_nothing_else() -> None:
    scene, cameras, target = room(), around(0.0), around(0.8)
    images = depth_images(scene, cameras)
    result = reproject(images, target)
    truth = rasterize(scene, target, cull="back")
    points = truth.position[truth.covered]
    eye = cameras.eye[0].expand_as(points)
    hidden = RayCaster(scene.geometry).occluded(eye, points - eye, t_max=1.0 - 1e-4)
    pixel, _ = cameras.project(points[None])
    inside = ((pixel[0] > 1) & (pixel[0] < SIZE - 1)).all(1)
    seen = torch.zeros_like(truth.covered)
    seen[truth.covered] = inside & ~hidden
    covered_hidden = torch.zeros_like(truth.covered)
    covered_hidden[truth.covered] = inside & hidden
    # Half a pixel at depth edges, where a sample stands for its whole pixel, may go either way.
    edges = torch.nn.functional.max_pool2d((~seen).float()[:, None], 3, 1, 1)[:, 0] > 0
    assert int((seen & ~edges).sum()) > 3000 and int(covered_hidden.sum()) > 200
    # Slivers seen at less than a pixel's width have no sample.
    assert float(result.valid[seen & ~edges].float().mean()) > 0.999
    false_claims = result.valid & covered_hidden
    right_depth = (result.depth - truth.depth).abs() <= 3 * target.footprint(truth.depth)
    inner = torch.nn.functional.max_pool2d((~covered_hidden).float()[:, None], 3, 1, 1)[:, 0] == 0
    assert float((false_claims & inner & right_depth).sum()) / max(int(inner.sum()), 1) < 0.1


def test_a_new_view_looks_like_the_real_one() -> None:
    scene, target = room(), around(0.1)
    images, offset = both(scene, around(-0.5, 0.0, 0.5))
    truth = rasterize(scene, target, cull="back")
    for shifted in (offset, None):
        result = reproject(images, target, offset_images=shifted)
        counted = result.valid & truth.covered
        assert float(counted.sum()) / float(truth.covered.sum()) > 0.98
        right = counted & ((result.depth - truth.depth).abs() < 2 * target.footprint(truth.depth))
        assert float(right.sum()) / float(counted.sum()) > 0.985
        assert psnr(result.color, truth.color, right) > 35.0
        assert psnr(result.color, truth.color, counted) > 28.0


def test_colour_filters() -> None:
    scene = Scene(meshes=(wall(-5.0, tilt_deg=20.0),))
    images = depth_images(scene, front_camera(24))
    camera = front_camera(96, fov_deg=20.0)
    truth = rasterize(scene, camera).color
    smooth = reproject(images, camera)
    flat = reproject(images, camera, options=ReprojectOptions(color_filter="nearest"))
    samples = {tuple(c) for c in images.color.reshape(-1, 3).tolist()}
    assert all(tuple(c) in samples for c in flat.color.reshape(-1, 3).tolist())
    error = [float((p.color - truth).abs().mean()) for p in (smooth, flat)]
    assert error[0] < 0.3 * error[1]


def test_bilinear_colours_never_mix_two_surfaces() -> None:
    near, far = wall(-3.0, right=0.0), wall(-6.0)
    paint = [torch.tensor([1.0, 0, 0]), torch.tensor([0.0, 0, 1.0])]
    meshes = [Mesh(vertices=m.vertices, faces=m.faces, colors=p.expand(4, 3)) for m, p in zip((near, far), paint)]
    images = depth_images(Scene(meshes=tuple(meshes)), front_camera(32))
    for method in ("hybrid", "grid"):
        result = reproject(images, front_camera(128, eye=(0.3, 0.1, 0.2)), method=method)
        pure = ((result.color - paint[0]).abs().amax(-1) < 1e-6) | ((result.color - paint[1]).abs().amax(-1) < 1e-6)
        assert bool(pure[result.valid].all())
        assert not bool(result.color[~result.valid].any())


def test_surfaces_seen_from_behind_are_not_drawn() -> None:
    images = depth_images(Scene(meshes=(wall(-3.0),)), front_camera(16))
    behind = Cameras.look_at([0.0, 0.0, -6.0], [0.0, 0.0, 0.0], width=16, height=16, near=0.01)
    for method in ("hybrid", "grid", "splat"):
        result = reproject(images, behind, method=method)
        assert not bool(result.valid.any())
        assert bool(torch.isinf(result.depth).all()) and bool((result.source == -1).all())


def test_batches_equal_single_views_and_fitted_quads_can_be_reused() -> None:
    images, offset = both(room(), around(-0.4, 0.4))
    targets = around(-0.2, 0.0, 0.3, size=40)
    together = reproject(images, targets, offset_images=offset)
    quads = fit_corners(images, offset)
    for k in range(3):
        alone = reproject(quads, targets[k])
        for name in ("color", "depth", "valid", "source"):
            assert torch.equal(getattr(together, name)[k], getattr(alone, name)[0]), name
    assert {0, 1} <= set(together.source.unique().tolist())


def test_the_earlier_of_equal_images_wins_and_order_of_threads_does_not_matter() -> None:
    images = depth_images(room(), around(0.0, 0.0, 0.0))
    first = reproject(images, around(0.3))
    assert bool((first.source[first.valid] == 0).all())
    for _ in range(3):
        again = reproject(images, around(0.3))
        assert torch.equal(again.color, first.color) and torch.equal(again.depth, first.depth)


def test_an_empty_image_and_empty_sets() -> None:
    images = empty_image(depth_images(room(), around(0.0, 0.2)), 0)
    for method in ("hybrid", "grid", "splat"):
        result = reproject(images, around(0.2), method=method)
        assert bool((result.source[result.valid] == 1).all()) and bool(result.valid.any())
        nothing = reproject(
            empty_image(empty_image(depth_images(room(), around(0.0, 0.2)), 0), 1), around(0.1), method=method
        )
        assert not bool(nothing.valid.any()) and not bool(nothing.color.any())


def test_colours_may_be_given() -> None:
    images = depth_images(room(), around(0.0))
    paint = torch.full((1, SIZE, SIZE, 3), 0.25)
    result = reproject(images, around(0.1), colors=paint)
    assert float((result.color[result.valid] - 0.25).abs().max()) < 1e-6
    with pytest.raises(InputError, match="colors"):
        reproject(images, around(0.1), colors=paint[..., :2])


def test_no_cracks_on_a_curved_surface_seen_closer() -> None:
    """Every pixel well inside the outline is covered, though quads grow to several pixels."""
    ball = Scene(meshes=(colored(shapes.sphere(1.0, 256), [0.0, 0.0, -4.0]),))
    images, offset = both(ball, front_camera(64, fov_deg=40.0))
    target = front_camera(160, eye=(0.1, 0.05, -1.0), fov_deg=40.0)
    for shifted in (offset, None):
        result = reproject(images, target, offset_images=shifted)
        centre = torch.tensor([0.0, 0.0, -4.0], dtype=torch.float64)
        truth = rasterize(ball, target, cull="back")
        toward = torch.nn.functional.normalize(images.cameras.eye[0] - truth.position, dim=-1)
        outward = torch.nn.functional.normalize(truth.position - centre, dim=-1)
        inner = truth.covered & ((toward * outward).sum(-1) > math.cos(math.radians(70.0)))
        assert int(inner.sum()) > 5000
        assert bool(result.valid[inner].all())


def test_what_is_refused() -> None:
    images = depth_images(room(), around(0.0))
    with pytest.raises(OptionError, match="method"):
        reproject(images, around(0.1), method="points")
    with pytest.raises(InputError, match="quads of another method"):
        reproject(fit_corners(images), around(0.1), method="grid")
    with pytest.raises(OptionError, match="splat_scale"):
        ReprojectOptions(splat_scale=5.0)
    alone = torch.zeros(1, SIZE, SIZE, dtype=torch.bool)
    assert not bool(reproject(keep_pixels(images, alone), around(0.1)).valid.any())


def test_the_nearest_camera_goes_first_where_images_agree() -> None:
    images = depth_images(room(), around(-0.5, 0.5))
    paint = torch.zeros(2, SIZE, SIZE, 3)
    paint[1] = 1.0
    left, right = (reproject(images, around(x), colors=paint) for x in (-0.4, 0.4))
    seen_by_both = slice(SIZE // 4, 3 * SIZE // 4)
    for result, first in ((left, 0), (right, 1)):
        share = (result.source[0, :, seen_by_both] == first).float().mean()
        assert float(share) > 0.9
    truth = rasterize(room(), around(0.4), cull="back")
    known = right.valid & truth.covered & (right.source == 0)
    near = (right.depth - truth.depth).abs()[known] <= 2 * around(0.4).footprint(truth.depth)[known]
    assert float(near.float().mean()) > 0.8  # the lead is taken out of the depth again


def test_quads_are_fitted_once_for_images_that_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kept with the images, for these options; fitted again after a change in place; gone with the images."""
    made: list[int] = []
    fit = corners.fit_corners
    monkeypatch.setattr(corners, "fit_corners", lambda *a, **k: made.append(1) or fit(*a, **k))
    images = depth_images(Scene(meshes=(wall(-4.0, tilt_deg=30.0),)), front_camera(12))
    view = front_camera(12, eye=(0.1, 0.0, 0.0))
    first, again = reproject(images, view), reproject(images, view)
    assert len(made) == 1 and torch.equal(first.color, again.color) and torch.equal(first.depth, again.depth)
    reproject(images, view, options=ReprojectOptions(reconstruct=ReconstructOptions(guess_ratio=1.3)))
    assert len(made) == 2
    images.depth.mul_(1.5)
    farther = reproject(images, view)
    assert len(made) == 3 and bool((farther.depth > 1.2 * first.depth)[first.valid & farther.valid].all())
    gone = weakref.ref(images)
    del images
    gc.collect()
    assert gone() is None


def test_images_without_colours_are_told_of() -> None:
    scene, camera = room(), front_camera(SIZE)
    plain = sample_depth_images(scene, camera)
    with pytest.warns(ColorWarning, match="hold no colours, so all is black: sample them with shade=True"):
        reproject(plain, camera)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ColorWarning)
        reproject(sample_depth_images(scene, camera, SamplingOptions(shade=True)), camera)
        reproject(plain, camera, colors=torch.ones(*plain.depth.shape, 3))
