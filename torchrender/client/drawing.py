"""Images of keyframes from a new viewpoint, the preferred one first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.reconstruct.reproject import Reprojection, ReprojectOptions, reproject
from torchrender.scene.camera import Cameras
from torchrender.wire.containers import KeyframeImage, depth_images_of

NEARER = 0.01
"""Share of its depth by which a sample of another image must lie in front of one of the first to be shown instead."""


def draw_keyframes(
    images: Sequence[KeyframeImage],
    camera: Cameras,
    *,
    colors: Tensor | None = None,
    options: ReprojectOptions | None = None,
) -> Reprojection:
    """The first image as other cameras see it; the others fill what it does not reach, and stand in front of it.

    Args:
        images: of one size; the first one is a keyframe's layer 0.
        camera: B perspective cameras.
        colors: (N,H,W,3) to use instead of the images' own, in any space.
    """
    camera = replace(camera, far=torch.full_like(camera.far, torch.inf))  # the sky is very far away

    def drawn(part: slice) -> Reprojection:
        chosen = None if colors is None else colors[part]
        return reproject(depth_images_of(list(images[part])), camera, colors=chosen, options=options)

    first = drawn(slice(0, 1))
    if len(images) == 1 or bool(first.valid.all()):  # without a hole nothing has come out from behind anything
        return first
    rest = drawn(slice(1, None))
    own = first.valid & ~(rest.valid & (rest.depth < (1.0 - NEARER) * first.depth))
    return Reprojection(
        cameras=camera,
        color=torch.where(own[..., None], first.color, rest.color),
        depth=torch.where(own, first.depth, rest.depth),
        valid=own | rest.valid,
        source=torch.where(own, first.source, torch.where(rest.valid, rest.source + 1, -1)),
    )
