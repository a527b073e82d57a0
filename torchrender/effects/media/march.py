"""Steps along every ray: the way of the source, and the reference by rays."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.buffers import ShadowMap
from torchrender.effects.media.eye_rays import EyeRays
from torchrender.effects.media.light_images import views_of
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.tables import LightTable, MediaTable
from torchrender.kernels.media.march import EVERYWHERE, EXACT_SEGMENT, GIVEN, LOOKED_UP, SOURCE, march_rays
from torchrender.kernels.media.records import AXIS, PLACE, SUN, Media, Scattered
from torchrender.rays import RayCaster

CHUNK = 1 << 20
"""Shadow rays cast in one call."""
MARGIN = 1e-5
"""Share of its way by which a shadow ray ends before a lamp, which may stand on something."""


class Marcher:
    """Integrates chosen rays of one light step by step; see :data:`torchrender.effects.media.between.Integrate`."""

    def __init__(
        self, table: MediaTable, light: LightTable, rays: EyeRays, sight: ShadowMap | RayCaster | None,
        options: ScatterOptions,
    ) -> None:  # fmt: skip
        self._media = Media(*(a.astype(np.float64) if a.dtype == np.float32 else a for a in table.arrays))
        self._table, self._light, self._rays, self._options = table, light, rays, options
        self._caster = sight if isinstance(sight, RayCaster) else None
        self._map = sight if isinstance(sight, ShadowMap) else None
        count = len(rays.beams.direction)
        shifts = np.full(count, 0.5)
        if options.jitter:
            shifts = np.random.default_rng(options.seed).random(count)
        self._shifts = shifts

    def __call__(self, rows: np.ndarray, out: Scattered) -> None:
        """Fill the chosen rows of ``out``."""
        options = self._options
        depth, views = np.zeros((1, 1, 1), np.float32), np.zeros((1, 16))
        way, parallel = EVERYWHERE, False
        if self._map is not None:
            way, parallel = LOOKED_UP, self._map.cameras.orthographic
            depth, views = view(self._map.depth, np.float32), views_of(self._map, self._table.origin).astype(np.float64)
        elif self._caster is not None:
            way = GIVEN
        scheme = SOURCE if options.scheme == "source" else EXACT_SEGMENT
        settings = (
            self._light.kind, way, parallel, options.steps, scheme, options.equiangular, options.light_steps
        )  # fmt: skip
        size = max(CHUNK // options.steps, 1)
        for part in np.split(rows, range(size, len(rows), size)) if self._caster is not None else [rows]:
            visible = np.zeros((0, 0), bool)
            beams, shifts, place = self._rays.beams, self._shifts, out
            chosen = part
            if self._caster is not None:  # these rays alone, so that what is known of them needs no more room
                visible = self._traced(part)
                origin = beams.origin[part] if len(beams.origin) > 1 else beams.origin
                beams = beams._replace(origin=origin, direction=beams.direction[part], span=beams.span[part])
                shifts, chosen = shifts[part], np.arange(len(part))
                place = Scattered(out.radiance[part], out.told[part])
            light = self._light.numbers.astype(np.float64)
            march_rays(self._media, light, depth, (views, visible, shifts), beams, chosen, settings, place)
            if self._caster is not None:
                out.radiance[part], out.told[part] = place.radiance, place.told

    def _traced(self, rows: np.ndarray) -> np.ndarray:
        """(P,steps) bool: the samples of these rays see the light, by shadow rays."""
        assert self._caster is not None
        lengths = self.lengths(rows)
        beams = self._rays.beams
        direction = torch.from_numpy(beams.direction[rows]).double()
        origin = torch.from_numpy(beams.origin[rows] if len(beams.origin) > 1 else beams.origin).double()
        places = origin[:, None] + direction[:, None] * lengths[..., None] + self._table.origin
        places = places.reshape(-1, 3)
        numbers = torch.from_numpy(self._light.numbers).double()
        if self._light.kind == SUN:
            toward, limit = (-numbers[AXIS : AXIS + 3]).expand_as(places), math.inf
        else:
            toward, limit = numbers[PLACE : PLACE + 3] + self._table.origin - places, 1.0 - MARGIN
        hidden = self._caster.occluded(places, toward.contiguous(), t_max=limit)
        return view(~hidden.reshape(lengths.shape), np.bool_)

    def lengths(self, rows: np.ndarray) -> Tensor:
        """(P,steps) float64 ray lengths of the samples."""
        steps = self._options.steps
        span = torch.from_numpy(self._rays.beams.span[rows]).double()
        begin, end = span[:, :1], torch.maximum(span[:, 1:], span[:, :1])
        share = (torch.arange(steps) + torch.from_numpy(self._shifts[rows])[:, None]) / steps
        if self._light.kind == SUN or not self._options.equiangular or not self._light.numbers[10] > 0:
            return begin + (end - begin) * share
        beams = self._rays.beams
        origin = torch.from_numpy(beams.origin[rows] if len(beams.origin) > 1 else beams.origin).double()
        direction = torch.from_numpy(beams.direction[rows]).double()
        off = torch.from_numpy(self._light.numbers[PLACE : PLACE + 3]).double() - origin
        t0 = (off * direction).sum(-1, keepdim=True)
        away = (direction * t0 - off).norm(dim=-1, keepdim=True).clamp_min(1e-9)
        first, last = torch.atan2(begin - t0, away), torch.atan2(end - t0, away)
        t = t0 + away * torch.tan(first + (last - first) * share)
        return torch.minimum(torch.maximum(t, begin), end)
