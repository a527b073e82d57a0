"""Which samples of a set of depth images are redundant, hidden and useful, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.depth.holders import Holder, images_holder, views_holder
from torchrender.depth.options import SamplingOptions
from torchrender.depth.probes import Probes
from torchrender.depth.ray_visibility import RayVisibility
from torchrender.depth.viewpoints import viewpoints_inside
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False)
class SampleKinds:
    """Masks (B,H,W) bool over the pixels of a set of depth images."""

    redundant: Tensor  # an earlier image of the set has the sample
    hidden: Tensor  # no conventional image from the viewpoints has it
    useful: Tensor  # hidden, and one of the views between the viewpoints has it


def sample_kinds(scene: Scene, viewpoints: Cameras, images: DepthImages, *, frames: int = 50) -> SampleKinds:
    """What kind of sample each pixel holds, by the redundancy that sampled the images.

    Args:
        viewpoints: the cameras that the images were asked for, at the size of the images.
        frames: views between the viewpoints; more of them find more useful samples.
    """
    options = SamplingOptions(**images.parameters)
    rays = RayVisibility(scene, options) if options.redundancy == "visibility" else None

    def holder(cameras: Cameras) -> Holder:
        return views_holder(scene, rays, options, rasterize_visibility(scene.geometry, cameras, cull=options.cull))

    masks = [torch.zeros_like(images.covered) for _ in range(3)]
    conventional, left = holder(viewpoints), []
    for number in range(len(images)):
        probes = Probes.of(images, number)
        _mark(masks[0], number, probes, images_holder(scene, rays, images, number)(probes))
        hidden = ~conventional(probes)
        _mark(masks[1], number, probes, hidden)
        left.append(probes[hidden])
    between = viewpoints_inside(viewpoints, frames)
    for frame in range(frames):
        needs = holder(between[frame])
        for number, probes in enumerate(left):
            found = needs(probes)
            _mark(masks[2], number, probes, found)
            left[number] = probes[~found]
    return SampleKinds(*masks)


def median_triangle_pixels(scene: Scene, images: DepthImages) -> float | None:
    """Median projected area, in pixels, of the triangles that the first image shows; None if it shows nothing.

    Below about 2 pixel redundancy misses most repeats: few pixels of another image store the same triangle.
    """
    shown = images.triangle[0][images.covered[0]].unique()
    corners = scene.geometry.vertices[scene.geometry.faces[shown].long()].reshape(-1, 3)
    pixels, _ = images.cameras[0].project(corners)
    a, b, c = pixels[0].reshape(-1, 3, 2).unbind(1)
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]).abs()
    area = area[torch.isfinite(area)]  # a corner behind the camera has no image
    return float(area.median()) if len(area) else None


def _mark(masks: Tensor, number: int, probes: Probes, chosen: Tensor) -> None:
    columns, rows = probes.pixels[chosen].unbind(1)
    masks[number, rows, columns] = True
