"""Pictures of few pixels, scaled up along surfaces."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import torchrender as tr
from torchrender.buffers import VisibilityBuffer
from torchrender.effects.upsampling.joint import LEFT_OVER, OTHER_SURFACE, SAME_SURFACE, joint_upsampled
from torchrender.errors import InputError
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize_visibility
from torchrender.renderer import render
from torchrender.scene.camera import Cameras
from torchrender.scene.load import load
from torchrender.scene.model import Scene

MATERIALS = torch.zeros(9, dtype=torch.int64)


def seen(depth: Tensor, surface: Tensor | None = None) -> VisibilityBuffer:
    """Of one camera; ``surface`` is the object and its one triangle; the same everywhere unless given."""
    objects = torch.where(torch.isfinite(depth), 0 if surface is None else surface.long(), -1)[None]
    height, width = depth.shape
    return VisibilityBuffer(
        cameras=Cameras.look_at((0.0, 0.0, 3.0), (0.0, 0.0, 0.0), width=width, height=height),
        depth=depth[None],
        triangle=objects,
        object_id=objects,
        barycentric=torch.zeros(1, height, width, 2),
    )


def upscaled(colors: Tensor, few: VisibilityBuffer, many: VisibilityBuffer) -> Tensor:
    return joint_upsampled(colors[None], few, many, MATERIALS)[0]


def test_colours_stay_on_their_surface() -> None:
    """An outline between rendered pixels: each side keeps its colour up to the outline."""
    left, right = torch.tensor([0.9, 0.1, 0.0]), torch.tensor([0.0, 0.2, 0.7])
    side, rough_side = (torch.arange(40) >= 17).expand(24, 40), (torch.arange(10) >= 4).expand(6, 10)
    colors = torch.where(rough_side[..., None], right, left)
    wanted = torch.where(side[..., None], right, left)

    def error(few: VisibilityBuffer, many: VisibilityBuffer) -> float:
        return float((upscaled(colors, few, many) - wanted).abs().max())

    def depth(right_side: Tensor) -> Tensor:
        return torch.where(right_side, 2.0, 8.0)

    assert error(seen(depth(rough_side)), seen(depth(side))) < 1e-3
    flat, rough_flat = torch.full((24, 40), 3.0), torch.full((6, 10), 3.0)
    assert error(seen(rough_flat, rough_side), seen(flat, side)) < 2e-2
    assert error(seen(rough_flat), seen(flat)) > 0.5


def test_thin_surfaces_find_their_colour_further_away() -> None:
    """A post between the four rendered pixels around its pixels is met by one a row further on."""
    depth, surface = torch.full((16, 16), 3.0), torch.zeros(16, 16)
    surface[:, 7] = 1
    rough = torch.zeros(4, 4)
    rough[0, 1] = 1
    made = upscaled(rough[..., None].expand(4, 4, 3), seen(torch.full((4, 4), 3.0), rough), seen(depth, surface))
    assert float(made[:8, 7].min()) > 0.9
    assert float(made[:, :7].max()) < 0.01


def test_one_surface_and_sky_are_filtered_linearly() -> None:
    ramp = torch.arange(8.0).expand(4, 8)
    colors = ramp[..., None].expand(4, 8, 3)
    places = ((torch.arange(16) + 0.5) / 2 - 0.5).clamp(0, 7)
    for z in (3.0, torch.inf):
        made = upscaled(colors, seen(torch.full((4, 8), z)), seen(torch.full((8, 16), z)))
        assert float((made[..., 0] - places).abs().max()) < 1e-5


def test_a_surface_that_was_not_rendered_gets_colours_from_around() -> None:
    depth = torch.full((8, 8), 5.0)
    depth[3, 3] = 1.0
    surface = (depth < 2.0).int()
    made = upscaled(torch.full((2, 2, 3), 0.25), seen(torch.full((2, 2), 5.0)), seen(depth, surface))
    assert float((made - 0.25).abs().max()) < 1e-5


def slowly(colors: Tensor, rough: VisibilityBuffer, fine: VisibilityBuffer) -> Tensor:
    """The kernel as loops over tensors."""
    few, many = ((buffer.depth[0], buffer.object_id[0]) for buffer in (rough, fine))
    (rows, columns), (height, width) = few[0].shape, many[0].shape
    out = torch.zeros(height, width, 3, dtype=torch.float64)
    for j in range(height):
        for i in range(width):
            y, x = (j + 0.5) * rows / height - 0.5, (i + 0.5) * columns / width - 0.5
            for reach in (1, 2):
                total, weights, likeness = torch.zeros(3, dtype=torch.float64), 0.0, 0.0
                for row in range(math.floor(y) + 1 - reach, math.floor(y) + 1 + reach):
                    for column in range(math.floor(x) + 1 - reach, math.floor(x) + 1 + reach):
                        r, c = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                        own, other = 1 / float(many[0][j, i]), 1 / float(few[0][r, c])
                        apart = abs(own - other) / max(own, other, 1e-30)
                        like = math.exp(-((apart / SAME_SURFACE) ** 2))
                        like *= 1.0 if few[1][r, c] == many[1][j, i] else OTHER_SURFACE
                        weight = (reach - abs(y - row)) * (reach - abs(x - column))
                        likeness += weight * like
                        total += weight * (like + LEFT_OVER) * colors[r, c]
                        weights += weight * (like + LEFT_OVER)
                if likeness > OTHER_SURFACE * reach**4:
                    break
            out[j, i] = total / weights
    return out


def test_the_kernel_has_a_slow_twin() -> None:
    random = torch.Generator().manual_seed(2)
    colors = torch.rand(5, 7, 3, generator=random)
    rendered = 1.0 + 0.2 * torch.rand(5, 7, generator=random)
    rendered[1, 2] = torch.inf
    depth = 1.0 + 0.2 * torch.rand(15, 21, generator=random)
    depth[4:7, 6:9] = torch.inf
    few = seen(rendered, torch.randint(3, (5, 7), generator=random))
    many = seen(depth, torch.randint(4, (15, 21), generator=random))
    assert float((upscaled(colors, few, many) - slowly(colors, few, many)).abs().max()) < 1e-5


@pytest.mark.parametrize("name", ["cornell_box", "city"])
def test_pictures_with_few_pixels_come_nearer_to_whole_ones(name: str) -> None:
    scene = load(name)
    whole = render(scene, width=128, height=96).radiance[0].clamp(max=1.0)
    error = {}
    for way in ("nearest", "bilinear", "joint"):
        few = render(scene, width=128, height=96, options=RenderOptions(supersample=0.25, upscaling=way))
        error[way] = float(((few.radiance[0].clamp(max=1.0) - whole) ** 2).mean())
    assert error["joint"] < 0.7 * min(error["nearest"], error["bilinear"])


def test_every_camera_of_a_batch_is_guided_by_its_own_view() -> None:
    scene = load("cornell_box")
    one = scene.camera(width=48, height=32)
    other = Cameras.look_at(one.eye + 0.2, scene.bounds.mean(dim=0), width=48, height=32)
    options = RenderOptions(supersample=0.5, shadows=False)
    both = render(scene, Cameras.cat([one, other]), options=options).radiance
    for k, camera in enumerate((one, other)):
        torch.testing.assert_close(both[k], render(scene, camera, options=options).radiance[0])


def test_the_picture_carries_the_view_that_guided_it() -> None:
    scene = load("cornell_box")
    few = render(scene, width=48, height=32, options=RenderOptions(supersample=0.5))
    assert few.visibility is few.seen
    assert torch.equal(few.visibility.triangle, rasterize_visibility(scene.geometry, few.cameras).triangle)
    assert render(scene, width=48, height=32).seen is None


def test_gradients_come_through_the_bilinear_way() -> None:
    scene = load("cornell_box")
    color = torch.full((3,), 0.4, requires_grad=True)
    lit = tr.Scene(meshes=scene.meshes, lights=scene.lights, materials=scene.materials, ambient=color)
    made = render(lit, scene.camera(width=24, height=16), options=RenderOptions(supersample=0.5, reflections="off"))
    made.radiance.sum().backward()
    assert color.grad is not None and float(color.grad.min()) > 0.0


def test_a_picture_without_triangles_is_its_background() -> None:
    camera = Cameras.look_at((0, 0, 3), (0, 0, 0), width=16, height=8)
    made = render(Scene(), camera, options=RenderOptions(supersample=0.5, background=(0.2, 0.3, 0.4))).radiance
    torch.testing.assert_close(made, torch.tensor([0.2, 0.3, 0.4]).expand_as(made))


def test_buffers_that_do_not_fit_are_refused() -> None:
    few, many = seen(torch.full((2, 2), 5.0)), seen(torch.full((8, 8), 5.0))
    with pytest.raises(InputError, match="radiance"):
        joint_upsampled(torch.zeros(1, 3, 2, 3), few, many, MATERIALS)


finite = st.floats(1e-3, 1e6)
depths = st.one_of(finite, st.just(math.inf), st.just(1e-30), st.just(1e30))


@settings(deadline=None, max_examples=40)
@given(st.lists(depths, min_size=4, max_size=4), st.lists(depths, min_size=12, max_size=12), st.integers(0, 9))
def test_means_stay_between_the_colours_whatever_the_depths(few: list[float], many: list[float], seed: int) -> None:
    random = torch.Generator().manual_seed(seed)
    colors = torch.rand(2, 2, 3, generator=random) * 1e4
    made = upscaled(colors, seen(torch.tensor(few).reshape(2, 2)), seen(torch.tensor(many).reshape(3, 4)))
    low, high = colors.amin(dim=(0, 1)), colors.amax(dim=(0, 1))
    assert bool(((made >= low * (1 - 1e-5)) & (made <= high * (1 + 1e-5))).all())


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 9), st.integers(1, 9), st.integers(1, 21), st.integers(1, 21))
def test_gradients_go_back_with_the_same_weights(seed: int, h: int, w: int, height: int, width: int) -> None:
    """The scaling is linear: <S x, g> = <x, S' g>, also at borders and where sixteen pixels count."""
    chance = torch.Generator().manual_seed(seed)

    def random(*shape: int) -> Tensor:
        return torch.rand(shape, generator=chance)

    few, many = (seen(1.0 + random(*s).round() * 4.0, (random(*s) * 3).floor()) for s in ((h, w), (height, width)))
    colors, gradient = random(1, h, w, 2).requires_grad_(), random(1, height, width, 2)
    made = joint_upsampled(colors, few, many, MATERIALS)
    (back,) = torch.autograd.grad(made, colors, gradient)
    assert float((made.detach() * gradient).sum()) == pytest.approx(float((colors.detach() * back).sum()), rel=1e-4)
    other = random(1, h, w, 2)
    other_made = joint_upsampled(other, few, many, MATERIALS)
    assert float((other_made * gradient).sum()) == pytest.approx(float((other * back).sum()), rel=1e-4)


def test_a_picture_is_the_same_whether_a_gradient_is_asked_for() -> None:
    scene = load("cornell_box")
    options = RenderOptions(supersample=0.5, reflections="off")
    paint = scene.materials[0].diffuse.clone().requires_grad_()
    asking = scene.replace(materials=(replace(scene.materials[0], diffuse=paint), *scene.materials[1:]))
    view = scene.camera(width=48, height=40)
    plain, made = (render(s, view, options=options).radiance for s in (scene, asking))
    torch.testing.assert_close(made.detach(), plain, rtol=1e-5, atol=1e-6)
    (slope,) = torch.autograd.grad(made.sum(), paint)
    assert float(slope.abs().max()) > 0.0
