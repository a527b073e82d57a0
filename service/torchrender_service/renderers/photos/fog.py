"""Fog in a photo that a client sends."""

from __future__ import annotations

import time
import warnings
from pathlib import Path
from typing import Any

from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, parse_marks
from torchrender_service.renderers.jobs import FogInPhoto
from torchrender_service.renderers.photos.pictures import png_bytes, read_photo

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
                self._last = (
                    key,
                    FogPhoto(read_photo(job.photo, job.max_pixels), parse_marks(job.marks, MARKS), options),
                )
            fog = self._last[1]
            medium = FogMedium.of(visibility=job.visibility, scattering=job.scattering, absorption=job.absorption,
                                  asymmetry=job.asymmetry)  # fmt: skip
            picture = fog.foggy(medium)
        shown = {"composite": picture.composite, "transmittance": picture.transmittance, "scattered": picture.scattered}
        return {
            "facts": picture.facts,
            "file": b"" if job.format == "json" else png_bytes(shown[job.show]),
            "timings_ms": {**picture.timings_ms, "all": 1e3 * (time.perf_counter() - begin)},
            "warnings": list(dict.fromkeys(str(w.message) for w in said)),
        }
