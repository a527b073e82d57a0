"""Glossy light of environment maps beside the sum over all of their pixels: no noise, and no shared look-up.

What differs is the split-sum approximation and the maps that it is read from; the row "split sum" is that approximation
with lobes summed over all pixels, so that the rest is of the maps.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchrender.images.files import read_image
from torchrender.numerics.ggx import dielectric_fresnel, ggx_alpha, ggx_lobe, half_vector_terms
from torchrender.numerics.split_sum import directional_albedo
from torchrender.raster import rasterize
from torchrender.report.shading.mitsuba import IOR, smooth_ball
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.sky.irradiance import latlong_directions
from torchrender.shade import shade

ROUGHNESS = (0.2, 0.4, 0.6)
SIDE, HEIGHT = 16, 96
"""Pixels a side of the pictures of the ball, and rows of the map."""
WHITE = 0.04, 1.0
"""Reflectance along the normal, of a black plastic and of a metal."""


def glossy_of(file: Path) -> list[dict[str, Any]]:
    """A row for each material and roughness: ratio of the means, and PSNR against the brightest pixel."""
    whole = read_image(file)[..., :3].clamp_min(0.0).permute(2, 0, 1)[None]
    picture = torch.nn.functional.adaptive_avg_pool2d(whole, (HEIGHT, 2 * HEIGHT))[0].permute(1, 2, 0).contiguous()
    return [_row(Environment(radiance=picture), roughness, f0) for f0 in WHITE for roughness in ROUGHNESS]


def _row(sky: Environment, roughness: float, f0: float) -> dict[str, Any]:
    metal = f0 == 1.0
    material = Material(metallic=float(metal), roughness=roughness, diffuse=torch.full((3,), float(metal)), ior=IOR)
    scene = Scene(meshes=(smooth_ball(),), materials=(material,), environment=sky)
    camera = Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=SIDE, height=SIDE, fov_deg=20.0)
    gbuffer = rasterize(scene, camera)
    covered = gbuffer.covered
    normal = gbuffer.normal[covered]
    eye = torch.nn.functional.normalize(camera.eye[0] - gbuffer.position[covered], dim=-1).float()
    facing = (normal * eye).sum(-1)
    rough = torch.full_like(facing, roughness)
    a, b, c, _ = directional_albedo(facing, rough)
    again = (1.0 + f0 * (1.0 / (a + b) - 1.0))[:, None]
    wanted = _sums(sky.radiance, normal, eye, f0, rough)[0] * again
    up = 2.0 * facing[:, None] * normal - eye
    mean, weight = _sums(sky.radiance, up, up, 1.0, rough)
    split = mean / weight[:, None] * (f0 * a + b + (0.0 if f0 == 1.0 else c))[:, None] * again
    found = shade(scene, gbuffer)[covered]
    row = {"material": "metal" if metal else "plastic", "roughness": roughness}
    return {**row, "ours": _compared(found, wanted), "split_sum": _compared(split, wanted)}


def _sums(radiance: Tensor, normal: Tensor, eye: Tensor, f0: float, rough: Tensor) -> tuple[Tensor, Tensor]:
    """Light (N,3) that one bounce between facets sends to the eye, pixel by pixel of the map (H,W,3), and the same of a
    white one (N,).
    """
    height, width, _ = radiance.shape
    edges = torch.cos(torch.linspace(0, torch.pi, height + 1, dtype=torch.float64))
    solid = ((edges[:-1] - edges[1:]) * 2 * torch.pi / width)[:, None].expand(height, width).reshape(-1, 1)
    light = (torch.cat([radiance.reshape(-1, 3).double(), torch.ones_like(solid)], dim=1) * solid).float()
    toward = latlong_directions(height, width).reshape(-1, 3).float().T
    sums = []
    for n, e, r in zip(normal, eye, rough):
        cosine = n @ toward
        rows = (cosine > 0.0).nonzero().reshape(-1)
        lit, one = toward[:, rows], cosine[rows]
        sine, half = half_vector_terms(n[:, None].expand_as(lit), e[:, None].expand_as(lit), lit)
        facing = (n @ e).expand_as(one)
        lobe = ggx_lobe(sine, one, facing, ggx_alpha(r.expand_as(one)))
        fresnel = torch.ones_like(half) if f0 == 1.0 else dielectric_fresnel(IOR**2 - 1.0, half)
        sums.append((lobe * fresnel * one) @ light[rows])
    total = torch.stack(sums)
    return total[:, :3], total[:, 3]


def _compared(found: Tensor, wanted: Tensor) -> dict[str, float]:
    error = float((found - wanted).square().mean())
    return {
        "ratio": float(found.mean() / wanted.mean()),
        "psnr": -10.0 * float(torch.log10(torch.tensor(error / float(wanted.max()) ** 2))),
    }
