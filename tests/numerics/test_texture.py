"""Texture look-up against a loop over texels, and the laws of a mip pyramid."""

from __future__ import annotations

import gc
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from torchrender.errors import InputError
from torchrender.numerics import texture as module
from torchrender.numerics.texture import Addressing, build_pyramid, color_pyramid, sample_texture


def picture(height: int, width: int, channels: int = 3, seed: int = 0) -> Tensor:
    return torch.rand(height, width, channels, generator=torch.Generator().manual_seed(seed))


def slow_bilinear(texture: Tensor, u: float, v: float) -> Tensor:
    height, width, _ = texture.shape
    x, y = u * width - 0.5, (1.0 - v) * height - 0.5
    i, j = math.floor(x), math.floor(y)
    a, b = x - i, y - j
    total = torch.zeros(texture.shape[2], dtype=torch.float64)
    for dj, wy in ((0, 1 - b), (1, b)):
        for di, wx in ((0, 1 - a), (1, a)):
            total += wy * wx * texture[(j + dj) % height, (i + di) % width].double()
    return total.float()


@given(st.integers(1, 7), st.integers(1, 7), st.floats(-3, 3), st.floats(-3, 3))
@settings(max_examples=50, deadline=None)
def test_bilinear_agrees_with_the_loop(height: int, width: int, u: float, v: float) -> None:
    texture = picture(height, width)
    value = sample_texture(build_pyramid(texture), torch.tensor([[u, v]], dtype=torch.float64))
    torch.testing.assert_close(value[0], slow_bilinear(texture, u, v), rtol=1e-4, atol=1e-5)


def test_texel_centres_read_texels_and_v_one_is_the_top_row() -> None:
    texture = picture(4, 8)
    v, u = torch.meshgrid(1 - (torch.arange(4) + 0.5) / 4, (torch.arange(8) + 0.5) / 8, indexing="ij")
    value = sample_texture(build_pyramid(texture), torch.stack([u, v], -1).reshape(-1, 2))
    torch.testing.assert_close(value.reshape(4, 8, 3), texture)


@given(st.floats(0, 1, width=32), st.floats(0, 1, width=32), st.integers(-5, 5), st.floats(1e-4, 4.0))
@settings(max_examples=30, deadline=None)
def test_repeats_with_period_one(u: float, v: float, shift: int, footprint: float) -> None:
    pyramid = build_pyramid(picture(8, 4))
    uv = torch.tensor([[u, v], [u + shift, v - shift]], dtype=torch.float64)
    value = sample_texture(pyramid, uv, torch.full((2,), footprint))
    torch.testing.assert_close(value[0], value[1], rtol=1e-4, atol=1e-5)


def test_levels_keep_the_mean_and_end_in_one_texel() -> None:
    texture = picture(16, 64)
    pyramid = build_pyramid(texture)
    assert (int(pyramid.width[-1]), int(pyramid.height[-1])) == (1, 1)
    for level in range(pyramid.level_count):
        begin = int(pyramid.offset[level])
        size = int(pyramid.width[level] * pyramid.height[level])
        torch.testing.assert_close(pyramid.texels[begin : begin + size].mean(0), texture.mean((0, 1)))


def test_wide_footprint_reads_the_mean_and_narrow_the_finest_level() -> None:
    texture = picture(32, 32)
    pyramid = build_pyramid(texture)
    uv = torch.rand(20, 2, generator=torch.Generator().manual_seed(1))
    wide = sample_texture(pyramid, uv, torch.full((20,), 1.0))
    torch.testing.assert_close(wide, texture.mean((0, 1)).expand(20, 3))
    narrow = sample_texture(pyramid, uv, torch.full((20,), 1.0 / 32))
    torch.testing.assert_close(narrow, sample_texture(pyramid, uv))


@pytest.mark.parametrize(("height", "width"), [(4, 64), (64, 4)])
def test_the_longer_side_sets_the_level(height: int, width: int) -> None:
    """A pixel as wide as 2^k texels of the longer side reads level k, exactly; one as wide as all of it the last."""
    texture = picture(height, width)
    pyramid = build_pyramid(texture)
    levels = [texture]
    while max(levels[-1].shape[:2]) > 1:
        image = levels[-1].permute(2, 0, 1)[None]
        cell = [min(2, side) for side in image.shape[2:]]
        levels.append(torch.nn.functional.avg_pool2d(image, cell)[0].permute(1, 2, 0))
    assert len(levels) == 7
    uv = torch.tensor([[0.31, 0.83], [0.62, 0.07], [0.999, 0.5]], dtype=torch.float64)
    for k, level in enumerate(levels):
        value = sample_texture(pyramid, uv, torch.full((3,), 2.0**k / 64))
        expected = torch.stack([slow_bilinear(level, float(u), float(v)) for u, v in uv])
        torch.testing.assert_close(value, expected, rtol=1e-4, atol=1e-5)
    between = sample_texture(pyramid, uv, torch.full((3,), 2.0**2.5 / 64))
    parts = [torch.stack([slow_bilinear(levels[k], float(u), float(v)) for u, v in uv]) for k in (2, 3)]
    torch.testing.assert_close(between, (parts[0] + parts[1]) / 2, rtol=1e-4, atol=1e-5)


def test_levels_blend_without_a_jump() -> None:
    pyramid = build_pyramid(picture(64, 64))
    footprint = torch.logspace(-7, 0.5, 2000, base=2.0)
    value = sample_texture(pyramid, torch.tensor([[0.3, 0.7]]).expand(2000, 2), footprint)
    assert float((value[1:] - value[:-1]).abs().max()) < 0.01


def test_constant_texture_stays_constant_at_odd_sizes() -> None:
    pyramid = build_pyramid(torch.full((13, 7, 3), 0.375))
    uv = torch.rand(50, 2, generator=torch.Generator().manual_seed(2))
    value = sample_texture(pyramid, uv, torch.rand(50, generator=torch.Generator().manual_seed(3)))
    torch.testing.assert_close(value, torch.full((50, 3), 0.375))


def test_bad_coordinates_and_footprints_never_give_nan() -> None:
    bad = [math.nan, math.inf, -math.inf, 1e30, 0.0]
    uv = torch.tensor([[u, v] for u in bad for v in bad])
    for footprint in (math.nan, math.inf, 0.0, -1.0):
        assert torch.isfinite(sample_texture(build_pyramid(picture(4, 4)), uv, torch.full((25,), footprint))).all()


def test_gradient_reaches_the_texels() -> None:
    texture = picture(4, 4, 3).double().requires_grad_()
    uv = torch.tensor([[0.2, 0.3], [0.9, 0.1]])
    total = sample_texture(color_pyramid(texture), uv, torch.tensor([0.1, 0.6])).sum()
    (gradient,) = torch.autograd.grad(total, texture)
    assert float(gradient.sum()) == pytest.approx(6.0, rel=1e-5)


def test_pyramid_is_kept_while_the_texture_lives_and_follows_changes() -> None:
    gc.collect()  # what earlier tests left goes first
    texture = picture(8, 8, 4)
    before = len(module._PYRAMIDS)
    first = color_pyramid(texture)
    assert color_pyramid(texture) is first
    assert first.texels.shape[1] == 3
    texture[..., 0] = 1.0
    assert float(color_pyramid(texture).texels[:, 0].min()) == 1.0
    del texture
    gc.collect()
    assert len(module._PYRAMIDS) == before


def test_shapes_are_checked() -> None:
    with pytest.raises(InputError, match="texture"):
        build_pyramid(torch.zeros(4, 4))
    with pytest.raises(InputError, match="uv"):
        sample_texture(build_pyramid(picture(2, 2)), torch.zeros(5, 3))


@settings(deadline=None, max_examples=60)
@given(
    size=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    seed=st.integers(0, 2**31),
    scale=st.floats(0, 1e9),
    footprint=st.floats(0, 1e3),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_values_stay_between_the_darkest_and_the_brightest_texel(size, seed, scale, footprint, dtype) -> None:
    generator = torch.Generator().manual_seed(seed)
    texture = torch.rand(*size, 3, generator=generator)
    uv = (torch.randn(32, 2, generator=generator, dtype=torch.float64) * scale).to(dtype)
    value = sample_texture(build_pyramid(texture), uv, torch.full((32,), footprint))
    low, high = texture.amin((0, 1)), texture.amax((0, 1))
    assert bool(((value >= low - 1e-6) & (value <= high + 1e-6)).all())


@pytest.mark.parametrize("size", [(8, 8), (16, 4), (7, 12), (1, 5)])
def test_a_pyramid_made_in_place_is_the_one_that_gradients_pass(size: tuple[int, int]) -> None:
    parts = [picture(*size, channels, seed=channels) for channels in (3, 1)]
    plain = module.pyramid_of(parts)
    traced = module.pyramid_of([parts[0].clone().requires_grad_(True), parts[1]])
    torch.testing.assert_close(plain.texels, traced.texels.detach())
    assert traced.texels.requires_grad and plain.texels.shape[1] == 4
    together = build_pyramid(torch.cat(parts, dim=2))
    torch.testing.assert_close(together.texels, plain.texels)


@pytest.mark.parametrize("filtering", ["nearest", "bilinear", "trilinear"])
def test_what_lies_beyond_the_edges(filtering: str) -> None:
    """Mirrored, the same to both sides of each edge; clamped, as at the edge; inside, the same as each other."""
    pyramid = build_pyramid(picture(5, 4))
    generator = torch.Generator().manual_seed(1)
    inside = torch.rand(40, 2, generator=generator, dtype=torch.float64) * 0.98 + 0.01
    width = None if filtering != "trilinear" else torch.full((40,), 0.4)

    def look(uv: Tensor, wrap: str) -> Tensor:
        return sample_texture(pyramid, uv, width, Addressing(wrap, wrap, filtering))

    wanted = look(inside, "mirror")
    torch.testing.assert_close(look(inside, "clamp"), wanted)
    for axis in (0, 1):
        turned, moved, both = inside.clone(), inside.clone(), inside.clone()
        turned[:, axis] *= -1.0
        moved[:, axis] += 6.0
        both[:, axis] = 2.0 - both[:, axis]
        for uv in (turned, moved, both):
            torch.testing.assert_close(look(uv, "mirror"), wanted, atol=1e-5, rtol=1e-5)
        beyond, edge = inside.clone(), inside.clone()
        beyond[:, axis] = torch.where(beyond[:, axis] > 0.5, 7.3, -2.7)
        edge[:, axis] = (edge[:, axis] > 0.5).double()
        torch.testing.assert_close(look(beyond, "clamp"), look(edge, "clamp"))
