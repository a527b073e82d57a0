"""Sampling by depth images, meshes rebuilt from them, and views drawn from them, each seen from between the viewpoints.

All three show what three depth images know of the scene from a place between their viewpoints, beside the scene drawn
from there: what no image has is black.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import torch
from torch import Tensor

from torchrender.buffers import DepthImages, GBuffer
from torchrender.depth.options import SamplingOptions
from torchrender.depth.sample import sample_depth_images, sample_offset_images
from torchrender.depth.viewpoints import cameras_between, viewpoints_around
from torchrender.raster import rasterize, surface_attributes
from torchrender.reconstruct.corners import fit_corners
from torchrender.reconstruct.discs import reconstruct_discs
from torchrender.reconstruct.hybrid import Reconstruction, reconstruct_grid, reconstruct_hybrid
from torchrender.reconstruct.reproject import Reprojection, reproject
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.shade import shade
from torchrender.tuning.systems.system import System, Trial

VIEWS, SPREAD = 3, 0.05
"""Depth images, and the side of the triangle of their viewpoints in diagonals of the scene."""
WEIGHTS = (0.2, 0.3, 0.5)
"""Of the viewpoints, in the view that is drawn: none of them, nor their middle, from which layers are peeled."""


class _Subject:
    """A scene, its viewpoints, and how it looks from between them."""

    def __init__(self, scene: Scene, size: int) -> None:
        camera = scene.camera(width=size, height=size)
        self.scene = scene
        self.cameras: Cameras = viewpoints_around(scene, camera, VIEWS, spread=SPREAD)
        self.target: Cameras = cameras_between(self.cameras, torch.tensor([WEIGHTS]))
        self.truth: GBuffer = rasterize(scene, self.target, cull="back")

    def sampled(self, method: str, views: int = VIEWS, **changes: Any) -> DepthImages:
        """Depth images of the first viewpoints."""
        return sample_depth_images(self.scene, self.cameras[:views], SamplingOptions(method=method, **changes))

    def shaded(self, images: DepthImages) -> DepthImages:
        """With the scene's radiance at each sample as colour."""
        color = shade(self.scene, surface_attributes(self.scene, images))
        return replace(images, color=torch.where(images.covered[..., None], color, 0.0))

    def kept(self) -> tuple[DepthImages, DepthImages]:
        """Non-redundant images with colours, and their offset images."""
        images = self.sampled("nonredundant")
        return self.shaded(images), sample_offset_images(self.scene, images)

    def reference(self) -> Tensor:
        """The scene drawn from between the viewpoints."""
        return torch.where(self.truth.covered[..., None], shade(self.scene, self.truth), 0.0)

    def missing(self, valid: Tensor) -> float:
        """Share of what is seen there that a picture does not have."""
        covered = self.truth.covered
        return float((covered & ~valid).sum()) / max(float(covered.sum()), 1.0)


def _sampling(scene: Scene, size: int) -> Trial:
    subject = _Subject(scene, size)

    def drawn(images: DepthImages) -> Reprojection:
        return reproject(subject.shaded(images), subject.target)

    return Trial(
        settings={
            "one image": partial(subject.sampled, "conventional", 1),
            "conventional": partial(subject.sampled, "conventional"),
            "peeled": partial(subject.sampled, "depth_peeling"),
            "non-redundant": partial(subject.sampled, "nonredundant"),
            "non-redundant, by rays": partial(subject.sampled, "nonredundant", redundancy="visibility"),
        },
        picture=lambda images: drawn(images).color,
        reference=subject.reference,
        own=lambda images: subject.missing(drawn(images).valid),
    )


def _reconstruction(scene: Scene, size: int) -> Trial:
    subject = _Subject(scene, size)
    images, offset = subject.kept()

    def seen(made: Reconstruction) -> tuple[Scene, GBuffer]:
        own = Material(diffuse=torch.ones(3), unlit=True)
        meshes = tuple(made.mesh(number) for number in range(len(images)))
        rebuilt = Scene(meshes=tuple(mesh for mesh in meshes if len(mesh.faces)), materials=(own,))
        return rebuilt, rasterize(rebuilt, subject.target, cull="back")

    def picture(made: Reconstruction) -> Tensor:
        rebuilt, gbuffer = seen(made)
        return torch.where(gbuffer.covered[..., None], shade(rebuilt, gbuffer), 0.0)

    return Trial(
        settings={
            "grid": partial(reconstruct_grid, images),
            "discs": partial(reconstruct_discs, images),
            "hybrid": partial(reconstruct_hybrid, images),
            "hybrid, offset images": partial(reconstruct_hybrid, images, offset),
        },
        picture=picture,
        reference=subject.reference,
        own=lambda made: subject.missing(seen(made)[1].covered),
    )


def _reprojection(scene: Scene, size: int) -> Trial:
    subject = _Subject(scene, size)
    images, offset = subject.kept()
    quads = fit_corners(images, offset)
    work: dict[str, Callable[[], Reprojection]] = {
        "splat": partial(reproject, images, subject.target, method="splat"),
        "grid": partial(reproject, images, subject.target, method="grid"),
        "hybrid": partial(reproject, images, subject.target),
        "hybrid, fitted before": partial(reproject, quads, subject.target),
        "hybrid, offset images": partial(reproject, images, subject.target, offset_images=offset),
    }
    return Trial(
        settings=work,
        picture=lambda made: made.color,
        reference=subject.reference,
        own=lambda made: subject.missing(made.valid),
    )


SAMPLING = System(
    name="depth_sampling",
    summary="samples a scene by depth images from a few viewpoints; each set is drawn from between them",
    reference="the scene drawn from there",
    own="missing",
    trial=_sampling,
)
RECONSTRUCTION = System(
    name="reconstruction",
    summary="rebuilds meshes from three non-redundant depth images, drawn from between their viewpoints",
    reference="the scene drawn from there",
    own="missing",
    trial=_reconstruction,
)
REPROJECTION = System(
    name="reprojection",
    summary="draws a view from between three non-redundant depth images of others",
    reference="the scene drawn from there",
    own="missing",
    trial=_reprojection,
)
