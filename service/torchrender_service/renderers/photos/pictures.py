"""Pictures that clients send, and that are sent back."""

from __future__ import annotations

import io
import tempfile
import warnings
from pathlib import Path

import cv2
import numpy as np
from PIL import Image as PilImage
from PIL import UnidentifiedImageError
from torch import Tensor

from torchrender.errors import ImageFileError
from torchrender.images.files import read_image_bytes, write_image
from torchrender.numerics.color import srgb_from_linear
from torchrender_service.errors import ServiceError

NAME = Path("photo")
QUALITY = 88


def read_photo(data: bytes, max_pixels: int) -> Tensor:
    """The photo (H,W,C), linear; its size is checked before it is decoded.

    Raises:
        ImageFileError: no PNG or JPEG. ServiceError: more than ``max_pixels``.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            width, height = PilImage.open(io.BytesIO(data), formats=("PNG", "JPEG")).size
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise ImageFileError(NAME, "is no PNG or JPEG picture", key="photo") from error
    if width * height > max_pixels:
        detail = f"a photo may have at most {max_pixels} pixels, this one declares {width} x {height}"
        raise ServiceError(422, "too-large", detail)
    return read_image_bytes(data, NAME)


def png_bytes(picture: Tensor) -> bytes:
    """A picture (H,W,C), linear, as a PNG file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "picture.png"
        write_image(path, picture)
        return path.read_bytes()


def jpeg_bytes(picture: Tensor) -> bytes:
    """A picture (H,W,C), linear, as a JPEG file, for a look: an eighth of a PNG's time and size."""
    codes = (srgb_from_linear(picture[..., :3].clamp(0.0, 1.0)) * 255).round().byte().numpy()
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(codes[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    assert done
    return bytes(data)
