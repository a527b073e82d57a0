"""Samples as lists of points, and the pixel-redundancy test on them (specification 01, sections 4 and 13)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view as numpy_view
from torchrender.buffers import VisibilityBuffer
from torchrender.fragment_tests import FragmentTests, earlier_arrays, view_arrays
from torchrender.kernels.raster.fragments import redundant_samples
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Geometry


@dataclass(frozen=True, eq=False)
class Probes:
    """N samples that one camera took."""

    camera: Cameras  # a batch of one
    pixels: Tensor  # (N,2) int64 column and row
    depth: Tensor  # (N,) camera z
    triangle: Tensor  # (N,) int64

    @classmethod
    def of(cls, images: VisibilityBuffer, number: int, stride: int = 1) -> Probes:
        """The filled pixels of image ``number``, every ``stride``-th along both axes, from the middle of each cell."""
        first = stride // 2
        rows, columns = images.covered[number, first::stride, first::stride].nonzero().unbind(1)
        rows, columns = rows * stride + first, columns * stride + first
        pixels = torch.stack([columns, rows], dim=1)
        return cls(
            images.cameras[number], pixels, images.depth[number][rows, columns], images.triangle[number][rows, columns]
        )

    def __len__(self) -> int:
        return len(self.triangle)

    def __getitem__(self, chosen: Tensor) -> Probes:
        """Some of the samples, by mask or index."""
        return Probes(self.camera, self.pixels[chosen], self.depth[chosen], self.triangle[chosen])

    def points(self) -> Tensor:
        """World positions (N,3) float64."""
        return self.camera.unproject(self.pixels[None] + 0.5, self.depth[None])[0]


def pixel_redundant(probes: Probes, tests: FragmentTests, geometry: Geometry) -> Tensor:
    """(N,) bool: an image of ``tests.earlier`` has the sample; decided by the rasteriser's own arithmetic."""
    found = np.zeros(len(probes), np.bool_)
    if not len(probes) or tests.earlier is None or not len(tests.earlier.cameras):
        return torch.from_numpy(found)
    camera = probes.camera
    view = view_arrays(camera, 0, camera.world_from_camera[0].numpy(), camera.frustum_planes()[0].numpy())
    earlier = earlier_arrays(camera, 0, tests, view)
    centre = torch.tensor([camera.width >> 1, camera.height >> 1])
    spot = numpy_view(probes.pixels - centre + 0.5, np.float64)
    key = 1.0 / numpy_view(probes.depth, np.float64)
    slope = np.zeros((len(probes), 2))
    if tests.test != "identity" or np.isfinite(tests.quality_ratio):
        slope = _slopes(probes, geometry, view.matrix, view.reference)
    redundant_samples(numpy_view(probes.triangle, np.int64), spot, key, slope, earlier, found)
    return torch.from_numpy(found)


def _slopes(probes: Probes, geometry: Geometry, matrix: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Steps (N,2) of 1/z per pixel on the planes of the samples' triangles; 0 for planes through the eye."""
    corners = geometry.vertices.numpy()[geometry.faces.numpy()[probes.triangle.numpy()]] - reference
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    distance = (normal * corners[:, 0]).sum(axis=1, keepdims=True)
    covector = normal @ np.linalg.inv(matrix)
    away = np.abs(distance) > 0
    return np.ascontiguousarray(np.where(away, covector / np.where(away, distance, 1.0), 0.0)[:, :2])
