"""Some pixels of a picture, whose light is found by the slowest and surest ways: whole pictures take too long."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.media.eye_rays import EyeRays, eye_of, rays_along
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import scatter_along
from torchrender.effects.media.tables import MediaTable
from torchrender.report.scattering.stage import Stage, shaft_edges


@dataclass(frozen=True, eq=False)
class Probes:
    """N pixels of a picture: half of them are from anywhere, half are from the edges of shafts."""

    stage: Stage
    table: MediaTable
    rays: EyeRays
    chosen: Tensor  # (N,) int64 rows of the picture's pixels
    anywhere: int  # so many of them, the first ones, are from anywhere

    @classmethod
    def of(cls, stage: Stage, light: Tensor, count: int, seed: int = 0) -> Probes:
        """``count`` of either sort, without repetition; ``light`` (H,W) tells where the edges are."""
        draw = torch.Generator().manual_seed(seed)
        edge = torch.nonzero(shaft_edges(light).reshape(-1))[:, 0]
        anywhere = torch.randperm(light.numel(), generator=draw)[:count]
        chosen = torch.cat([anywhere, edge[torch.randperm(len(edge), generator=draw)[:count]]])
        eye = eye_of(stage.camera)
        table = MediaTable.of(stage.scene.media, eye)
        depth = stage.seen.depth.reshape(-1)[chosen].double()
        way = stage.seen.position.reshape(-1, 3)[chosen].double() - eye
        _, direction = stage.camera.rays()
        straight = direction[0].reshape(-1, 3)[chosen].double()
        # Surfaces are where they were found to be; where there is none, rays pass the pixels' centres.
        way = torch.where(torch.isfinite(depth)[:, None], way, straight)
        size = way.norm(dim=1)
        length = torch.where(torch.isfinite(depth), size, torch.inf)
        rays = rays_along(eye.expand(len(chosen), 3), way / size[:, None], length, table)
        return cls(stage, table, rays, chosen, len(anywhere))

    def light(self, **options: Any) -> Tensor:
        """(N,) float64 scattered light of the pixels, each by itself."""
        how = ScatterOptions(block=1, **options)
        _, scattered, _ = scatter_along(self.rays, self.table, self.stage.lit, how)
        return scattered[0, :, 0].double()

    def errors(self, picture: Tensor, wanted: Tensor) -> dict[str, float]:
        """RMSE over the mean light of a picture (H,W) at the pixels from anywhere, and at those from edges, "edge"."""
        found = picture.reshape(-1)[self.chosen]
        parts = {"rmse": slice(0, self.anywhere), "edge": slice(self.anywhere, None)}
        made = {}
        for name, part in parts.items():
            off, mean = found[part] - wanted[part], wanted[part].mean()
            made[name] = float(off.square().mean().sqrt() / mean.clamp_min(1e-12))
        return made
