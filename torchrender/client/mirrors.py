"""Keyframes whose mirrors came as pictures of their own: what they show is warped by where it seems to be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from torchrender.client.drawing import draw_keyframes
from torchrender.numerics.color import srgb_table
from torchrender.reconstruct.reproject import Reprojection, ReprojectOptions, reproject
from torchrender.scene.camera import Cameras
from torchrender.wire.containers import KeyframeImage, depth_images_of


def draw_with_mirrors(
    images: Sequence[KeyframeImage],
    mirror: KeyframeImage,
    camera: Cameras,
    *,
    options: ReprojectOptions | None = None,
) -> Reprojection:
    """Images as other cameras see them, with what the mirrors of the first one show where it is to be seen from there.

    The mirrors themselves, and how much they mirror, move with their surfaces; the light that they mirror moves with
    the virtual points. Where no virtual point reaches, the light stays where it was, painted on the mirror.

    Args:
        images: of one size; the first one is a keyframe's layer 0.
        mirror: the part of its light that was mirrored, at the depths of the virtual points.
        camera: B perspective cameras.
    """
    whole = linear(images[0])
    part = torch.where(mirror.known[..., None], linear(mirror), 0.0).minimum(whole)
    # White hides how bright it is: where what is mirrored does not make it so, something else does, and stays.
    dazzling = (images[0].codes == 255) & (part < 1.0)
    own = [torch.where(dazzling, whole, whole - part), *(linear(image) for image in images[1:])]
    drawn = draw_keyframes(images, camera, colors=torch.stack(own), options=options)
    camera = replace(camera, far=torch.full_like(camera.far, torch.inf))
    surface = depth_images_of([images[0]])
    share = mirror.known.float()[None, ..., None].expand(1, *mirror.known.shape, 3).contiguous()
    painted = reproject(surface, camera, colors=part[None].contiguous(), options=options)
    where = reproject(surface, camera, colors=share, options=options)
    virtual = reproject(depth_images_of([mirror]), camera, options=options)
    mirrors = (drawn.source == 0) & where.valid & (where.color[..., 0] > 0.5)
    light = torch.where((virtual.valid & (virtual.depth > drawn.depth))[..., None], virtual.color, painted.color)
    return replace(drawn, color=(drawn.color + torch.where(mirrors[..., None], light, 0.0)).clamp_max(1.0))


def linear(image: KeyframeImage) -> Tensor:
    """(H,W,3) linear light of a decoded picture."""
    return srgb_table(8)[image.codes.long()]
