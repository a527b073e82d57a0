"""Non-redundant depth images: each keeps only what earlier ones do not have (specification 01, section 5)."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples, some_views
from torchrender.raster import FragmentTests, camera_passes, rasterize_into
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


def pixel_nonredundant(
    scene: Scene, cameras: Cameras, images: VisibilityBuffer | None, options: SamplingOptions
) -> Samples:
    """The nearest non-redundant surface in every pixel, by pixel redundancy.

    One rasterised pass finds it: redundant fragments never enter the depth buffer. A second, without a depth buffer,
    counts what was refused.

    Args:
        images: what image i is compared with: its first i images; None: the images found here.
    """
    found = Samples.room_for(cameras)
    known = found.seen if images is None else images
    for number in range(len(cameras)):
        part = slice(number, number + 1)
        own = some_views(found.seen, part)
        if number == 0:
            rasterize_into(own, scene.geometry, cull=options.cull)
        else:
            one = Samples(own, found.layer[part], found.truncated[part])
            _find_nearest_new(scene, one, some_views(known, slice(number)), options)
    return found


def fragment_tests(options: SamplingOptions, known: VisibilityBuffer) -> FragmentTests:
    """The tests that refuse what ``known`` holds."""
    return FragmentTests(
        earlier=known,
        test=options.pixel_test,
        quality_ratio=math.inf if options.quality_ratio is None else options.quality_ratio,
    )


def _find_nearest_new(scene: Scene, found: Samples, known: VisibilityBuffer, options: SamplingOptions) -> None:
    """Write into ``found``, of one camera, the nearest surface in each pixel that ``known`` does not hold.

    Args:
        found: of whose images only layer and truncated are there so far, all zero.
    """
    seen, layer, truncated, most = found.seen, found.layer[0], found.truncated[0], options.max_skips
    tests = fragment_tests(options, known)
    eps = (options.relative_tolerance, options.scene_tolerance * scene.diagonal)
    with camera_passes(scene.geometry, seen.cameras, options.cull) as passes:
        passes.rasterize(tests, seen)
        if not options.count_layers:
            return
        _, touching = passes.count_nearer(seen, eps, room=layer)
        depth, triangle = seen.depth[0], seen.triangle[0]
        again = _places(touching[0])
        again = _some(again, (triangle[again] >= 0) & (layer[again] < most))
        for _ in range(most):
            if not len(again[0]):
                break
            # A coplanar copy of something redundant is the same surface under another id: look behind it, only there.
            # The step by eps also passes further copies, which would otherwise point to each other for ever.
            passes.rasterize_behind(tests, seen, depth[again].double() * (1.0 + eps[0]) + eps[1], again)
            layer[again], touches = passes.count_nearer(seen, eps, again)
            again = _some(again, touches & (triangle[again] >= 0) & (layer[again] < most))
    if int(layer.max()) < most and not len(again[0]):
        return
    truncated.copy_(layer >= most)
    truncated[again] = True
    given_up = _places(truncated)
    depth[given_up] = math.inf
    triangle[given_up] = seen.object_id[0][given_up] = -1
    seen.barycentric[0][given_up] = 0.0


def _places(mask: Tensor) -> tuple[Tensor, ...]:
    """Rows and columns of what is set in (H,W): seldom anything, which numpy finds out in a twentieth of the time."""
    return tuple(torch.from_numpy(axis) for axis in np.divmod(np.flatnonzero(mask.numpy()), mask.shape[1]))


def _some(pixels: tuple[Tensor, ...], chosen: Tensor) -> tuple[Tensor, ...]:
    return tuple(axis[chosen] for axis in pixels)
