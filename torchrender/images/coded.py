"""Pictures of 8 or 16 bits a channel, through Pillow; 16-bit PNG through OpenCV."""

from __future__ import annotations

import io
import threading
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image, ImageOps, UnidentifiedImageError
from torch import Tensor

from torchrender.errors import ImageFileError
from torchrender.numerics.color import srgb_table
from torchrender.numerics.texels.coded import Array, looked_up, room_for

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA")
_STRIP = 1 << 20
"""Bytes of a picture that are taken from Pillow at a time."""
_FILTERS = threading.Lock()
"""Filters of warnings are the process's: only one thread at a time may set them aside."""
PIXELS_PER_BYTE = {"PNG": 8 * 1032, "JPEG": 1024, "TGA": 128}
"""At most: deflate makes 1032 bytes of one, of one bit a pixel; a block of JPEG's 64 pixels takes half a bit."""


def check_size(name: str | Path, width: int, height: int, max_pixels: int) -> None:
    """Refuse a picture before memory is taken for it."""
    if width < 1 or height < 1 or width * height > max_pixels:
        raise ImageFileError(name, f"declares {width} x {height} pixels, the limit is {max_pixels}")


def _check_density(name: str | Path, picture: Image.Image, size: int) -> None:
    """Refuse a few bytes that declare a picture which they cannot hold."""
    most = PIXELS_PER_BYTE.get(str(picture.format))
    if most is not None and picture.size[0] * picture.size[1] > most * size + 65536:
        width, height = picture.size
        raise ImageFileError(name, f"cut off: declares {width} x {height} pixels, {size} bytes cannot hold them")


def read_codes(data: bytes, name: str | Path, max_pixels: int) -> Array:
    """(H,W,C) uint8 or uint16 of a PNG, JPEG, WebP, BMP or TGA picture, turned as its orientation tag says.

    Raises:
        ImageFileError: damaged, cut off, or larger than ``max_pixels``.
    """
    try:
        with _FILTERS, warnings.catch_warnings():
            # Pillow's own size limit only warns, and lower than ours; ours is checked before decoding.
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture: Image.Image = Image.open(io.BytesIO(data), formats=FORMATS)
        check_size(name, *picture.size, max_pixels)
        _check_density(name, picture, len(data))
        deep = picture.format == "PNG" and data[24:25] == b"\x10"
        picture.load()
        if deep:
            return _deep_png(data, name)
        ImageOps.exif_transpose(picture, in_place=True)
        return _codes(picture)
    except ImageFileError:
        raise
    except Image.DecompressionBombError as error:
        raise ImageFileError(name, f"declares more pixels than the limit of {max_pixels}") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError) as error:
        raise ImageFileError(name, f"damaged or cut off ({error})") from error


def _codes(picture: Image.Image) -> Array:
    """(H,W,C) uint8."""
    if picture.mode not in ("L", "LA", "RGB", "RGBA"):
        clear = "transparency" in picture.info or picture.mode in ("PA", "La", "RGBa")
        grey = picture.mode in ("1", "I", "F")
        picture = picture.convert("RGBA" if clear else "L" if grey else "RGB")
    elif "transparency" in picture.info:
        picture = picture.convert("LA" if picture.mode == "L" else "RGBA")
    width, height = picture.size
    codes = room_for((height, width, len(picture.getbands())), np.uint8)
    rows = max(_STRIP // max(width * codes.shape[2], 1), 1)
    for row in range(0, height, rows):  # the whole at once would be copied several times
        strip = picture if rows >= height else picture.crop((0, row, width, min(row + rows, height)))
        codes[row : row + rows] = np.asarray(strip).reshape(-1, *codes.shape[1:])
    return codes


def _deep_png(data: bytes, name: str | Path) -> Array:
    """(H,W,C) uint16; Pillow would cut 16-bit colour to 8 bits."""
    import cv2  # slow to import, and few pictures need it

    codes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if codes is None or codes.dtype != np.uint16:
        raise ImageFileError(name, "damaged 16-bit PNG")
    if codes.ndim == 2:
        return codes[..., None]
    order = [2, 1, 0, 3][: codes.shape[2]]
    codes = codes[..., order]
    # PNG colour type 4 (byte 25) is grey with alpha, which OpenCV expands to four channels.
    return codes[..., 2:] if data[25] == 4 else codes


def scaled(codes: Array) -> Tensor:
    """(H,W,C) float32 in [0,1]."""
    plain = _shares(codes.dtype)
    return torch.from_numpy(looked_up(codes, plain, plain, codes.shape[2]))


def linear(codes: Array) -> Tensor:
    """(H,W,C) float32 linear light; alpha is only scaled."""
    table = srgb_table(8 * codes.dtype.itemsize).numpy()
    return torch.from_numpy(looked_up(codes, table, _shares(codes.dtype), 1 if codes.shape[2] <= 2 else 3))


def _shares(kind: np.dtype[Any]) -> Array:
    """(K,) float32 share of the greatest code that each code is."""
    most = np.iinfo(kind).max
    shares: Array = np.arange(most + 1, dtype=np.float32) / np.float32(most)
    return shares
