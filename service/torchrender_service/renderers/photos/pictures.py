"""Pictures that clients send, and that are sent back."""

from __future__ import annotations

import io
import tempfile
import warnings
from pathlib import Path

from PIL import Image as PilImage
from PIL import UnidentifiedImageError
from torch import Tensor

from torchrender.errors import ImageFileError
from torchrender.images.files import read_image_bytes, write_image
from torchrender_service.errors import ServiceError

NAME = Path("photo")


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
