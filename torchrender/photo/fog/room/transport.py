"""Light on its way from sources to places in a room: what arrives, and through how much air.

Nothing here knows how thick the air is: weights and ways last while only the medium's coefficients change.
Source: specification 12, sections 3 and 9.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.photo.fog.air import Air
from torchrender.photo.fog.room.emitters import Emitter
from torchrender.photo.fog.room.proxy import Proxy
from torchrender.photo.fog.room.shafts import Shafts

MARGIN = 1e-4
"""Share of a way that is left free at either end of a shadow ray."""


@dataclass(frozen=True, eq=False)
class Arriving:
    """Of one source at N places: S samples each."""

    weight: Tensor  # (N,S) float32: times radiance is irradiance, or radiance times solid angle in the air
    way: Tensor  # (N,S) float32 air between
    direction: Tensor | None = None  # (N,S,3) float32 the way the light travels

    def lit(self) -> Tensor:
        """(N,) what arrives without a medium, at unit radiance."""
        return self.weight.sum(dim=1)

    def dimmed(self, extinction: Tensor) -> Tensor:
        """(N,3) what arrives through a medium with extinction (3,)."""
        if bool((extinction == extinction[0]).all()):
            return (self.weight * torch.exp(-extinction[0] * self.way)).sum(dim=1)[:, None].expand(-1, 3)
        return torch.stack([(self.weight * torch.exp(-k * self.way)).sum(dim=1) for k in extinction], dim=1)


def unblocked(proxy: Proxy, start: Tensor, end: Tensor) -> Tensor:
    """(...) bool: nothing stands between places (...,3)."""
    offset = end - start
    hidden = proxy.caster.occluded(
        start.expand_as(offset).reshape(-1, 3), offset.reshape(-1, 3), t_min=MARGIN, t_max=1 - MARGIN,
        cull_backfaces=True,
    )  # fmt: skip
    return ~hidden.reshape(offset.shape[:-1])


def arriving(
    emitter: Emitter, proxy: Proxy, air: Air, places: Tensor, normals: Tensor | None, per_side: int
) -> Arriving:
    """Direct light of an emitter at places (N,3), on surfaces with normals (N,3) or, without these, in the air."""
    samples, areas = emitter.samples(per_side)
    offset = places[:, None] - samples
    square = (offset * offset).sum(dim=-1)
    distance = square.sqrt().clamp_min(1e-9)
    # A sample stands for its cell: nearer than the cell is wide it gets no brighter.
    softened = square + (areas / math.pi)[None] * (0.5 if normals is None else 0.0) + 1e-9
    weight = (offset @ emitter.normal / distance).clamp_min(0.0) * areas / softened
    if normals is not None:
        weight = weight * (-(offset * normals[:, None]).sum(dim=-1) / distance).clamp_min(0.0)
    weight = torch.where(unblocked(proxy, places[:, None], samples.expand_as(offset)), weight, 0.0)
    way = air.between(samples.expand_as(offset), places[:, None].expand_as(offset))
    direction = (offset / distance[..., None]).float() if normals is None else None
    return Arriving(weight.float(), way, direction)


@dataclass(frozen=True, eq=False)
class Paths:
    """Contributions of all random paths to each of N places, with the air along each."""

    weight: Tensor  # (N,K)
    way: Tensor  # (N,K)
    sunny: Tensor  # (K,) bool: contributions of the sun

    def with_sun(self, factor: float) -> Paths:
        """The same paths where the sun is so many times as strong."""
        return Paths(self.weight * torch.where(self.sunny, factor, 1.0), self.way, self.sunny)

    @property
    def lit(self) -> Tensor:
        """(N,) bool: something arrives."""
        return self.weight.sum(dim=1) > 1e-12

    def ratio(self, extinction: Tensor, usual: float) -> Tensor:
        """(N,3) irradiance with the medium over irradiance without; where nothing arrives, that of ``usual`` metres."""
        clear = self.weight.sum(dim=1)
        channels = [(self.weight * torch.exp(-k * self.way)).sum(dim=1) for k in extinction]
        share = torch.stack(channels, dim=1) / clear.clamp_min(1e-20)[:, None]
        return torch.where(self.lit[:, None], share, torch.exp(-extinction * usual)).clamp(0.0, 1.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Sources:
    """All that lights a room, in luminance."""

    emitters: Sequence[Emitter]
    radiance: Sequence[float]
    shafts: Shafts | None
    sun: float  # irradiance across its direction
    ambient: float  # radiance from everywhere


def trace_paths(
    sources: Sources, proxy: Proxy, air: Air, surface: tuple[Tensor, Tensor], albedo: Tensor, *,
    count: int, bounces: int, seed: int,
) -> Paths:  # fmt: skip
    """Random paths from places on surfaces to all sources.

    Args:
        surface: places (N,3) and normals (N,3).
        albedo: (P,) of the proxy's parts.
        count: paths to each place.
    """
    random = torch.Generator().manual_seed(seed)
    places, normals = surface
    n = len(places)
    # All places share their random numbers: what noise is left changes slowly over the picture.
    at, normal = places.repeat_interleave(count, 0), normals.repeat_interleave(count, 0)
    at = at + 1e-6 * normal
    beta, behind = torch.ones(n * count, dtype=torch.float64), torch.zeros(n * count)
    weights, ways, sunny = [], [], []
    for bounce in range(bounces + 1):
        for emitter, radiance in zip(sources.emitters, sources.radiance, strict=True):
            if radiance > 0:
                weight, way = _sampled(emitter, proxy, air, at, normal, count, random)
                weights.append(beta * weight * radiance)
                ways.append(behind + way)
                sunny.append(False)
        if sources.shafts is not None and sources.sun > 0:
            distance, inside = sources.shafts.reach(at)
            cosine = (-(normal @ sources.shafts.direction)).clamp_min(0.0)
            weights.append(beta * torch.where(inside, cosine, 0.0) * sources.sun)
            ways.append(behind + distance.float())
            sunny.append(True)
        if bounce == 0 and sources.ambient > 0:
            weights.append(beta * (math.pi * sources.ambient))
            ways.append(behind + proxy.mean_chord)
            sunny.append(False)
        if bounce == bounces:
            break
        direction = _cosine_directions(normal, count, n, random)
        hits = proxy.caster.first_hit(at, direction, t_min=1e-5, cull_backfaces=True)
        hit = hits.triangle >= 0
        if not bool(hit.any()):
            break
        face = hits.triangle.clamp_min(0)
        length = torch.where(hit, hits.t.double(), 0.0)
        behind = behind + air.ways(at, direction, length)
        beta = torch.where(hit, beta * albedo[proxy.face_part[face]].double(), 0.0)
        normal = proxy.normal[face]
        at = at + direction * length[:, None] + 1e-6 * normal

    def gathered(parts: list[Tensor]) -> Tensor:
        return torch.stack(parts, dim=1).reshape(n, -1).float() if parts else torch.zeros(n, 1)

    from_sun = torch.tensor(sunny).repeat(count) if sunny else torch.zeros(1, dtype=torch.bool)
    return Paths(gathered(weights), gathered(ways), from_sun)


def _sampled(
    emitter: Emitter, proxy: Proxy, air: Air, at: Tensor, normal: Tensor, count: int, random: torch.Generator
) -> tuple[Tensor, Tensor]:
    """Weight and way of one random sample of an emitter for each place; strata over the paths of one place."""
    per_side = max(1, math.isqrt(count))
    cells, areas = emitter.samples(per_side)
    order = torch.randperm(count, generator=random) % len(cells)
    chosen = order.repeat(len(at) // count)
    target = cells[chosen]
    offset = at - target
    square = (offset * offset).sum(dim=-1).clamp_min(1e-9)
    length = square.sqrt()
    cosine = ((offset @ emitter.normal) / length).clamp_min(0.0) * (-(offset * normal).sum(-1) / length).clamp_min(0.0)
    # Each cell's share of the area over how often it is chosen.
    often = torch.bincount(order, minlength=len(cells)).clamp_min(1)
    weight = cosine * (areas * count / often)[chosen] / square
    weight = torch.where(unblocked(proxy, at, target), weight, 0.0)
    return weight, air.between(target, at)


def _cosine_directions(normal: Tensor, count: int, places: int, random: torch.Generator) -> Tensor:
    """(N,3) unit directions about normals, the same numbers for all places."""
    u = (torch.randperm(count, generator=random) + torch.rand(count, generator=random, dtype=torch.float64)) / count
    turn = 2 * math.pi * torch.rand(count, generator=random, dtype=torch.float64)
    radius, height = u.sqrt().repeat(places), (1 - u).clamp_min(0.0).sqrt().repeat(places)
    turn = turn.repeat(places)
    other = torch.where(
        (normal[:, :1].abs() < 0.7), torch.tensor([[1.0, 0, 0]], dtype=torch.float64),
        torch.tensor([[0, 1.0, 0]], dtype=torch.float64),
    )  # fmt: skip
    across = torch.nn.functional.normalize(torch.linalg.cross(other, normal), dim=-1)
    along = torch.linalg.cross(normal, across)
    flat = across * (radius * turn.cos())[:, None] + along * (radius * turn.sin())[:, None]
    return torch.nn.functional.normalize(flat + normal * height[:, None], dim=-1)
