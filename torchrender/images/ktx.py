"""KTX2 pictures with Basis Universal compression, through the package opengl_basisu where it is installed."""

from __future__ import annotations

import importlib.util
import struct
from pathlib import Path
from typing import Any

import numpy as np

from torchrender.errors import ImageFileError
from torchrender.images.coded import check_size

PACKAGE = "opengl_basisu"


def has_ktx2() -> bool:
    """Whether the package that reads such pictures is installed."""
    return importlib.util.find_spec(PACKAGE) is not None


def read_ktx2(data: bytes, name: str | Path, max_pixels: int) -> np.ndarray[Any, Any]:
    """(H,W,4) uint8 of the largest level of the first picture.

    Raises:
        ImageFileError: damaged, larger than ``max_pixels``, or the package is missing.
    """
    if len(data) < 80:
        raise ImageFileError(name, "damaged or cut off KTX2 picture")
    width, height = struct.unpack_from("<II", data, 20)
    check_size(name, width, height, max_pixels)
    if not has_ktx2():
        raise ImageFileError(name, f'KTX2 pictures need {PACKAGE}: pip install "torchrender[ktx]"')
    import opengl_basisu

    try:
        texture = opengl_basisu.open(data)
        return np.array(texture.transcode(opengl_basisu.Target.RGBA8).data, np.uint8)
    # The package raises its own classes and whatever a damaged file trips it over.
    except Exception as error:
        raise ImageFileError(name, f"damaged or unsupported KTX2 picture ({error})") from error
