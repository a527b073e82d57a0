"""All-frequency shadows of objects as spheres: errors against sums over texels, rays and Mitsuba, and times.

The points are 128 x 128 of a plane. Models and skies are those of a folder of shared data (bunny or armadillo; grace,
pisa, forest, studio).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

import torch
from PIL import Image as Picture

from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.images.files import write_atomically
from torchrender.quality.machine import machine_record
from torchrender.quality.pages import write_record, write_text
from torchrender.report.all_frequency.accuracy import accuracy, by_spheres
from torchrender.report.all_frequency.page import page
from torchrender.report.all_frequency.peers import beside_mitsuba
from torchrender.report.all_frequency.settings import settings_of
from torchrender.report.all_frequency.stage import SKIES, sky, stage
from torchrender.report.all_frequency.times import fits, moving, times, walking
from torchrender.report.common.command import study_parser

SPHERES = (32, 64, 96, 128)
FITTED = SphereOptions(starts=2, teleports=10)
QUICKLY = SphereOptions(starts=1, teleports=0, resolution=48)
NAME = "all-frequency-shadows"


def main(given: list[str] | None = None) -> None:
    """Measure, and write page, record and pictures."""
    parser = study_parser(__doc__, quick="two skies, coarse fits, few runs and samples")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("TORCHRENDER_DATA", "../shared/data")))
    parser.add_argument("--model", default="stanford_bunny.ply", help="a mesh of the data's folder meshes")
    parser.add_argument("--shared-machine", action="store_true", help="say that others used the machine meanwhile")
    arguments = parser.parse_args(given)
    quick, data = arguments.quick, arguments.data
    torch.set_grad_enabled(False)
    names = list(SKIES)[:2] if quick else list(SKIES)
    skies = [sky(data, name) for name in names]
    record: dict[str, Any] = {"machine": machine_record(), "shared": arguments.shared_machine, "quick": quick}
    with part("spheres"):
        at = stage(data, arguments.model, SPHERES, QUICKLY if quick else FITTED)
    record["model"] = at.name
    with part("times"):
        record["times"] = times(at, skies[0], 3 if quick else 7)
    with part("a character that moves"):
        record["moving"] = moving(data, skies[0], 4 if quick else 12)
    pictures = record["moving"].pop("pictures")
    with part("settings"):
        scene, camera, tall = walking(data, skies[0])
        record["settings"] = settings_of(scene.at(0.4), camera, tall, 3 if quick else 7)
    with part("Mitsuba"):
        record["mitsuba"] = beside_mitsuba(at, skies, 64 if quick else 256)
    with part("errors"):
        record["by_spheres"] = {one.name: by_spheres(at, one) for one in skies}
        counts = (64,) if quick else (32, 64)
        record["accuracy"] = {f"{one.name},{n}": accuracy(at, one, n) for one in skies for n in counts}
    with part("fits"):
        record["models"] = fits(data, QUICKLY if quick else SphereOptions(), quick=quick)
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_record(arguments.output / f"{NAME}.json", record)
    write_text(arguments.output / f"{NAME}.md", page(record))
    strip = torch.cat(pictures[:: max(len(pictures) // 4, 1)][:4], dim=1)
    sheet = Picture.fromarray(strip.numpy())
    write_atomically(arguments.output / f"{NAME}.jpg", lambda path: sheet.save(path, format="JPEG", quality=88))


@contextmanager
def part(name: str) -> Iterator[None]:
    """Say on stderr what is measured now, and how long it took."""
    sys.stderr.write(f"{name} ...\n")
    begin = perf_counter()
    yield
    sys.stderr.write(f"{name}: {perf_counter() - begin:.0f} s\n")
