"""Fog in photographs measured: Cornell box beside a reference renderer and baselines, photos, times.

``python -m torchrender.report.fog [--quick] [-o docs/results]`` writes ``fog.md``, ``.json`` and a picture. Photos are
looked for in ``TORCHRENDER_DATA`` (default ``../shared/data``); what is absent is left out. FADE is measured where the
package fade-python is installed.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.images.files import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.photo.fog import FogMedium, FogPhoto
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record
from torchrender.report.common.command import study_parser
from torchrender.report.fog import measures
from torchrender.report.fog.cornell import Box, Truth, cornell, method, reference
from torchrender.report.fog.page import write_page
from torchrender.report.fog.photos import Subject, fade_measure, foggy, labels_beside_lidar, recovered, subjects

TILE = (480, 360)
FADE_STEPS = (0.0, 0.3, 1.0, 2.0)


def run(folder: Path, quick: bool) -> dict[str, Any]:
    """Measure everything, write the picture, and return the record."""
    box = cornell(48, 36) if quick else cornell(96, 72)
    samples, lights = (49, 4) if quick else (196, 6)
    record: dict[str, Any] = {"machine": machine_record(), "quick": quick, "verification": [], "proxies": {}}
    tiles: list[Tensor] = []
    for varied in (False, True):
        truth = reference(box, measures.KAPPA, varied, samples=samples, lights=lights)
        record["verification"] += measures.verification(box, varied, truth)
        record["proxies"]["heterogeneous" if varied else "homogeneous"] = measures.proxies(box, truth)
        tiles += _difference(box, truth, varied)
    record["centroid"] = measures.centroid_errors(300 if quick else 7500, (1, 2, 3, 4))
    record["indirect"] = measures.indirect(16, 12, 24) if quick else measures.indirect(40, 30, 96)
    record["sun"] = measures.sun_errors(4 if quick else 20)
    record["halo"] = measures.halo()
    record["kappa"] = measures.means_by_kappa(box)
    record["photos"], record["recovered"], record["fade"] = [], [], []
    fade = fade_measure()
    for subject in subjects():
        picture, row = foggy(subject)
        again = [foggy(subject)[1] for _ in range(1 if quick else 3)]  # the first time compiles
        row["ms"] = {key: min(times[key] for times in again) for key in again[0] if key.endswith("_ms")}
        record["photos"].append(row)
        tiles += [subject.photo[..., :3], picture.composite[..., :3]]
        if subject.name in ("street", "road"):
            record["recovered"] += [{"photo": subject.name, **r} for r in recovered(subject)]
        if fade is not None:
            record["fade"].append({"photo": subject.name, "values": _fades(subject, fade)})
    if record["photos"]:
        record["labels"] = labels_beside_lidar()
    _write_picture(folder / "fog.jpg", tiles)
    return record


def _fades(subject: Subject, fade: Any) -> list[float]:
    photo = FogPhoto(subject.photo, subject.marks, subject.options, depth=subject.depth)
    pictures = [photo.foggy(FogMedium.of(scattering=subject.medium.scattering * k)) for k in FADE_STEPS]
    return [fade(srgb_from_linear(p.composite[..., :3])) for p in pictures]


def _difference(box: Box, truth: Truth, varied: bool) -> list[Tensor]:
    """Truth, method and their difference times two."""
    through, added = method(box, measures.KAPPA, varied, "patches", patch_limit=measures.PATCH_LIMIT)
    found = truth.clear * through + added
    return [
        truth.clear,
        truth.foggy,
        found,
        (srgb_from_linear(found.clamp(0, 1)) - srgb_from_linear(truth.foggy.clamp(0, 1))).abs() * 2,
    ]


def _write_picture(path: Path, tiles: list[Tensor]) -> None:
    rows, made = [], []
    for tile in tiles:
        codes = (srgb_from_linear(tile.clamp(0.0, 1.0)) * 255).round().byte().numpy()
        scale = min(TILE[0] / codes.shape[1], TILE[1] / codes.shape[0])
        size = (round(codes.shape[1] * scale), round(codes.shape[0] * scale))
        small = cv2.resize(codes, size, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
        top, left = (TILE[1] - size[1]) // 2, (TILE[0] - size[0]) // 2
        made.append(cv2.copyMakeBorder(small, top, TILE[1] - size[1] - top, left, TILE[0] - size[0] - left,
                                       cv2.BORDER_CONSTANT, value=(255, 255, 255)))  # fmt: skip
    while len(made) % 4:
        made.append(np.full((TILE[1], TILE[0], 3), 255, np.uint8))
    for k in range(0, len(made), 4):
        rows.append(np.hstack(made[k : k + 4]))
    sheet = np.ascontiguousarray(np.vstack(rows)[..., ::-1])
    _, data = cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])

    def write(temporary: Path) -> None:
        temporary.write_bytes(data.tobytes())

    write_atomically(path, write)


def main() -> None:
    """The command."""
    arguments = study_parser(__doc__, quick="a small box and few samples: for a look, not for figures").parse_args()
    torch.manual_seed(0)
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        record = run(arguments.output, arguments.quick)
    write_record(arguments.output / "fog.json", record)
    write_page(record, arguments.output)
