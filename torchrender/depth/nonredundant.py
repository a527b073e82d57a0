"""Non-redundant depth images: each keeps only what earlier ones do not have (specification 01, section 5)."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import VisibilityBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.depth.samples import Samples, first_views
from torchrender.raster import FragmentTests, count_nearer, rasterize_visibility
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
        if number == 0:
            one = Samples.first_hits(rasterize_visibility(scene.geometry, cameras[0], cull=options.cull))
        else:
            one = _nearest_new(scene, cameras[number], first_views(known, number), options)
        found.put(number, one)
    return found


def fragment_tests(options: SamplingOptions, known: VisibilityBuffer) -> FragmentTests:
    """The tests that refuse what ``known`` holds."""
    return FragmentTests(
        earlier=known,
        test=options.pixel_test,
        quality_ratio=math.inf if options.quality_ratio is None else options.quality_ratio,
    )


def _nearest_new(scene: Scene, camera: Cameras, known: VisibilityBuffer, options: SamplingOptions) -> Samples:
    """The nearest surface in each pixel of one camera that ``known`` does not hold."""
    geometry, tests = scene.geometry, fragment_tests(options, known)
    eps = (options.relative_tolerance, options.scene_tolerance * scene.diagonal)
    seen = rasterize_visibility(geometry, camera, cull=options.cull, tests=tests)
    if not options.count_layers:
        return Samples.first_hits(seen)
    layer, touching = count_nearer(geometry, seen, cull=options.cull, eps=eps)
    truncated = layer >= options.max_skips
    again = touching & seen.covered & ~truncated
    for _ in range(options.max_skips):
        if not bool(again.any()):
            break
        # A coplanar copy of something redundant is the same surface under another id: look behind it, only there. The
        # step by eps also passes further copies, which would otherwise point to each other for ever.
        behind = seen.depth.double() * (1.0 + eps[0]) + eps[1]
        limited = replace(tests, beyond=torch.where(again, behind, math.inf), skip=seen.triangle)
        seen = _merged(again, rasterize_visibility(geometry, camera, cull=options.cull, tests=limited), seen)
        asked = replace(seen, depth=torch.where(again, seen.depth, 0.0))
        more, touching = count_nearer(geometry, asked, cull=options.cull, eps=eps)
        layer = torch.where(again, more, layer)
        truncated = layer >= options.max_skips
        again &= touching & seen.covered & ~truncated
    truncated = truncated | again
    if bool(truncated.any()):
        nothing = Samples.room_for(camera).seen
        seen = _merged(truncated, nothing, seen)
    return Samples(seen, layer, truncated)


def _merged(pixels: Tensor, new: VisibilityBuffer, old: VisibilityBuffer) -> VisibilityBuffer:
    """``new`` at the given pixels, ``old`` elsewhere."""
    return replace(
        old,
        depth=torch.where(pixels, new.depth, old.depth),
        triangle=torch.where(pixels, new.triangle, old.triangle),
        object_id=torch.where(pixels, new.object_id, old.object_id),
        barycentric=torch.where(pixels[..., None], new.barycentric, old.barycentric),
    )
