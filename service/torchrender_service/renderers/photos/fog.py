"""Fog in photos that clients send, and help with marking them."""

from __future__ import annotations

import hashlib
import time
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from torch import Tensor

from torchrender.photo.fog import FogMedium, FogOptions, FogPhoto, parse_marks
from torchrender.photo.fog.depth.strokes import Stroke, divide, painted, regions_of
from torchrender.photo.fog.marks.file import table_of, text_of
from torchrender.photo.fog.marks.records import Marks, scaled
from torchrender.photo.photograph import resized
from torchrender_service.logs import collecting
from torchrender_service.renderers.jobs import CheckMarks, DescribePhoto, DividePhoto, FogInPhoto, PhotoJob
from torchrender_service.renderers.photos.pictures import jpeg_bytes, png_bytes, read_photo

MARKS = Path("marks.json")
READY = 3
"""Photos that stay ready, so that another medium takes little time."""
T = TypeVar("T")


class FogPhotos:
    """Fog for photos; the ones that were asked for last stay decoded and prepared."""

    def __init__(self) -> None:
        self._photos: OrderedDict[object, Tensor] = OrderedDict()
        self._ready: OrderedDict[object, tuple[FogPhoto, list[str]]] = OrderedDict()

    def run(self, job: PhotoJob) -> dict[str, Any]:
        """What a job about a photo or its marks asks for, as plain values.

        Raises:
            ServiceError, TorchRenderError: photo, marks, strokes or medium are not usable.
        """
        if isinstance(job, DescribePhoto):
            height, width = self._photo(job.photo, job.max_pixels, None).shape[:2]
            return {"width": width, "height": height}
        if isinstance(job, DividePhoto):
            return self._divide(job)
        if isinstance(job, CheckMarks):
            marks = parse_marks(job.marks, job.name)
            return {"table": table_of(marks), "toml": text_of(marks, ".toml")}
        return self._fog(job)

    def _photo(self, data: bytes, max_pixels: int, side: int | None) -> Tensor:
        """(H,W,C) linear, its longer side at most ``side``."""

        def make() -> Tensor:
            if side is None:
                return read_photo(data, max_pixels)
            photo = self._photo(data, max_pixels, None)
            height, width = photo.shape[:2]
            scale = side / max(height, width)
            return resized(photo, max(1, round(width * scale)), max(1, round(height * scale))) if scale < 1 else photo

        return _kept(self._photos, (hashlib.sha256(data).digest(), side), make)

    def _divide(self, job: DividePhoto) -> dict[str, Any]:
        photo = self._photo(job.photo, job.max_pixels, None)
        strokes = [Stroke(part=s.part, points=s.points, width=s.width) for s in job.strokes]
        seeds = painted(strokes, *photo.shape[:2])
        color = photo[..., :1].expand(-1, -1, 3) if photo.shape[2] < 3 else photo[..., :3]
        regions = regions_of(divide(color.contiguous(), seeds), job.labels, job.depths)
        return {"region": table_of(Marks(regions=tuple(regions))).get("region", [])}

    def _fog(self, job: FogInPhoto) -> dict[str, Any]:
        begin = time.perf_counter()
        options = FogOptions(transmittance=job.transmittance, loss=job.loss, top=job.top, light_gain=job.light_gain,
                             shaft_gain=job.shaft_gain)  # fmt: skip
        with collecting() as said:
            photo = self._photo(job.photo, job.max_pixels, job.side)
            key = (hashlib.sha256(job.photo).digest(), job.side, job.marks, job.transmittance)
            usual = FogOptions(transmittance=job.transmittance)
            prepared, earlier = _kept(self._ready, key, lambda: self._prepared(job, photo, usual))
            fog = prepared.adjusted(options)
            medium = FogMedium.of(visibility=job.visibility, scattering=job.scattering, absorption=job.absorption,
                                  asymmetry=job.asymmetry)  # fmt: skip
            made: dict[str, Any] = {"facts": fog.facts(), "timings_ms": {"prepare": fog.prepare_ms}, "file": b""}
            if job.format != "json":
                picture = fog.foggy(medium)
                shown = {"composite": picture.composite, "transmittance": picture.transmittance,
                         "scattered": picture.scattered}[job.show]  # fmt: skip
                encode = jpeg_bytes if job.format == "jpeg" else png_bytes
                made |= {"timings_ms": dict(picture.timings_ms), "file": encode(shown)}
        made["facts"]["size"] = [photo.shape[1], photo.shape[0]]
        made["timings_ms"]["all"] = 1e3 * (time.perf_counter() - begin)
        return {**made, "warnings": list(dict.fromkeys([*earlier, *said]))}

    def _prepared(self, job: FogInPhoto, photo: Tensor, options: FogOptions) -> tuple[FogPhoto, list[str]]:
        """The photo with its marks, and what is said about them."""
        marks = parse_marks(job.marks, MARKS)
        if job.side is not None:
            height, width = self._photo(job.photo, job.max_pixels, None).shape[:2]
            own = (marks.width or width, marks.height or height)
            # Marks of another photo are stretched, with a warning, by what takes them.
            if abs(own[0] * height - own[1] * width) <= 0.02 * width * height:
                marks = scaled(marks, photo.shape[1] / own[0], photo.shape[0] / own[1])
            else:
                marks = replace(marks, width=own[0], height=own[1])
        with collecting() as said:
            made = FogPhoto(photo, marks, options)
        return made, said


def _kept(store: OrderedDict[object, T], key: object, make: Callable[[], T]) -> T:
    """What was made for a key; the one that was not asked for longest goes."""
    if key not in store:
        store[key] = make()
    store.move_to_end(key)
    while len(store) > READY:
        store.popitem(last=False)
    return store[key]
