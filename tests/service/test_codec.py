"""Depth and colour codecs: the kernel against a slow twin, the stated error bound, and damage."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import zstandard

from torchrender.errors import OptionError
from torchrender.kernels.warp.depth_codec import encode_planes, fill_blocks
from torchrender.numerics.color import srgb_from_linear
from torchrender.wire.codec import (
    BITS,
    decode_color,
    decode_depth,
    decode_mask,
    display_bytes,
    encode_color,
    encode_depth,
    encode_mask,
)
from torchrender.wire.errors import CodecError
from torchrender_service.renderers.keyframes import REACH, SLIP, enough_bits


def some_depth(height: int, width: int, seed: int = 0) -> torch.Tensor:
    """Planes, a step, noise and sky."""
    torch.manual_seed(seed)
    row, column = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    inverse = 0.2 + 0.01 * row + 0.02 * column + 0.5 * (column > width // 2)
    depth = 1.0 / (inverse + 1e-3 * torch.rand(height, width))
    depth[0, : width // 3] = torch.inf
    return depth


def slow_planes(depth: np.ndarray, near: float, levels: int) -> np.ndarray:
    """The codec as PROTOCOL.md says it, one pixel after the other."""
    height, width = depth.shape
    code = np.zeros((height + 1, width + 1), np.int64)
    planes = np.zeros((2, height, width), np.uint8)
    for j in range(height):
        for i in range(width):
            z = float(depth[j, i])
            code[j + 1, i + 1] = 0 if np.isinf(z) else max(1, int(near * levels / z + 0.5))
            residual = int(code[j + 1, i + 1] - code[j + 1, i] - code[j, i + 1] + code[j, i]) & 0xFFFF
            signed = residual - 0x10000 if residual & 0x8000 else residual
            word = ((signed << 1) ^ (signed >> 15)) & 0xFFFF
            planes[:, j, i] = word & 255, word >> 8
    return planes


@pytest.mark.parametrize("bits", BITS)
def test_planes_are_those_of_the_slow_twin(bits):
    depth = some_depth(9, 14).numpy()
    near, levels = float(depth.min()), 2**bits - 1
    planes = np.zeros((2, 9, 14), np.uint8)
    encode_planes(depth, near, float(levels), planes)
    assert np.array_equal(planes, slow_planes(depth, near, levels))


@pytest.mark.parametrize("bits", BITS)
@pytest.mark.parametrize("size", [(1, 1), (1, 7), (5, 1), (24, 33)])
def test_the_stated_error_bound_holds(bits, size):
    depth = some_depth(*size, seed=bits)
    encoded = encode_depth(depth, bits=bits)
    again = decode_depth(encoded.data, width=size[1], height=size[0], bits=bits, near=encoded.near)
    assert torch.equal(torch.isinf(again), torch.isinf(depth))
    known = torch.isfinite(depth)
    assert float((encoded.near / again - encoded.near / depth)[known].abs().amax()) <= encoded.error
    assert encoded.error < 0.6 / (2**bits - 1)


def test_surfaces_too_far_for_a_code_stay_apart_from_the_sky():
    depth = torch.tensor([[1.0, 1e6, torch.inf]])
    encoded = encode_depth(depth, bits=12)
    again = decode_depth(encoded.data, width=3, height=1, bits=12, near=encoded.near)
    assert torch.isfinite(again).tolist() == [[True, True, False]]
    assert float((1.0 / again - 1.0 / depth)[0, :2].abs().amax()) <= encoded.error


def test_an_empty_picture_and_bad_depth():
    encoded = encode_depth(torch.full((4, 5), torch.inf))
    assert torch.isinf(decode_depth(encoded.data, width=5, height=4, bits=16, near=encoded.near)).all()
    for bad in (0.0, -1.0, torch.nan):
        with pytest.raises(CodecError, match="depth must be > 0"):
            encode_depth(torch.tensor([[bad, 1.0]]))
    with pytest.raises(OptionError, match="bits must be one of"):
        encode_depth(torch.ones(2, 2), bits=8)


def test_planes_compress_as_promised():
    """A 16-bit plane costs next to nothing; noise cannot."""
    row, column = torch.meshgrid(torch.arange(180), torch.arange(320), indexing="ij")
    plane = 1.0 / (0.1 + 0.001 * row + 0.002 * column)
    assert len(encode_depth(plane).data) < 0.1 * 2 * plane.numel()


def test_damaged_depth_is_told_from_good_depth():
    encoded = encode_depth(some_depth(8, 9))
    size = {"bits": 16, "near": encoded.near}
    for data in (b"", encoded.data[:-3], b"x" * 40, encoded.data[:4] + b"\0\0\0" + encoded.data[7:]):
        with pytest.raises(CodecError):
            decode_depth(data, width=9, height=8, **size)
    with pytest.raises(CodecError, match="must unpack to 160 bytes"):
        decode_depth(encoded.data, width=10, height=8, **size)
    with pytest.raises(CodecError, match="near > 0"):
        decode_depth(encoded.data, width=9, height=8, bits=16, near=float("nan"))


def test_a_bomb_is_not_unpacked():
    bomb = zstandard.ZstdCompressor(level=1).compress(bytes(2**26))
    assert len(bomb) < 10_000
    with pytest.raises(CodecError, match="announces 67108864"):
        decode_depth(bomb, width=8, height=8, bits=16, near=1.0)


@pytest.mark.parametrize("size", [(1, 1), (7, 13), (16, 8)])
def test_masks_come_back(size):
    mask = torch.rand(size, generator=torch.Generator().manual_seed(1)) > 0.5
    assert torch.equal(decode_mask(encode_mask(mask), width=size[1], height=size[0]), mask)
    with pytest.raises(CodecError):
        decode_mask(encode_mask(mask), width=size[1] + 8, height=size[0])


def test_colours_come_back():
    codes = np.random.default_rng(0).integers(0, 256, (18, 23, 3), np.uint8)
    exact = decode_color(encode_color(codes, "webp", quality=100), "webp", width=23, height=18)
    assert np.array_equal(exact, codes)
    smooth = np.linspace(0, 255, 32 * 48 * 3).reshape(32, 48, 3).astype(np.uint8)
    close = decode_color(encode_color(smooth, "jpeg", quality=95), "jpeg", width=48, height=32)
    assert np.abs(close.astype(int) - smooth).max() < 12


def test_damaged_colours_are_told_from_good_ones():
    codes = np.full((16, 16, 3), 128, np.uint8)
    for codec in ("jpeg", "webp"):
        data = encode_color(codes, codec, quality=85)
        with pytest.raises(CodecError, match="must be 16 x 17"):
            decode_color(data, codec, width=16, height=17)
        for bad in (b"", b"\0" * 50, data[:20]):
            with pytest.raises(CodecError):
                decode_color(bad, codec, width=16, height=16)
    with pytest.raises(OptionError, match="quality"):
        encode_color(codes, "jpeg", quality=0)


def test_display_codes_are_those_of_the_transfer_function():
    linear = torch.linspace(-0.1, 1.2, 3 * 4001).reshape(-1, 1, 3)
    exact = (srgb_from_linear(linear.clamp(0, 1)) * 255 + 0.5).to(torch.uint8).numpy()
    assert np.abs(display_bytes(linear).astype(int) - exact).max() <= 1
    dark = torch.linspace(0.0, 0.02, 3 * 10000).reshape(-1, 1, 3)
    rounded = (srgb_from_linear(dark.double()) * 255 + 0.5).to(torch.uint8).numpy()
    assert (display_bytes(dark) != rounded).mean() < 0.005, "the line below the knee and the curve above it"
    assert display_bytes(torch.tensor([[[torch.nan, torch.inf, -torch.inf]]])).tolist() == [[[0, 255, 0]]]


def test_what_nobody_sees_becomes_plain():
    codes = np.random.default_rng(3).integers(0, 256, (20, 40, 3), np.uint8)
    known = np.zeros((20, 40), bool)
    known[3:6, 18:20] = True
    filled = codes.copy()
    fill_blocks(filled, known, 16)
    assert np.array_equal(filled[known], codes[known])
    mean = codes[known].astype(int).sum(axis=0) // 6
    assert (filled[:16, 16:32][~known[:16, 16:32]] == mean).all()
    assert (filled[16:, 32:] == mean).all()  # a block without any continues the one before


@pytest.mark.parametrize(("nearest", "expected"), [(1.0, 12), (0.1, 16), (0.25, 14), (1e-3, 16), (torch.inf, 12)])
def test_moving_pictures_get_as_many_bits_as_keep_samples_in_place(nearest, expected):
    """Seen by an eye that has gone a quarter of the typical depth, samples are within an eighth of a pixel."""
    focal, typical = 600.0, 4.0
    bits = enough_bits(focal, nearest, typical)
    assert bits == expected
    if nearest in (torch.inf, 1e-3):
        return
    depth = (nearest / torch.linspace(1.0, 0.01, 64 * 64)).reshape(64, 64)
    encoded = encode_depth(depth, bits=bits)
    again = decode_depth(encoded.data, width=64, height=64, bits=bits, near=encoded.near)
    shift = focal * REACH * typical
    slip = float((shift / depth.double() - shift / again.double()).abs().max())
    assert slip <= 1.01 * SLIP
    assert bits == BITS[0] or 4.0 * slip > SLIP
