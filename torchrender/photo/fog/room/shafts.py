"""Shafts of sunlight: hulls between windows and the floor they light.

Source: specification 12, section 4: inside a hull the sun shines, outside of all of them it does not.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from scipy.spatial import ConvexHull, QhullError
from torch import Tensor

from torchrender.effects.media.phase import henyey_greenstein
from torchrender.photo.fog.air import Air, held_back
from torchrender.photo.fog.options import FogMedium, FogWarning

FLATTEST = 1e-6
"""Cubic metres below which a hull is flat."""


@dataclass(frozen=True, eq=False)
class Hull:
    """One convex part of a shaft."""

    planes: Tensor  # (P,4) float64: normal out of the hull, and offset: inside n.x + o <= 0
    window: Tensor  # (4,) float64 the window's plane: normal into the room, offset
    volume: float


@dataclass(frozen=True, eq=False)
class Shafts:
    """All shafts of one sun."""

    hulls: tuple[Hull, ...]
    direction: Tensor  # (3,) float64 unit, the way the light travels

    def reach(self, places: Tensor, slack: float = 0.02) -> tuple[Tensor, Tensor]:
        """Air between the window and places (N,3), 0 outside of all shafts, and which lie in one, (N,) bool."""
        best = torch.full(places.shape[:-1], torch.inf, dtype=torch.float64)
        for hull in self.hulls:
            inside = (places @ hull.planes[:, :3].T + hull.planes[:, 3] <= slack).all(dim=-1)
            best = torch.where(inside, torch.minimum(best, self.from_window(hull, places)), best)
        inside = torch.isfinite(best)
        return torch.where(inside, best, 0.0), inside

    def from_window(self, hull: Hull, places: Tensor) -> Tensor:
        """(...) metres along the light from the window's plane to places (...,3)."""
        slope = float(self.direction @ hull.window[:3])
        return ((places @ hull.window[:3] + hull.window[3]) / max(slope, 1e-3)).clamp_min(0.0)


def build_shafts(windows: Sequence[tuple[Tensor, Tensor, Tensor, str]], direction: Tensor) -> Shafts | None:
    """Shafts of windows: corners (m,3), lit floor (m,3), the window's normal into the room (3,), and a name each.

    A window with a concave outline gets one hull for each triangle. Flat ones, where window and lit floor lie in one
    plane, give no shaft, with a warning. None if none is left.
    """
    hulls = []
    for corners, lit, normal, name in windows:
        plane = torch.cat([normal, -(corners.mean(dim=0) @ normal)[None]])
        made = 0
        for part in _convex_parts(corners, normal):
            try:
                hull = ConvexHull(torch.cat([corners[part], lit[part]]).numpy())
            except QhullError:
                continue
            if hull.volume > FLATTEST:
                hulls.append(Hull(torch.from_numpy(hull.equations.copy()), plane, float(hull.volume)))
                made += 1
        if not made:
            warnings.warn(f"{name} and its lit floor lie in one plane: it has no shaft", FogWarning, stacklevel=3)
    return Shafts(tuple(hulls), direction) if hulls else None


def _convex_parts(corners: Tensor, normal: Tensor) -> list[list[int]]:
    """Corner numbers of convex parts: all, or triangles by cutting ears."""
    left = list(range(len(corners)))

    def turn(a: int, b: int, c: int) -> float:
        return float(torch.linalg.cross(corners[b] - corners[a], corners[c] - corners[b]) @ normal)

    turns = [turn(left[k - 1], left[k], left[(k + 1) % len(left)]) for k in left]
    size = max(abs(t) for t in turns)
    sign = 1.0 if sum(_areas(corners, normal)) > 0 else -1.0
    if all(sign * t >= -1e-9 * size for t in turns):
        return [left]
    parts = []
    while len(left) > 3:
        for k in range(len(left)):
            a, b, c = left[k - 1], left[k], left[(k + 1) % len(left)]
            others = [p for p in left if p not in (a, b, c)]
            ear = sign * turn(a, b, c) > 0 and not any(
                all(sign * turn_at(corners, normal, i, j, p) >= 0 for i, j in ((a, b), (b, c), (c, a))) for p in others
            )
            if ear:
                parts.append([a, b, c])
                del left[k]
                break
        else:  # an outline that crosses itself has no ears
            return [*parts, left]
    return [*parts, left]


def turn_at(corners: Tensor, normal: Tensor, i: int, j: int, p: int) -> float:
    """Positive where a corner lies to the left of an edge."""
    return float(torch.linalg.cross(corners[j] - corners[i], corners[p] - corners[i]) @ normal)


def _areas(corners: Tensor, normal: Tensor) -> list[float]:
    fan = corners[1:] - corners[0]
    return [float(v) for v in torch.linalg.cross(fan[:-1], fan[1:]) @ normal]


def spans(shafts: Shafts, origin: Tensor, direction: Tensor, length: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Where rays run inside shafts: begins and ends (K,N), disjoint for each ray, and the hull of each (K,N).

    Args:
        origin: (3,) float64. direction: (N,3) unit. length: (N,).
    """
    begins, ends = [], []
    for hull in shafts.hulls:
        speed = direction @ hull.planes[:, :3].T
        above = origin @ hull.planes[:, :3].T + hull.planes[:, 3]
        t = -above / torch.where(speed.abs() < 1e-12, 1e-12, speed)
        enter = torch.where(speed < 0, t, -torch.inf).amax(dim=1)
        leave = torch.where(speed > 0, t, torch.inf).amin(dim=1)
        parallel_out = ((speed.abs() < 1e-12) & (above > 0)).any(dim=1)
        begin = enter.clamp_min(0.0)
        end = torch.minimum(leave, length)
        end = torch.where(parallel_out, begin, end)
        begins.append(begin)
        ends.append(torch.maximum(end, begin))
    begin, order = torch.sort(torch.stack(begins), dim=0)
    end = torch.stack(ends).gather(0, order)
    # Shafts may overlap, but there is one sun: each goes on where those before it ended.
    reached = torch.cummax(end, dim=0).values
    begin[1:] = torch.maximum(begin[1:], reached[:-1])
    return begin, torch.maximum(end, begin), order


@dataclass(frozen=True, eq=False)
class ShaftWays:
    """Rays of sight that run through one shaft after the other: all that does not depend on the medium."""

    rows: Tensor  # (M,) int64 of the rays
    direction: Tensor  # (M,3) float64
    cosine: Tensor  # (M,) float64 between the light's way and that to the eye
    begin: Tensor  # (M,) where the ray enters
    end: Tensor  # (M,) and leaves
    first: Tensor  # (M,) air between window and entry
    grows: Tensor  # (M,) how fast that grows along the ray


def shaft_ways(shafts: Shafts, origin: Tensor, direction: Tensor, length: Tensor) -> list[ShaftWays]:
    """One record for the first, second, ... shaft that rays meet. Arguments as in :func:`spans`."""
    begin, end, order = spans(shafts, origin, direction, length)
    windows, found = torch.stack([h.window for h in shafts.hulls]), []
    for k in range(len(shafts.hulls)):
        rows = (end[k] > begin[k]).nonzero()[:, 0]
        if not len(rows):
            continue
        d, b, e, planes = direction[rows], begin[k][rows], end[k][rows], windows[order[k][rows]]
        slope = (planes[:, :3] @ shafts.direction).clamp_min(1e-3)
        near = ((origin + d * b[:, None]) * planes[:, :3]).sum(-1) + planes[:, 3]
        grows = (d * planes[:, :3]).sum(-1) / slope
        found.append(ShaftWays(rows, d, -(d @ shafts.direction), b, e, (near / slope).clamp_min(0.0), grows))
    return found


def shaft_light(
    shafts: Shafts, origin: Tensor, direction: Tensor, length: Tensor, medium: FogMedium, air: Air, steps: int,
    ways: list[ShaftWays] | None = None,
) -> Tensor:  # fmt: skip
    """(N,3) float32 light of the sun, at unit irradiance, that shafts scatter to the eye.

    In even air by the closed form of the integral, in grids by steps. Arguments as in :func:`spans`; ``ways``, of
    :func:`shaft_ways` for the same rays, where they are known.
    """
    total = torch.zeros(len(direction), 3)
    grey = bool((medium.extinction == medium.extinction[0]).all())
    extinction = (medium.extinction[:1] if grey else medium.extinction).double()
    for way in shaft_ways(shafts, origin, direction, length) if ways is None else ways:
        if air.density is None:
            rate = extinction * (1 + way.grows)[:, None]
            start = torch.exp(-extinction * (way.begin + way.first)[:, None])
            found = start * held_back(rate, (way.end - way.begin)[:, None])
        else:
            span = (way.begin, way.end, way.first, way.grows)
            found = _stepped(shafts, air, medium, origin, way.direction, span, steps)
        phase = henyey_greenstein(way.cosine, medium.asymmetry)
        total[way.rows] += (found * phase[:, None]).float() * medium.scattering
    return total


def _stepped(
    shafts: Shafts, air: Air, medium: FogMedium, origin: Tensor, direction: Tensor, span: tuple[Tensor, ...], steps: int
) -> Tensor:
    begin, end, first, grows = span
    seen = air.ways(origin[None], direction, begin).double()
    step = (end - begin) / steps
    total = torch.zeros(len(direction), 3, dtype=torch.float64)
    for k in range(steps):
        along = (k + 0.5) * step
        place = origin + direction * (begin + along)[:, None]
        density = air.at(place).double()
        away = (first + grows * along).clamp_min(0.0)
        towards = air.ways(place, -shafts.direction.expand_as(place), away).double()
        lost = medium.extinction.double() * (seen + density * step / 2 + towards)[:, None]
        total += torch.exp(-lost) * (density * step)[:, None]
        seen = seen + density * step
    return total
