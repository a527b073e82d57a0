"""Fog in a photo that a client sends."""

from __future__ import annotations

import io
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

from PIL import Image as PilImage
from PIL import UnidentifiedImageError
from torch import Tensor

from torchrender.errors import ImageFileError
from torchrender.images.files import read_image_bytes, write_image
from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, parse_marks
from torchrender_service.errors import ServiceError
from torchrender_service.renderers.jobs import FogInPhoto

NAME = Path("photo")
MARKS = Path("marks.json")


class FogPhotos:
    """The photo that fog was put into last stays ready, so that another medium takes little time."""

    def __init__(self) -> None:
        self._last: tuple[object, FogPhoto] | None = None

    def run(self, job: FogInPhoto) -> dict[str, Any]:
        """A picture as PNG, or facts as plain values, with times and warnings.

        Raises:
            ServiceError, TorchRenderError: photo, marks or medium are not usable.
        """
        begin = time.perf_counter()
        key = (job.photo, job.marks, job.transmittance, job.loss, job.top, job.light_gain, job.shaft_gain)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            if self._last is None or self._last[0] != key:
                options = FogOptions(
                    transmittance=job.transmittance, loss=job.loss, top=job.top, light_gain=job.light_gain,
                    shaft_gain=job.shaft_gain,
                )  # fmt: skip
                self._last = key, FogPhoto(_photo(job), parse_marks(job.marks, MARKS), options)
            fog = self._last[1]
            medium = FogMedium.of(visibility=job.visibility, scattering=job.scattering, absorption=job.absorption,
                                  asymmetry=job.asymmetry)  # fmt: skip
            picture = fog.foggy(medium)
        shown = {"composite": picture.composite, "transmittance": picture.transmittance, "scattered": picture.scattered}
        return {
            "facts": picture.facts,
            "file": b"" if job.format == "json" else _png(shown[job.show]),
            "timings_ms": {**picture.timings_ms, "all": 1e3 * (time.perf_counter() - begin)},
            "warnings": list(dict.fromkeys(str(w.message) for w in said)),
        }


def _photo(job: FogInPhoto) -> Tensor:
    """The photo; its size is checked before it is decoded."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            width, height = PilImage.open(io.BytesIO(job.photo), formats=("PNG", "JPEG")).size
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise ImageFileError(NAME, "is no PNG or JPEG picture", key="photo") from error
    if width * height > job.max_pixels:
        detail = f"a photo may have at most {job.max_pixels} pixels, this one declares {width} x {height}"
        raise ServiceError(422, "too-large", detail)
    return read_image_bytes(job.photo, NAME)


def _png(picture: Tensor) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fog.png"
        write_image(path, picture)
        return path.read_bytes()
