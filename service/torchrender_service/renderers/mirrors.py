"""What the mirrors of a keyframe show, as a layer that clients warp by where it seems to be."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer
from torchrender.effects.reflections.virtual import virtual_images
from torchrender.image import Image
from torchrender.passes.mirrors.reflections import REFLECTIONS
from torchrender.passes.seen.gbuffer import GBUFFER
from torchrender.scene.camera import Cameras
from torchrender_service.renderers.layers import Layer

NEEDED = (GBUFFER.name, REFLECTIONS.name)
"""Buffers that the picture must carry."""

FEWEST = 64
"""Pixels that must mirror for their picture to be worth a message."""


def mirror_layer(image: Image, camera: Cameras) -> Layer | None:
    """The layer of a picture that carries its reflections; None where nothing mirrors."""
    layer, seen = image.buffers.get(REFLECTIONS.name), image.buffers.get(GBUFFER.name)
    if not isinstance(layer, ReflectionLayer) or not isinstance(seen, GBuffer):
        return None
    made = virtual_images(image.scene, seen, layer)
    if int(made.known.sum()) < FEWEST:
        return None
    parts = (_sized(part, camera) for part in (made.depth[0], made.light[0], made.known[0]))
    return Layer(camera, *parts)


def _sized(picture: Tensor, camera: Cameras) -> Tensor:
    """The nearest pixels of a picture (h,w,...) at the camera's size."""
    rows = (torch.arange(camera.height) * picture.shape[0]) // camera.height
    columns = (torch.arange(camera.width) * picture.shape[1]) // camera.width
    return picture[rows][:, columns].contiguous()
