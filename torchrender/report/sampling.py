"""Measure depth-image sampling as the thesis does: ``python -m torchrender.report.sampling [--quick]``.

Tables 2 to 7 on the built-in nest, grass, city and tree beside the published numbers, and the resolution study of
figures 13 to 15. Writes ``docs/results/sampling.md``, ``.json`` and pictures.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from PIL import Image as Picture
from torch import Tensor

from torchrender.depth.kinds import median_triangle_pixels, sample_kinds
from torchrender.depth.metrics import MetricOptions, SamplingMetrics, Share, sampling_metrics
from torchrender.depth.options import SamplingOptions
from torchrender.depth.picture import kinds_picture
from torchrender.depth.sample import sample_depth_images
from torchrender.image_io import write_atomically
from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.transforms import look_at_matrix
from torchrender.report.foundation_page import text_writer
from torchrender.report.machine import machine_record
from torchrender.report.sampling_page import write_page
from torchrender.report.timing import take_turns
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.scene.procedural import build

METHODS = {"C": "conventional", "N": "nonredundant", "P": "depth_peeling"}


@dataclass(frozen=True)
class SetUp:
    """Where the viewpoint triangle of a scene stands; lengths in bounding-box diagonals."""

    target: tuple[float, float, float]  # in the bounding box, 0 to 1
    direction: tuple[float, float, float]  # from the target to the triangle's centre
    distance: float
    side: float


# The side is tuned as the specification asks: conventional redundancy of images 1 and 2 between 50 and 85 percent.
SET_UPS = {
    "nest": SetUp((0.5, 0.5, 0.5), (0.4, 0.8, 1.0), 0.25, 0.05),
    "grass": SetUp((0.5, 0.3, 0.5), (0.3, 0.6, 1.0), 0.08, 0.02),
    "city": SetUp((0.5, 0.2, 0.5), (0.5, 0.8, 1.0), 0.12, 0.08),
    "tree": SetUp((0.5, 0.65, 0.5), (0.3, 0.1, 1.0), 0.2, 0.04),
}


@dataclass(frozen=True)
class Effort:
    """How long the study takes."""

    size: int  # images of the pixel tables
    frames: int
    stride: int
    ray_size: int  # images of the visibility tables: resolution does not enter there
    ray_frames: int
    sizes: tuple[int, ...]  # resolution study
    study_frames: int
    runs: int

    @classmethod
    def quick(cls) -> Effort:
        """Fifty frames and every fourth pixel."""
        return cls(512, 50, 4, 64, 10, (128, 256, 512), 5, 3)

    @classmethod
    def full(cls) -> Effort:
        """About eight minutes on two cores."""
        return cls(1024, 300, 4, 192, 50, (256, 512, 1024, 2048), 20, 7)


def main() -> None:
    """Run the study and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="50 frames, every fourth pixel, small images")
    parser.add_argument("--scenes", nargs="+", choices=tuple(SET_UPS), default=list(SET_UPS))
    parser.add_argument("-o", "--output", type=Path, default=Path("docs/results"), help="folder to write into")
    arguments = parser.parse_args()
    effort = Effort.quick() if arguments.quick else Effort.full()
    begin = time.perf_counter()
    scenes = {}
    for name in arguments.scenes:
        scenes[name] = study(name, build(name), effort, arguments.output)
        sys.stderr.write(f"{name}: done after {time.perf_counter() - begin:.0f} s\n")
    record = {"machine": machine_record(), "effort": vars(effort), "scenes": scenes}
    write_atomically(arguments.output / "sampling.json", text_writer(json.dumps(record, indent=1) + "\n"))
    write_page(record, arguments.output)
    sys.stderr.write(f"wrote {arguments.output / 'sampling.md'}\n")


def study(name: str, scene: Scene, effort: Effort, output: Path) -> dict[str, Any]:
    """Everything about one scene, as plain values; writes its picture."""
    output.mkdir(parents=True, exist_ok=True)
    cameras = viewpoints(scene, SET_UPS[name], effort.size)
    images = sample_depth_images(scene, cameras, SamplingOptions())
    kinds = sample_kinds(scene, cameras, images, frames=min(effort.frames, 50))
    write_strip(output / f"sampling-{name}.png", kinds_picture(images, kinds))
    pixel = measure(scene, cameras, "pixel", MetricOptions(frames=effort.frames, stride=effort.stride))
    small = viewpoints(scene, SET_UPS[name], effort.ray_size)
    rays = measure(scene, small, "visibility", MetricOptions(frames=effort.ray_frames, stride=2))
    plain = measure(scene, small, "visibility", MetricOptions(frames=effort.study_frames))
    sizes = {}
    for size in effort.sizes:
        options = MetricOptions(frames=effort.study_frames, stride=max(1, size // effort.sizes[0]))
        sizes[size] = measure(scene, viewpoints(scene, SET_UPS[name], size), "pixel", options)
    return {
        "triangles": scene.geometry.triangle_count,
        "median_triangle_pixels": median_triangle_pixels(scene, images),
        "tables": {"pixel": pixel, "visibility": rays},
        "resolution": {"pixel": sizes, "visibility": plain},
        "ms": time_methods(scene, cameras, effort.runs),
    }


def viewpoints(scene: Scene, set_up: SetUp, size: int) -> Cameras:
    """Three cameras at the corners of an equilateral triangle that faces the target."""
    low, high = scene.bounds
    target = low + (high - low) * torch.tensor(set_up.target, dtype=torch.float64)
    direction = torch.nn.functional.normalize(torch.tensor(set_up.direction, dtype=torch.float64), dim=0)
    centre = target + direction * set_up.distance * scene.diagonal
    right, down = look_at_matrix(centre, target, torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64))[:2, :3]
    radius = set_up.side * scene.diagonal / math.sqrt(3.0)
    angles = [2.0 * math.pi * k / 3 - math.pi / 2 for k in range(3)]
    eyes = torch.stack([centre + radius * (math.cos(a) * right + math.sin(a) * down) for a in angles])
    near = 1e-3 * scene.diagonal
    return Cameras.look_at(eyes, target, width=size, height=size, fov_deg=45.0, near=near)


def measure(scene: Scene, cameras: Cameras, redundancy: str, options: MetricOptions) -> dict[str, Any]:
    """Metrics of the three methods."""
    sets = [
        sample_depth_images(scene, cameras, SamplingOptions(method=method, redundancy=redundancy))
        for method in METHODS.values()
    ]
    found = sampling_metrics(scene, cameras, sets, options)
    return {letter: as_values(m) for letter, m in zip(METHODS, found, strict=True)}


def as_values(metrics: SamplingMetrics) -> dict[str, Any]:
    """Percentages and standard errors; None for nothing out of nothing."""
    names = ("filled", "truncated", "redundant", "hidden", "hidden_of_all", "useful")
    values: dict[str, Any] = {name: [percent(share) for share in getattr(metrics, name)] for name in names}
    least = metrics.least_available
    return {**values, "available": percent(metrics.mean_available), "least": None if least is None else 100.0 * least}


def percent(share: Share) -> tuple[float | None, float]:
    """Value and standard error in percent."""
    return None if share.value is None else 100.0 * share.value, 100.0 * share.error


def time_methods(scene: Scene, cameras: Cameras, runs: int) -> dict[str, Any]:
    """Milliseconds of three images by each method with pixel redundancy; the methods take turns."""

    candidates = {
        letter: partial(sample_depth_images, scene, cameras, SamplingOptions(method=method))
        for letter, method in METHODS.items()
    }
    timings = take_turns(candidates, runs=runs)
    return {letter: timing.record() for letter, timing in timings.items()}


def write_strip(path: Path, pictures: Tensor) -> None:
    """Linear pictures (B,H,W,3) side by side as one PNG of 512 rows at most."""
    step = max(1, pictures.shape[1] // 512)
    count, height, width, _ = pictures.shape
    rows, columns = height // step, width // step
    cells = pictures[:, : rows * step, : columns * step].reshape(count, rows, step, columns, step, 3).mean(dim=(2, 4))
    strip = srgb_from_linear(torch.cat(list(cells), dim=1).clamp(0, 1))
    image = Picture.fromarray((strip * 255 + 0.5).to(torch.uint8).numpy())
    write_atomically(path, lambda p: image.save(p, format="PNG"))


if __name__ == "__main__":
    main()
