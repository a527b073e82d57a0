"""Glossy light of environment maps beside the sum over all of their pixels: no noise, and no shared look-up.

What differs is the split-sum approximation and the maps that it is read from; the row "split sum" is that approximation
with lobes summed over all pixels, so that the rest is of the maps.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.buffers import GBuffer
from torchrender.images.files import read_image
from torchrender.numerics.ggx import dielectric_fresnel, ggx_alpha, ggx_lobe, half_vector_terms
from torchrender.numerics.lobe import ggx_directions
from torchrender.numerics.split_sum import directional_albedo
from torchrender.quality.timing import take_turns
from torchrender.raster import rasterize
from torchrender.report.shading.mitsuba import IOR, smooth_ball
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.material import Material
from torchrender.scene.model import Scene
from torchrender.scene.sky.irradiance import latlong_directions
from torchrender.shade import shade
from torchrender.shading.sky import MIRRORED_SIDES, SkyMaps

ROUGHNESS = (0.2, 0.4, 0.6)
SIDE, HEIGHT = 16, 96
"""Pixels a side of the pictures of the ball, and rows of the map."""
WHITE = 0.04, 1.0
"""Reflectance along the normal, of a black plastic and of a metal."""
SCALES = (8, 4, 2, 1)
"""By which the sides of the maps of mirrored light are divided."""
RAYS = (1, 4, 16, 64, 256)
TIMED, FEW = 512, 64
"""Pixels a side of pictures that are timed, of maps and of rays."""


@dataclass(frozen=True, eq=False)
class Glossy:
    """A ball under a map."""

    scene: Scene
    gbuffer: GBuffer
    roughness: float
    f0: float

    @classmethod
    def of(cls, sky: Environment, roughness: float, f0: float, side: int = SIDE) -> Glossy:
        """A black plastic, or a white metal where ``f0`` is 1."""
        metal = float(f0 == 1.0)
        material = Material(metallic=metal, roughness=roughness, diffuse=torch.full((3,), metal), ior=IOR)
        scene = Scene(meshes=(smooth_ball(),), materials=(material,), environment=sky)
        camera = Cameras.look_at([0.0, 0.0, 6.0], [0.0, 0.0, 0.0], width=side, height=side, fov_deg=20.0)
        return cls(scene, rasterize(scene, camera), roughness, f0)

    @property
    def sky(self) -> Environment:
        """What lights it."""
        assert self.scene.environment is not None
        return self.scene.environment

    @property
    def pixels(self) -> tuple[Tensor, Tensor, Tensor]:
        """Normals and directions to the eye (N,3), roughness (N,), of what is covered."""
        gbuffer, covered = self.gbuffer, self.gbuffer.covered
        eye = normalize(gbuffer.cameras.eye[0] - gbuffer.position[covered], dim=-1).float()
        normal = gbuffer.normal[covered]
        return normal, eye, torch.full((len(normal),), self.roughness)

    @property
    def again(self) -> Tensor:
        """(N,1) what comes back of the light that one bounce between facets loses."""
        normal, eye, rough = self.pixels
        a, b, _, _ = directional_albedo((normal * eye).sum(-1), rough)
        return (1.0 + self.f0 * (1.0 / (a + b) - 1.0))[:, None]

    def fresnel(self, half: Tensor) -> Tensor:
        """Of facets at these cosines."""
        return torch.ones_like(half) if self.f0 == 1.0 else dielectric_fresnel(IOR**2 - 1.0, half)

    def exact(self) -> Tensor:
        """Radiance (N,3) by the sum over all pixels of the map."""
        return self.sums(*self.pixels)[0] * self.again

    def split_sum(self) -> Tensor:
        """The same, the lobe seen along its normal."""
        normal, eye, rough = self.pixels
        facing = (normal * eye).sum(-1)
        up = 2.0 * facing[:, None] * normal - eye
        a, b, c, _ = directional_albedo(facing, rough)
        mean, weight = Glossy(self.scene, self.gbuffer, self.roughness, 1.0).sums(up, up, rough)
        share = self.f0 * a + b + (0.0 if self.f0 == 1.0 else c)
        return mean / weight[:, None] * share[:, None] * self.again

    def by_rays(self, count: int) -> Tensor:
        """The same by rays about the lobe, each of which looks up the map."""
        normal, eye, rough = self.pixels
        turn = torch.rand(len(rough), generator=torch.Generator().manual_seed(0)) * 2.0 * torch.pi
        toward, weight = ggx_directions(eye, normal, ggx_alpha(rough), count, turn)
        half = (normalize(toward + eye[:, None], dim=-1) * eye[:, None]).sum(-1).clamp(0.0, 1.0)
        return ((weight * self.fresnel(half))[..., None] * self.sky.lookup(toward)).mean(dim=1) * self.again

    def sums(self, normal: Tensor, eye: Tensor, rough: Tensor) -> tuple[Tensor, Tensor]:
        """Light (N,3) that one bounce between facets sends to the eye, pixel by pixel of the map, and the same of a
        white one (N,).
        """
        height, width, _ = self.sky.radiance.shape
        edges = torch.cos(torch.linspace(0, torch.pi, height + 1, dtype=torch.float64))
        solid = ((edges[:-1] - edges[1:]) * 2 * torch.pi / width)[:, None].expand(height, width).reshape(-1, 1)
        colors = self.sky.radiance.reshape(-1, 3).double()
        light = (torch.cat([colors, torch.ones_like(solid)], dim=1) * solid).float()
        toward = latlong_directions(height, width).reshape(-1, 3).float().T
        sums = []
        for n, e, r in zip(normal, eye, rough):
            cosine = n @ toward
            rows = (cosine > 0.0).nonzero().reshape(-1)
            lit, one = toward[:, rows], cosine[rows]
            sine, half = half_vector_terms(n[:, None].expand_as(lit), e[:, None].expand_as(lit), lit)
            lobe = ggx_lobe(sine, one, (n @ e).expand_as(one), ggx_alpha(r.expand_as(one)))
            sums.append((lobe * self.fresnel(half) * one) @ light[rows])
        total = torch.stack(sums)
        return total[:, :3], total[:, 3]


def glossy_of(files: Sequence[Path]) -> list[dict[str, Any]]:
    """A row for each map, material and roughness: ratio of the means, and PSNR against the brightest pixel."""
    skies, rows = [_sky_of(file) for file in files], []
    for one in (Glossy.of(sky, roughness, f0) for sky in skies for f0 in WHITE for roughness in ROUGHNESS):
        row = {"map": one.sky.name, "material": "metal" if one.f0 == 1.0 else "plastic", "roughness": one.roughness}
        wanted = one.exact()
        found = shade(one.scene, one.gbuffer)[one.gbuffer.covered]
        rows.append({**row, "ours": _compared(found, wanted), "split_sum": _compared(one.split_sum(), wanted)})
    return rows


def settings_of(file: Path, runs: int) -> list[dict[str, Any]]:
    """Error and time of ways to read the map: maps of several sizes, and rays; errors of all balls together."""
    picture = _sky_of(file)
    wanted, rows = [one.exact() for one in _balls(picture)], []
    for scale in SCALES:
        sky = replace(picture)  # nothing is made of it yet
        balls, large = _balls(sky), Glossy.of(sky, 0.4, WHITE[0], TIMED)
        begin = time.perf_counter()
        SkyMaps.of(sky, True, [max(side // scale, 2) for side in MIRRORED_SIDES])
        first = 1e3 * (time.perf_counter() - begin)
        found = [shade(one.scene, one.gbuffer)[one.gbuffer.covered] for one in balls]
        spent = take_turns({"one": partial(shade, large.scene, large.gbuffer)}, runs=runs)["one"].record()["median"]
        each = 1e6 * spent / float(large.gbuffer.covered.sum())
        rows.append({"setting": f"maps of {MIRRORED_SIDES[0] // scale} pixels a side", "first": first, "each": each})
        rows[-1] |= _mean_error(found, wanted)
    balls, small = _balls(picture), Glossy.of(picture, 0.4, WHITE[0], FEW)
    for count in RAYS:
        found = [one.by_rays(count) for one in balls]
        spent = take_turns({"one": partial(small.by_rays, count)}, runs=runs)["one"].record()["median"]
        each = 1e6 * spent / float(small.gbuffer.covered.sum())
        rows.append(
            {
                "setting": f"{count} ray{'s' * (count > 1)} a pixel",
                "first": 0.0,
                "each": each,
                **_mean_error(found, wanted),
            }
        )
    return rows


def _balls(sky: Environment) -> list[Glossy]:
    return [Glossy.of(sky, roughness, f0) for f0 in WHITE for roughness in ROUGHNESS]


def _sky_of(file: Path) -> Environment:
    """A map of few enough pixels to sum over."""
    whole = read_image(file)[..., :3].clamp_min(0.0).permute(2, 0, 1)[None]
    picture = torch.nn.functional.adaptive_avg_pool2d(whole, (HEIGHT, 2 * HEIGHT))[0].permute(1, 2, 0)
    return Environment(radiance=picture.contiguous(), name=file.name)


def _mean_error(found: list[Tensor], wanted: list[Tensor]) -> dict[str, float]:
    """PSNR of the mean squared error over several balls, each against its brightest pixel; the worst ratio."""
    rows = [_compared(a, b) for a, b in zip(found, wanted, strict=True)]
    error = torch.tensor([10.0 ** (-row["psnr"] / 10.0) for row in rows]).mean()
    worst = max((row["ratio"] for row in rows), key=lambda ratio: abs(ratio - 1.0))
    return {"psnr": -10.0 * float(torch.log10(error)), "ratio": worst}


def _compared(found: Tensor, wanted: Tensor) -> dict[str, float]:
    error = float((found - wanted).square().mean())
    return {
        "ratio": float(found.mean() / wanted.mean()),
        "psnr": -10.0 * float(torch.log10(torch.tensor(error / float(wanted.max()) ** 2))),
    }
