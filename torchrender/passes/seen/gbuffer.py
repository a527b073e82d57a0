"""The pass ``gbuffer``: what every rendered pixel sees. Its settings are the number of rendered pixels."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import torch

from torchrender.buffers import GBuffer, RaySurface
from torchrender.passes.contract import Amounts, Pass, always
from torchrender.passes.hard import VIEW, HardEffect, Law, Outputs, Subject, difference
from torchrender.passes.outlook import Outlook
from torchrender.passes.settings import settings
from torchrender.pipeline.buffer import Buffer
from torchrender.pipeline.frame import Frame
from torchrender.pipeline.history import RenderHistory
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize

GBUFFER = Buffer("gbuffer", GBuffer, (RaySurface,))


def run(frame: Frame) -> GBuffer:
    """What every rendered pixel sees."""
    return rasterize(frame.scene, frame.view, cull="sides")


def amounts(outlook: Outlook) -> Amounts:
    """Once; pixels; triangles."""
    return (1.0, outlook.pixels, outlook.triangles)


def nothing_more(frame: Frame) -> Mapping[str, float]:
    """A part of the time is spent: what is left is shared out anew."""
    del frame
    return {}


def one_sample(options: RenderOptions, history: RenderHistory) -> RenderOptions:
    """Given samples are as many as they are."""
    del history
    return replace(options, supersample=1.0)


def _attributes(subject: Subject) -> Outputs:
    seen = subject.gbuffer
    local = subject.cameras.transform(seen.position) / subject.unit
    toward = torch.nn.functional.normalize(subject.cameras.rays()[1].double(), dim=-1)
    return {
        "depth": seen.depth / subject.unit,
        "triangle": seen.triangle,
        "material": seen.material,
        "position": torch.where(seen.covered[..., None], local, 0.0),
        "facing": torch.where(seen.covered, (seen.geometric_normal.double() * toward).sum(-1), 0.0),
        "length": seen.normal.norm(dim=-1),
        "barycentric": seen.barycentric,
        "uv": seen.uv,
    }


def _bounds(_: Subject) -> Mapping[str, tuple[float, float]]:
    unlimited = (-torch.finfo(torch.float64).max, torch.finfo(torch.float64).max)
    return {
        "depth": (0.0, math.inf), "position": unlimited, "facing": (-1.0 - 1e-6, 1e-6), "length": (0.0, 1.0 + 1e-5),
        "barycentric": (0.0, 1.0), "uv": (-1e6, 1e6),
    }  # fmt: skip


def _against_rays(subject: Subject, outputs: Outputs) -> float:
    origins, directions = subject.cameras.rays()
    near, far = (v[:, None, None].expand(origins.shape[:3]) for v in (subject.cameras.near, subject.cameras.far))
    hits = subject.caster.first_hit(
        origins.reshape(-1, 3), directions.reshape(-1, 3), t_min=near.reshape(-1), t_max=far.reshape(-1)
    )
    depth = (hits.t / subject.unit).reshape(origins.shape[:3])
    return difference({"depth": outputs["depth"].double()}, {"depth": depth}, 1e-4)


HARD = HardEffect(
    name="gbuffer",
    about=VIEW,
    modules=("raster",),
    run=_attributes,
    bounds=_bounds,
    law=Law(
        text="rays through the pixel centres hit at the same depth: share of pixels where not",
        deviation=_against_rays,
        limit=0.01,
    ),
)

PASS = Pass(
    name="gbuffer",
    summary="rasterises what every pixel sees; its settings are the number of rendered pixels, which all others follow",
    makes=GBUFFER,
    applies=always("every other pass asks it"),
    run=run,
    settings=settings(
        "samples per pixel and side",
        {f"{factor:g}": {"supersample": factor} for factor in (0.25, 0.35, 0.5, 0.7, 1.0, 1.5, 2.0)},
    ),
    amounts=amounts,
    one_cost=True,
    checkpoint=nothing_more,
    over_samples=one_sample,
    over_hits=one_sample,
    hard=(HARD,),
)
