"""Light of single samples, kept as points: what moving pictures shaded, the next ones need not shade again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import VisibilityBuffer
from torchrender.checks import check_no_gradient, check_tensor
from torchrender.effects.upsampling.outlines import pixel_from_world
from torchrender.kernels.warp.gathered import place_samples
from torchrender.scene.model import Scene

MOST = 1 << 16
"""Samples; the oldest go first."""
SAME_SURFACE = 0.01
"""Difference of 1/z, as a share, up to which a sample is of the surface that a pixel shows."""
NEAR = 0.02
"""Of its depth: from so far away a sample of a mirror shows something else."""


@dataclass(frozen=True, eq=False)
class GatheredLight:
    """Samples of one scene, the newest last."""

    points: Tensor  # (N,3) float64 world
    faces: Tensor  # (N,) int64 triangles
    owners: Tensor  # (N,) int64 objects, as the pictures that they were seen in name these
    light: Tensor  # (N,3) linear
    eyes: Tensor  # (N,3) float64 from where they were seen
    reach: Tensor  # (N,) float64 scene units that an eye may be from there

    @classmethod
    def none(cls) -> GatheredLight:
        """Without a sample."""
        far = torch.zeros(0, 3, dtype=torch.float64)
        ids = torch.zeros(0, dtype=torch.int64)
        return cls(far, ids, ids, torch.zeros(0, 3), far, far[:, 0])

    def __len__(self) -> int:
        return len(self.faces)

    def with_samples(self, scene: Scene, seen: VisibilityBuffer, chosen: Tensor, light: Tensor) -> GatheredLight:
        """These, and the light (N,3) of chosen covered pixels (H,W) of one camera, row by row.

        Raises:
            InputError: shapes that do not fit. GradientError: light that asks for gradients.
        """
        check_tensor("chosen", chosen, tuple(seen.depth.shape[1:]))
        check_tensor("light", light, (int(chosen.sum()), 3))
        check_no_gradient("GatheredLight", light=light)
        depth, faces, owners = (getattr(seen, name)[0][chosen] for name in ("depth", "triangle", "object_id"))
        rows, columns = chosen.nonzero().unbind(1)
        pixel = torch.stack([columns + 0.5, rows + 0.5, torch.ones(len(rows))], dim=1).double()
        inverse = seen.cameras.world_from_camera[0].double()
        along = pixel @ torch.linalg.inv(seen.cameras.intrinsics[0].double()).T
        points = (along * depth.double()[:, None]) @ inverse[:3, :3].T + inverse[:3, 3]
        mirrors = torch.tensor([material.is_reflector for material in scene.materials], dtype=torch.bool)
        held = mirrors[scene.geometry.material[faces]]
        reach = torch.where(held, NEAR * depth.double(), torch.inf)
        eyes = inverse[:3, 3].expand(len(points), 3)
        parts = ((self.points, points), (self.faces, faces), (self.owners, owners), (self.light, light))
        return GatheredLight(*(torch.cat(part)[-MOST:] for part in (*parts, (self.eyes, eyes), (self.reach, reach))))

    def place(self, scene: Scene, seen: VisibilityBuffer, wanted: Tensor, light: Tensor) -> None:
        """Write into the light (H,W,3) of one camera's wanted pixels (H,W) what is known of them; these are then not
        wanted any more.

        Raises:
            InputError: shapes that do not fit.
        """
        shape = tuple(seen.depth.shape[1:])
        check_tensor("wanted", wanted, shape)
        check_tensor("light", light, (*shape, 3))
        eye = seen.cameras.world_from_camera[0, :3, 3].double()
        kept = (self.eyes - eye).norm(dim=1) <= self.reach
        own = view(seen.depth[0], np.float32), view(seen.triangle[0], np.int64), view(seen.object_id[0], np.int64)
        samples = (
            view(self.points[kept], np.float64),
            view(self.faces[kept], np.int64),
            view(self.owners[kept], np.int64),
            view(self.light[kept], np.float32),
        )
        matrix = pixel_from_world(seen.cameras)
        materials = view(scene.geometry.material, np.int64)
        place_samples(samples, matrix, own, materials, SAME_SURFACE, view(wanted, np.bool_), view(light, np.float32))
