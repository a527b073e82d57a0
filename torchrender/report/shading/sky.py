"""Diffuse light of environment maps by direction, beside the sum over all of their pixels."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.images.files import read_image
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight
from torchrender.scene.model import Scene
from torchrender.scene.sky.irradiance import latlong_directions
from torchrender.shading.sky import Sky

SUFFIXES = (".hdr", ".exr")


def irradiance_of(folder: Path, directions: int) -> list[dict[str, Any]]:
    """Errors of each map in a folder: what :meth:`Environment.irradiance` says, and what pictures are lit by.

    Pictures take a sun out of the map and the rest from an octahedral map; both together are compared.
    """
    rows = []
    toward = spread(directions)
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix not in SUFFIXES:
            continue
        radiance = read_image(file)[..., :3].clamp_min(0.0)
        exact = integral(radiance, toward)
        whole = Environment(radiance=radiance)
        rest, sun = whole.split_sun()
        lit = math.pi * Sky(Scene(environment=rest)).diffuse(toward.T).T + _of_sun(sun, toward)
        rows.append(
            {
                "map": file.name,
                "sun": sun is not None,
                "irradiance": _errors(whole.irradiance(toward), exact),
                "pictures": _errors(lit, exact),
            }
        )
    return rows


def spread(count: int) -> Tensor:
    """(N,3) unit directions, evenly over the sphere (Fibonacci's spiral)."""
    step = torch.arange(count, dtype=torch.float64) + 0.5
    y = 1.0 - 2.0 * step / count
    turn = step * (math.pi * (3.0 - math.sqrt(5.0)))
    across = (1.0 - y * y).sqrt()
    return torch.stack([across * turn.cos(), y, across * turn.sin()], dim=-1).float()


def integral(radiance: Tensor, normals: Tensor) -> Tensor:
    """Irradiance (N,3), pixel by pixel."""
    height, width, _ = radiance.shape
    edges = torch.cos(torch.linspace(0, math.pi, height + 1, dtype=torch.float64))
    solid = ((edges[:-1] - edges[1:]) * 2 * math.pi / width)[:, None].expand(height, width).reshape(-1, 1)
    light = (radiance.reshape(-1, 3).double() * solid).float()
    directions = latlong_directions(height, width).reshape(-1, 3)
    return torch.cat([(part @ directions.T).clamp_min(0.0) @ light for part in normals.split(16)])


def _of_sun(sun: DirectionalLight | None, toward: Tensor) -> Tensor:
    if sun is None:
        return torch.zeros(len(toward), 3)
    return (toward @ -sun.direction).clamp_min(0.0)[:, None] * sun.irradiance


def _errors(found: Tensor, exact: Tensor) -> dict[str, float]:
    """Relative errors of all directions and colours."""
    error = (found / exact.clamp_min(1e-12) - 1.0).abs()
    return {"mean": float(error.mean()), "largest": float(error.max())}
