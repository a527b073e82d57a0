"""One question for both redundancies: which of these samples does that set of images hold?"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from torchrender.buffers import DepthImages, VisibilityBuffer
from torchrender.depth.nonredundant import fragment_tests
from torchrender.depth.options import SamplingOptions
from torchrender.depth.probes import Probes, pixel_redundant
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.samples import some_views
from torchrender.scene.model import Scene

Holder = Callable[[Probes], Tensor]
"""Samples (N) to (N,) bool."""


def images_holder(scene: Scene, rays: RayVisibility | None, images: DepthImages, count: int) -> Holder:
    """Which samples do the first ``count`` images of a set hold? ``rays`` for visibility redundancy, else None."""
    options = SamplingOptions(**images.parameters)
    if count == 0:
        return lambda probes: torch.zeros(len(probes), dtype=torch.bool)
    if rays is None or options.method == "conventional":
        return views_holder(scene, rays, options, some_views(images, slice(count)))
    if options.method == "depth_peeling":
        return lambda probes: rays.peeled(probes.points(), probes.triangle, images.cameras[0], count)
    return lambda probes: rays.captured(probes.points(), probes.triangle, images.cameras, count)


def views_holder(scene: Scene, rays: RayVisibility | None, options: SamplingOptions, views: VisibilityBuffer) -> Holder:
    """Which samples do these images hold? By visibility they are taken to hold first hits."""
    if rays is None:
        tests = fragment_tests(options, views)
        return lambda probes: pixel_redundant(probes, tests, scene.geometry)
    return lambda probes: rays.seen(probes.points(), probes.triangle, views.cameras)
