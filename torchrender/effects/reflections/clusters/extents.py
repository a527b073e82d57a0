"""How much the images of cluster cameras show, and how finely. Specification 03, section 6.4 and 6.5."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.reflections.clusters.bundle import Bundle, ClusterCameras
from torchrender.effects.reflections.clusters.grouping import PixelClusters
from torchrender.effects.reflections.reflectors import ReflectivePixels
from torchrender.kernels.reflections import cluster_fit

HALF_ANGLE_DEG = 75.0
SIDES = (8, 2048)
TEXELS_PER_PIXEL = (4.0, 16.0)  # fewer lose what rays could see, more than rays can tell apart would be wasted
MIN_TEXELS = 64.0**2
LOBE_TANGENT = 1.73  # of GGX facets, per alpha: three quarters tilt less
NEARER = 0.25  # of the depth of the nearest pixel: rays that turn back towards the camera


def with_images(
    pixels: ReflectivePixels, bundle: Bundle, made: ClusterCameras, diagonal: float, scale: float, lobe: str
) -> ClusterCameras:
    """The cameras with the extent and resolution of their images."""
    count, height, width = pixels.shape
    place = np.full(count * height * width, -1, np.int32)
    place[pixels.pixel.numpy()] = np.arange(len(pixels), dtype=np.int32)
    slope = math.tan(math.radians(HALF_ANGLE_DEG))
    gloss = torch.zeros(len(made), dtype=torch.float64)
    gloss = gloss.scatter_reduce(0, made.clusters.cluster, pixels.gloss, "amax")
    angle = gloss * math.pi / 6
    if lobe == "ggx":
        angle = (2.0 * torch.atan(LOBE_TANGENT * gloss.square())).clamp_max(math.radians(HALF_ANGLE_DEG))
    lens = torch.stack([angle.sin(), angle.cos()], dim=1)
    frame = torch.cat([made.frame[:, :1] - bundle.origin, made.look, made.frame[:, 3:]], dim=1)
    tail = torch.tensor([[diagonal, slope]], dtype=torch.float64).expand(len(made), 2)
    limits = torch.cat([made.eye - bundle.origin, made.reach[:, None], tail], dim=1)
    images = cluster_fit.Pictures(place, view(pixels.pixel, np.int64), view(made.clusters.cluster, np.int64), width)
    arguments = (view(lens, np.float64), view(frame, np.float64), view(limits, np.float64), images)
    found = bundle.gather(cluster_fit.image_boxes, arguments, "<<>>+++<", made.planar)
    box = torch.where(torch.isfinite(found[:, :4]), found[:, :4], 0.0)
    clear = ((frame[:, 0] - limits[:, :3]) * frame[:, 3]).sum(-1).clamp_min(1e-4 * diagonal)
    single = _single_pitch(pixels, made.clusters) / clear
    pitch = torch.where(found[:, 6] > 0, found[:, 5] / found[:, 6].clamp_min(1.0), single).clamp_min(1e-12)
    middle, half = (box[:, :2] + box[:, 2:]) / 2, (box[:, 2:] - box[:, :2]) / 2
    half = torch.maximum(half + pitch[:, None], 4.0 * pitch[:, None])  # a pixel to spare, eight at least
    half = half.clamp_max(slope)
    size = (2.0 * half / pitch[:, None]).ceil().clamp(*SIDES)
    pixels_of = made.clusters.sizes.double()
    least, most = (n * pixels_of for n in TEXELS_PER_PIXEL)
    texels = (size[:, 0] * size[:, 1]).clamp(least, most).clamp(MIN_TEXELS, max(MIN_TEXELS, 4.0 * height * width))
    size = (size * (scale * scale * texels / (size[:, 0] * size[:, 1])).sqrt()[:, None]).ceil().clamp(*SIDES)
    return replace(
        made,
        box=torch.cat([middle - half, middle + half], dim=1),
        size=size.long(),
        outside=found[:, 4],
        near=(NEARER * found[:, 7]).clamp_min(1e-4 * diagonal),
    )


def _single_pitch(pixels: ReflectivePixels, clusters: PixelClusters) -> Tensor:
    """Width on the surface of one pixel of each cluster, for clusters without neighbouring pixels."""
    some = clusters.order[clusters.starts[:-1]]
    facing = (pixels.view[some] * pixels.normal[some]).sum(-1).abs().clamp_min(1e-3)
    return pixels.pixel_angle[some] * pixels.length[some] / facing
