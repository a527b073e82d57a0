"""Radiance pictures (RGBE) in all eight orientations.

OpenCV decodes the pixels but knows one orientation: the size line is rewritten to that one, and the picture turned
afterwards. Source: Ward, "Radiance file formats" (the resolution string).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import ImageFileError
from torchrender.images.coded import check_size

_SIZE = re.compile(rb"\n([-+])([XY]) +(\d{1,9}) +([-+])([XY]) +(\d{1,9})[ \t]*\r?\n")


def read_radiance(data: bytes, name: str | Path, max_pixels: int) -> np.ndarray[Any, Any]:
    """(H,W,3) float32, row 0 on top.

    Raises:
        ImageFileError: damaged, cut off, in XYZE, or larger than ``max_pixels``.
    """
    import cv2  # slow to import, and few pictures need it

    size = _SIZE.search(data[:65536])
    if size is None or size.group(2) == size.group(5):
        raise ImageFileError(name, "Radiance header without a size line: damaged or cut off")
    header = data[: size.start()]
    if b"32-bit_rle_xyze" in header:
        raise ImageFileError(name, "XYZE colours are not supported, only RGBE")
    first, second = int(size.group(3)), int(size.group(6))
    by_rows = size.group(2) == b"Y"
    check_size(name, *((second, first) if by_rows else (first, second)), max_pixels)
    usual = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (first, second) + data[size.end() :]
    level = cv2.utils.logging.getLogLevel()
    # What it has to say of damaged pictures is said below.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        pixels = cv2.imdecode(np.frombuffer(usual, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise ImageFileError(name, f"damaged ({error})") from error
    finally:
        cv2.utils.logging.setLogLevel(level)
    if pixels is None or pixels.ndim != 3:
        raise ImageFileError(name, "damaged or cut off Radiance picture")
    pixels = np.asarray(pixels[..., ::-1], dtype=np.float32)
    # -Y counts from the top down and +X from the left on, which is how pictures lie in memory.
    if (size.group(1) == b"+") == by_rows:
        pixels = pixels[::-1]
    if (size.group(4) == b"-") == by_rows:
        pixels = pixels[:, ::-1]
    return np.ascontiguousarray(pixels if by_rows else pixels.transpose(1, 0, 2))
