"""Non-redundant depth images: each keeps only what earlier ones do not have (specification 01, section 5)."""

from __future__ import annotations

import math

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
        own = some_views(found.seen, slice(number, number + 1))
        if number == 0:
            rasterize_into(own, scene.geometry, cull=options.cull)
        else:
            layer, truncated = _nearest_new(scene, own, some_views(known, slice(number)), options)
            found.layer[number], found.truncated[number] = layer, truncated
    return found


def fragment_tests(options: SamplingOptions, known: VisibilityBuffer) -> FragmentTests:
    """The tests that refuse what ``known`` holds."""
    return FragmentTests(
        earlier=known,
        test=options.pixel_test,
        quality_ratio=math.inf if options.quality_ratio is None else options.quality_ratio,
    )


def _nearest_new(
    scene: Scene, seen: VisibilityBuffer, known: VisibilityBuffer, options: SamplingOptions
) -> tuple[Tensor, Tensor]:
    """Write into ``seen``, of one camera, the nearest surface in each pixel that ``known`` does not hold.

    Returns:
        layer (H,W) int32 of surfaces skipped before it, truncated (H,W) bool.
    """
    tests = fragment_tests(options, known)
    eps = (options.relative_tolerance, options.scene_tolerance * scene.diagonal)
    with camera_passes(scene.geometry, seen.cameras, options.cull) as passes:
        passes.rasterize(tests, seen)
        if not options.count_layers:
            shape = seen.triangle.shape[1:]
            return torch.zeros(shape, dtype=torch.int32), torch.zeros(shape, dtype=torch.bool)
        layer, touching = passes.count_nearer(seen, eps)
        depth, triangle, layer, touching = seen.depth[0], seen.triangle[0], layer[0], touching[0]
        again = torch.nonzero(touching & (triangle >= 0) & (layer < options.max_skips), as_tuple=True)
        for _ in range(options.max_skips):
            if not len(again[0]):
                break
            # A coplanar copy of something redundant is the same surface under another id: look behind it, only there.
            # The step by eps also passes further copies, which would otherwise point to each other for ever.
            passes.rasterize_behind(tests, seen, depth[again].double() * (1.0 + eps[0]) + eps[1], again)
            layer[again], touches = passes.count_nearer(seen, eps, again)
            open_still = touches & (triangle[again] >= 0) & (layer[again] < options.max_skips)
            again = tuple(axis[open_still] for axis in again)
    truncated = layer >= options.max_skips
    truncated[again] = True
    given_up = torch.nonzero(truncated, as_tuple=True)
    if len(given_up[0]):
        depth[given_up] = math.inf
        triangle[given_up] = seen.object_id[0][given_up] = -1
        seen.barycentric[0][given_up] = 0.0
    return layer, truncated
