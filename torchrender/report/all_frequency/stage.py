"""What the study looks at: a model as spheres over a plane of points, skies, and errors in shares of light."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from torchrender.effects.sky_shadows.fit import fit_spheres
from torchrender.effects.sky_shadows.moving import Binding
from torchrender.effects.sky_shadows.occluder import joined
from torchrender.effects.sky_shadows.options import SphereOptions
from torchrender.images.files import read_image
from torchrender.rays import RayCaster
from torchrender.scene.environment import Environment
from torchrender.scene.load import load
from torchrender.scene.mesh import Mesh, concatenate

SKIES = {
    "grace": "grace_latlong_small.hdr",
    "pisa": "pisa_latlong_small.hdr",
    "forest": "forest.hdr",
    "studio": "studio.hdr",
}
SIDE = 128
GAP = 0.01
"""From the plane to the model, in the model's size."""


@dataclass(frozen=True, eq=False)
class Stage:
    """A model over a plane of points."""

    name: str
    model: Mesh
    points: Tensor  # (P,3), rows along z, x within a row
    normals: Tensor
    size: float  # longest side of the model; half the side of the plane
    middle: Tensor  # (3,) of the plane
    caster: RayCaster
    spheres: dict[int, Tensor]  # (S,4) by number
    snug: dict[int, Tensor]  # the same as pictures take them: together they hold the model's volume
    fits: dict[int, float]  # E over the volume

    def some(self, count: int) -> Tensor:
        """Rows of so many points, drawn at random, always the same."""
        return torch.randperm(len(self.points), generator=torch.Generator().manual_seed(0))[:count]


def stage(folder: Path, name: str, numbers: tuple[int, ...], options: SphereOptions) -> Stage:
    """The model, spheres fitted to it, and the plane under it."""
    scene = load(folder / "meshes" / name)
    vertices, faces = joined(scene.meshes)
    low, high = scene.bounds
    middle, size = (low + high) / 2, float((high - low).max())
    middle = torch.tensor([float(middle[0]), float(low[1]) - GAP * size, float(middle[2])], dtype=torch.float64)
    line = torch.linspace(-1.0, 1.0, SIDE, dtype=torch.float64) * size
    z, x = torch.meshgrid(line, line, indexing="ij")
    points = torch.stack([x, torch.zeros_like(x), z], dim=-1) + middle
    sets = {n: fit_spheres(vertices, faces, replace(options, spheres=n)) for n in numbers}
    model = concatenate(scene.meshes)
    return Stage(
        name=Path(name).stem,
        model=Mesh(vertices=vertices, faces=faces, name="model"),
        points=points.reshape(-1, 3),
        normals=torch.tensor([0.0, 1.0, 0.0]).expand(SIDE * SIDE, 3),
        size=size,
        middle=middle,
        caster=RayCaster(model),
        spheres={n: s.spheres for n, s in sets.items()},
        snug={n: Binding(s, vertices, faces).at(vertices, snug=True) for n, s in sets.items()},
        fits={n: s.relative_error for n, s in sets.items()},
    )


def sky(folder: Path, name: str) -> Environment:
    """One of :data:`SKIES`, whole: its sun is not split off."""
    return Environment(radiance=read_image(folder / "envmaps" / SKIES[name])[..., :3].float(), name=name)


def errors(found: Tensor, wanted: Tensor, whole: Tensor) -> dict[str, float]:
    """Root mean square and largest difference in percent of the unshadowed light, and PSNR of the share in dB; no error
    without points."""
    share = ((found - wanted) / whole.clamp_min(1e-30)).double()
    if not share.numel():
        return {"rms": 0.0, "most": 0.0, "psnr": math.inf}
    mean = float(share.square().mean())
    return {
        "rms": 100 * mean**0.5,
        "most": 100 * float(share.abs().max()),
        "psnr": -10 * float(np.log10(max(mean, 1e-30))),
    }
