"""Models of the voxel study: real ones where they are, and synthetic ones of any size."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import torch

from torchrender.scene.load import load
from torchrender.scene.mesh import Geometry, Mesh, concatenate


def bumpy_ring(triangles: int) -> Geometry:
    """A closed, bent and bumpy ring of about that many triangles."""
    n = max(int((triangles / 2) ** 0.5), 3)
    u = torch.arange(n, dtype=torch.float64)[:, None] * (2 * torch.pi / n)
    v = torch.arange(n, dtype=torch.float64) * (2 * torch.pi / n)
    radius = 0.30 + 0.04 * torch.sin(9 * u) * torch.sin(7 * v)
    out = 0.62 + radius * torch.cos(v)
    points = torch.stack(
        [out * torch.cos(u), radius * torch.sin(v) + 0.15 * torch.sin(2 * u), out * torch.sin(u)], dim=-1
    )
    turn = torch.tensor([[0.8, 0.36, -0.48], [-0.6, 0.48, -0.64], [0.0, 0.8, 0.6]], dtype=torch.float64)
    i, j = torch.meshgrid(torch.arange(n), torch.arange(n), indexing="ij")
    a, b, c = i * n + j, (i + 1) % n * n + j, i * n + (j + 1) % n
    d = (i + 1) % n * n + (j + 1) % n
    faces = torch.stack([torch.stack([a, c, b], -1), torch.stack([b, c, d], -1)], dim=2).reshape(-1, 3)
    return concatenate([Mesh(vertices=points.reshape(-1, 3) @ turn.T, faces=faces, name="ring")])


def models(real: Sequence[str], synthetic: Sequence[int]) -> Iterator[tuple[str, Geometry]]:
    """Name and triangles of the real models that are found, and of bumpy rings of so many triangles."""
    folder = Path(os.environ.get("TORCHRENDER_DATA", "../shared/data")) / "meshes"
    for name in real:
        if (folder / name).is_file():
            yield name.split(".")[0].replace("_", " "), load(folder / name).geometry
    for count in synthetic:
        yield "bumpy ring", bumpy_ring(count)
