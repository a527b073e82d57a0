"""Codecs of keyframes: depth ``pz1`` (error bound stated), colour JPEG or WebP, masks as packed bits.

``pz1``: inverse depth ``near / z`` in [0,1] times ``2^bits - 1``, rounded; 0 is infinitely far. Predictor ``left + up -
upper left`` (0 outside the image), residual modulo 2^16 as a signed number, zigzag (0, -1, 1, -2 become 0, 1, 2, 3),
plane of low bytes, plane of high bytes, zstd level 1.
"""

from __future__ import annotations

import io
import threading
import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import simplejpeg
import torch
import zstandard
from PIL import Image as PilImage
from PIL import UnidentifiedImageError
from torch import Tensor

from torchrender.checks import check_choice
from torchrender.errors import OptionError
from torchrender.kernels.warp.depth_codec import decode_planes, display_codes, encode_planes, fill_blocks
from torchrender.wire.errors import CodecError
from torchrender.wire.messages import Bits

Array = np.ndarray[Any, Any]

DEPTH_CODECS = ("pz1",)
COLOR_CODECS = ("jpeg", "webp")
BITS: tuple[Bits, ...] = (12, 14, 16)
_BLOCK = 16
"""Pixels of a JPEG block with halved colour resolution."""
_FLOAT_ERROR = 2.0**-22
"""Depth is float32 on both sides."""
_LOCAL = threading.local()


@dataclass(frozen=True)
class EncodedDepth:
    """A compressed depth image."""

    data: bytes
    bits: int
    near: float  # depth of code 2^bits - 1, scene units; the nearest surface
    error: float  # greatest difference of near / z to the true one


def encode_depth(depth: Tensor, *, bits: int = 16) -> EncodedDepth:
    """Compress camera depth (H,W) > 0, +inf where there is nothing.

    The nearest surface gets the highest code, whatever the near plane of the camera is. A surface so far that its code
    would round to 0 gets 1, to stay apart from the sky; the error bound then is one level instead of half a level.

    Raises:
        OptionError: ``bits`` other than 12, 14 or 16. InputError: depth that is not positive.
    """
    if bits not in BITS:
        raise OptionError(f"bits must be one of {', '.join(map(str, BITS))}, got {bits}")
    values = np.ascontiguousarray(depth.detach().numpy(), dtype=np.float32)
    near = float(values.min()) if values.size else np.inf
    if not near > 0.0:
        raise CodecError(f"depth must be > 0, got {near}")
    if near == np.inf:
        near = 1.0
    levels = 2**bits - 1
    planes = np.zeros((2, *values.shape), np.uint8)
    lifted = encode_planes(values, near, float(levels), planes)
    error = (1.0 if lifted else 0.5) / levels + _FLOAT_ERROR
    return EncodedDepth(_compressor().compress(planes.data), bits, near, error)


def decode_depth(data: bytes | memoryview, *, width: int, height: int, bits: int, near: float) -> Tensor:
    """Camera depth (H,W) float32, +inf where there is nothing.

    Raises:
        CodecError: damaged, cut off, or of another size than ``width`` x ``height``.
    """
    if bits not in BITS or not 0.0 < near < np.inf:
        raise CodecError(f"depth needs bits out of {BITS} and a finite near > 0, got {bits} and {near}")
    raw = _decompressed(data, 2 * width * height, "depth")
    planes = np.frombuffer(raw, np.uint8).reshape(2, height, width)
    codes, depth = np.zeros((height, width), np.uint16), np.zeros((height, width), np.float32)
    decode_planes(planes, near, float(2**bits - 1), codes, depth)
    return torch.from_numpy(depth)


def encode_mask(mask: Tensor) -> bytes:
    """Compress (H,W) bool: rows of bits, the first pixel in the highest bit, each row padded to whole bytes."""
    return bytes(_compressor().compress(np.packbits(mask.numpy(), axis=1).tobytes()))


def decode_mask(data: bytes | memoryview, *, width: int, height: int) -> Tensor:
    """(H,W) bool; errors as :func:`decode_depth`."""
    row = (width + 7) // 8
    packed = np.frombuffer(_decompressed(data, row * height, "mask"), np.uint8).reshape(height, row)
    return torch.from_numpy(np.unpackbits(packed, axis=1, count=width).astype(np.bool_))


def display_bytes(radiance: Tensor, gain: float = 1.0) -> Array:
    """(H,W,3) uint8 sRGB of linear light (H,W,3) times ``gain``, clamped; within one code of exact rounding."""
    values = np.ascontiguousarray(radiance.detach().numpy(), dtype=np.float32)
    codes = np.zeros(values.shape, np.uint8)
    display_codes(values.reshape(-1), float(gain), codes.reshape(-1))
    return codes


def encode_color(codes: Array, codec: str, *, quality: int, known: Tensor | None = None) -> bytes:
    """Compress (H,W,3) uint8 sRGB as JPEG (4:2:0 below quality 90, else 4:4:4) or WebP (quality 100: without loss).

    ``known`` (H,W) bool: the rest is overwritten with neighbouring colours, because nobody looks at it.
    """
    check_choice("codec", codec, COLOR_CODECS)
    if not 1 <= quality <= 100:
        raise OptionError(f"quality must be in [1, 100], got {quality}")
    codes = np.ascontiguousarray(codes)
    if known is not None and not bool(known.all()):
        fill_blocks(codes, known.numpy(), _BLOCK)
    if codec == "jpeg":
        sampling = "420" if quality < 90 else "444"
        return bytes(simplejpeg.encode_jpeg(codes, quality, colorspace="RGB", colorsubsampling=sampling))
    out = io.BytesIO()
    # Method 0 is the quickest; without loss, "quality" is the effort.
    lossless = quality == 100
    PilImage.fromarray(codes).save(out, format="WEBP", lossless=lossless, quality=20 if lossless else quality, method=0)
    return out.getvalue()


def decode_color(data: bytes | memoryview, codec: str, *, width: int, height: int) -> Array:
    """(H,W,3) uint8 sRGB.

    Raises:
        CodecError: damaged, cut off, another size or another kind than announced; sizes are compared first.
    """
    data = bytes(data)
    try:
        if codec == "jpeg":
            size = simplejpeg.decode_jpeg_header(data)[:2]
        else:
            picture = PilImage.open(io.BytesIO(data), formats=("WEBP",))
            size = (picture.height, picture.width)
        if size != (height, width):
            raise CodecError(f"colour must be {width} x {height}, the {codec} picture has {size[1]} x {size[0]}")
        if codec == "jpeg":
            return np.asarray(simplejpeg.decode_jpeg(data, colorspace="RGB"))
        return np.asarray(picture.convert("RGB"))
    except (ValueError, OSError, UnidentifiedImageError, PilImage.DecompressionBombError) as error:
        if isinstance(error, CodecError):
            raise
        raise CodecError(f"colour is no intact {codec} picture ({error})") from error


def checksum(blobs: bytes | memoryview) -> int:
    """CRC-32 of the bytes from the first blob to the end of the message."""
    return zlib.crc32(blobs)


# ---------------------------------------------------------------- private


def _compressor() -> zstandard.ZstdCompressor:
    """Compressors must not be shared between threads."""
    if not hasattr(_LOCAL, "compressor"):
        _LOCAL.compressor = zstandard.ZstdCompressor(level=1)
    compressor: zstandard.ZstdCompressor = _LOCAL.compressor
    return compressor


def _decompressed(data: bytes | memoryview, size: int, what: str) -> bytes:
    """Exactly ``size`` bytes; the size that the frame announces is compared before memory is taken."""
    data = bytes(data)
    try:
        announced = zstandard.frame_content_size(data)
        if announced != size:
            raise CodecError(f"{what} must unpack to {size} bytes, its frame announces {announced}")
        raw = zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    except zstandard.ZstdError as error:
        raise CodecError(f"{what} is damaged or cut off ({error})") from error
    if len(raw) != size:
        raise CodecError(f"{what} must unpack to {size} bytes, got {len(raw)}")
    return bytes(raw)
