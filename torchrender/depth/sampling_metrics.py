"""How well a set of depth images samples a scene (specification 01, section 7).

Four numbers: redundant samples (earlier images of the set have them), hidden samples (no conventional image from the
viewpoints has them), useful ones among the hidden (some view between the viewpoints needs them), and available samples
(what share of a view between the viewpoints the set holds; the rest is occlusion error).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from torchrender.buffers import DepthImages
from torchrender.checks import check_range, checked_fields, options_of
from torchrender.depth.holders import Holder, images_holder, views_holder
from torchrender.depth.options import SamplingOptions
from torchrender.depth.probes import Probes
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.viewpoints import viewpoints_inside
from torchrender.errors import InputError
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


@dataclass(frozen=True, kw_only=True)
@checked_fields
class SamplingMetricOptions:
    """How much is measured. More frames find more of the useful samples, so compare equal frame counts only.

    Raises:
        OptionError: a value outside its range.
    """

    frames: int = 1000  # views between the viewpoints
    stride: int = 1  # every stride-th pixel along both axes is asked
    first_frame: int = 1  # index of the first Halton point: another one gives other frames

    def __post_init__(self) -> None:
        check_range("frames", self.frames, 1, 100_000)
        check_range("stride", self.stride, 1, 4096)
        check_range("first_frame", self.first_frame, 1)


@dataclass(frozen=True)
class Share:
    """A share of ``count`` samples, and its standard error; None for nothing out of nothing."""

    value: float | None
    error: float
    count: int

    @classmethod
    def of(cls, found: int, count: int) -> Share:
        """Of ``count`` independent samples ``found`` have the property."""
        if count == 0:
            return cls(None, 0.0, 0)
        value = found / count
        return cls(value, math.sqrt(value * (1.0 - value) / count), count)


@dataclass(frozen=True, kw_only=True)
class SamplingMetrics:
    """The metrics of a set of n depth images."""

    filled: tuple[Share, ...]  # of all pixels
    truncated: tuple[Share, ...]  # of all pixels
    redundant: tuple[Share, ...]  # metric 1, of filled pixels
    hidden: tuple[Share, ...]  # metric 2, of filled pixels
    hidden_of_all: tuple[Share, ...]  # metric 2, of all pixels
    useful: tuple[Share, ...]  # metric 3, of hidden samples
    available: tuple[float, ...]  # metric 4 of each frame that shows anything

    @property
    def mean_available(self) -> Share:
        """Mean of metric 4 over the frames, and its standard error."""
        values = torch.tensor(self.available, dtype=torch.float64)
        if not len(values):
            return Share(None, 0.0, 0)
        error = float(values.std()) / math.sqrt(len(values)) if len(values) > 1 else 0.0
        return Share(float(values.mean()), error, len(values))

    @property
    def least_available(self) -> float | None:
        """Minimum of metric 4 over the frames."""
        return min(self.available, default=None)


def sampling_metrics(
    scene: Scene, viewpoints: Cameras, sets: Sequence[DepthImages], options: SamplingMetricOptions | None = None
) -> list[SamplingMetrics]:
    """Metrics of one or more sets of depth images; views between the viewpoints are rendered once for all of them.

    Each set is measured by the redundancy that sampled it; all must have been sampled by the same one.

    Args:
        viewpoints: the cameras that the sets were asked for (depth peeling itself looks from their centre).
        sets: images of this scene, all of one size.

    Raises:
        InputError: sets of different sizes or redundancies.
    """
    options = options_of(options, SamplingMetricOptions)
    sampling = _common_options(sets)
    size = sets[0].cameras
    viewpoints = viewpoints.scaled(size.height / viewpoints.height)
    rays = RayVisibility(scene, sampling) if sampling.redundancy == "visibility" else None
    conventional = rasterize_visibility(scene.geometry, viewpoints, cull=sampling.cull)
    measured = [_Measurement(scene, rays, images, options.stride) for images in sets]
    for one in measured:
        one.find_hidden(views_holder(scene, rays, sampling, conventional))
    for camera in _each(viewpoints_inside(viewpoints, options.frames, first=options.first_frame)):
        frame = rasterize_visibility(scene.geometry, camera, cull=sampling.cull)
        holder, shown = views_holder(scene, rays, sampling, frame), Probes.of(frame, 0, options.stride)
        for one in measured:
            one.add_frame(holder, shown)
    return [one.result() for one in measured]


class _Measurement:
    """What has been counted so far for one set of images."""

    def __init__(self, scene: Scene, rays: RayVisibility | None, images: DepthImages, stride: int) -> None:
        self.images = images
        self.probes = [Probes.of(images, i, stride) for i in range(len(images))]
        self.redundant = [
            int(images_holder(scene, rays, images, i)(probes).sum()) for i, probes in enumerate(self.probes)
        ]
        self.holder = images_holder(scene, rays, images, len(images))
        self.hidden: list[int] = []
        self.open: list[Probes] = []  # hidden samples that no frame has needed yet
        self.available: list[float] = []

    def find_hidden(self, conventional: Holder) -> None:
        self.open = [probes[~conventional(probes)] for probes in self.probes]
        self.hidden = [len(probes) for probes in self.open]

    def add_frame(self, frame: Holder, shown: Probes) -> None:
        self.open = [probes[~frame(probes)] if len(probes) else probes for probes in self.open]
        if len(shown):
            self.available.append(float(self.holder(shown).double().mean()))

    def result(self) -> SamplingMetrics:
        covered, truncated = self.images.covered, self.images.truncated
        pixels = covered[0].numel()
        counts = [len(probes) for probes in self.probes]
        fill = [int(c.sum()) / pixels for c in covered]
        return SamplingMetrics(
            filled=tuple(Share.of(int(c.sum()), pixels) for c in covered),
            truncated=tuple(Share.of(int(c.sum()), pixels) for c in truncated),
            redundant=tuple(Share.of(r, n) for r, n in zip(self.redundant, counts, strict=True)),
            hidden=tuple(Share.of(h, n) for h, n in zip(self.hidden, counts, strict=True)),
            hidden_of_all=tuple(_scaled(Share.of(h, n), f) for h, n, f in zip(self.hidden, counts, fill, strict=True)),
            useful=tuple(Share.of(h - len(o), h) for h, o in zip(self.hidden, self.open, strict=True)),
            available=tuple(self.available),
        )


def _scaled(share: Share, factor: float) -> Share:
    """A share of filled pixels as a share of all pixels."""
    value = 0.0 if share.value is None else share.value * factor
    return Share(value, share.error * factor, share.count)


def _common_options(sets: Sequence[DepthImages]) -> SamplingOptions:
    """Options in which all sets agree as far as measuring goes."""
    if not sets:
        raise InputError("sets must hold at least one set of depth images")
    all_options = [SamplingOptions(**images.parameters) for images in sets]
    for name in ("redundancy", "visibility_test", "pixel_test", "quality_ratio", "cull_backfaces"):
        values = {getattr(options, name) for options in all_options}
        if len(values) > 1:
            raise InputError(f"sets must share {name}, got {sorted(map(str, values))}")
    shapes = {tuple(images.depth.shape[1:]) for images in sets}
    if len(shapes) > 1:
        raise InputError(f"sets must share one image size, got {sorted(shapes)}")
    return all_options[0]


def _each(cameras: Cameras) -> list[Cameras]:
    return [cameras[number] for number in range(len(cameras))]
