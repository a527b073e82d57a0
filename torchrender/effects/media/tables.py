"""Media and lights as the kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.effects.media.options import ScatterOptions
from torchrender.kernels.media.airlight import fill_airlight
from torchrender.kernels.media.records import (
    AMBIENT,
    AREA,
    AXIS,
    FADE,
    FLAT,
    GRID,
    HEIGHT,
    INNER,
    LAMP,
    LIGHT_NUMBERS,
    NEAREST,
    OUTER,
    PLACE,
    RECT,
    SPOT,
    SQUARE,
    SUN,
    Media,
)
from torchrender.kernels.media.ways import light_means
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.medium import Medium

AIRLIGHT = (128, 1024)
"""Rows and columns of the table for lamps in a homogeneous medium."""
THICKEST = 12.0
"""Optical depth from a lamp beyond which its table is too coarse."""
FINER = 3
"""Means towards a light have up to so many cells for each of a grid's own: they bend at its sides, too."""
NOTHING = np.zeros((1, 1, 1), np.float32)


def _apart(medium: Medium) -> list[Medium]:
    """Media whose density scales all that they do: where it scales absorption alone, two of them in one place."""
    if medium.density_scales == "both":
        return [medium]
    scatters = replace(
        medium, absorption=torch.zeros(3), emission=torch.zeros(3), density=1.0, falloff=0.0, floor=None,
        density_scales="both",
    )  # fmt: skip
    return [replace(medium, scattering=torch.zeros(3), density_scales="both"), scatters]


@dataclass(frozen=True, eq=False)
class MediaTable:
    """Media as the kernels read them, relative to an origin.

    Where extinction and scattering have one colour in all media, one channel is integrated for all three.
    """

    media: tuple[Medium, ...]
    origin: Tensor  # (3,) float64
    arrays: Media
    tint: Tensor  # (3,) factors of the integrated channels; three channels: ones
    extinction: Tensor  # (M,3) 1/unit

    @classmethod
    def of(cls, media: Sequence[Medium], origin: Tensor) -> MediaTable:
        """Those that are not empty."""
        kept = tuple(part for medium in media if not medium.is_empty for part in _apart(medium) if not part.is_empty)
        count = len(kept)
        low = np.array([(m.low.double() - origin).tolist() for m in kept], np.float32).reshape(count, 3)
        high = np.array([(m.high.double() - origin).tolist() for m in kept], np.float32).reshape(count, 3)
        numbers, kinds, dims = [], [], []
        cells: list[np.ndarray] = []
        for medium in kept:
            kind, amount, first = FLAT, 1.0, sum(c.size for c in cells)
            if isinstance(medium.density, Tensor):
                kind = GRID
                cells.append(view(medium.density, np.float32))
                dims.append([*medium.density.shape, first])
            else:
                kind, amount = (HEIGHT if medium.falloff > 0 else FLAT), float(medium.density)
                dims.append([1, 1, 1, 0])
            numbers.append([amount, medium.falloff, medium.ground - float(origin[1]), medium.asymmetry])
            kinds.append(kind)
        extinction = torch.stack([m.extinction for m in kept]) if count else torch.zeros(0, 3)
        scattering = torch.stack([m.scattering for m in kept]) if count else torch.zeros(0, 3)
        grey = bool((extinction == extinction[:, :1]).all())
        tint = _common_tint(scattering) if grey else None
        if tint is not None:
            channels = extinction[:, :1], (scattering / tint.clamp_min(1e-30)).amax(dim=1, keepdim=True)
        else:
            channels = extinction, scattering
        arrays = Media(
            low=low, high=high, kind=np.array(kinds, np.int64), numbers=np.array(numbers, np.float32).reshape(count, 4),
            extinction=view(channels[0], np.float32), scattering=view(channels[1], np.float32),
            cells=np.concatenate([c.reshape(-1) for c in cells]) if cells else np.zeros(1, np.float32),
            dims=np.array(dims, np.int64).reshape(count, 4), means=np.zeros(1, np.float32),
            coarse=np.ones((count, 4), np.int64),
        )  # fmt: skip
        return cls(kept, origin, arrays, torch.ones(3) if tint is None else tint, extinction)

    def __len__(self) -> int:
        return len(self.media)

    @property
    def has_grid(self) -> bool:
        """Some density is a grid."""
        return bool((self.arrays.kind == GRID).any())

    def towards(self, kind: int, numbers: np.ndarray, options: ScatterOptions) -> Media:
        """The arrays with mean densities of all grids towards one light."""
        if not self.has_grid or kind == AMBIENT:
            return self.arrays
        coarse, parts, first = np.ones((len(self), 4), np.int64), [], 0
        for m, medium in enumerate(self.media):
            if isinstance(medium.density, Tensor):
                shape = [min(FINER * side, options.light_cells) for side in medium.density.shape]
                means = np.zeros(shape, np.float32)
                light_means(self.arrays, m, kind, numbers, options.light_steps, means)
                coarse[m] = [*shape, first]
                first += means.size
                parts.append(means.reshape(-1))
        return self.arrays._replace(means=np.concatenate(parts), coarse=coarse)

    def emitting(self, strength: Tensor) -> Media:
        """The arrays with what media give off, ``strength`` (M,C), in place of what they scatter."""
        return self.arrays._replace(scattering=view(strength, np.float32))


def _common_tint(scattering: Tensor) -> Tensor | None:
    """(3,) colour that all of (M,3) are multiples of; None if there is none."""
    if not len(scattering):
        return torch.ones(3)
    tint = scattering[int(scattering.amax(dim=1).argmax())]
    tint = tint / tint.max().clamp_min(1e-30)
    size = scattering.amax(dim=1, keepdim=True)
    return tint if bool(((scattering - size * tint).abs() <= 1e-6 * size).all()) else None


@dataclass(frozen=True, eq=False)
class LightTable:
    """A light as the kernels read it."""

    kind: int
    numbers: np.ndarray  # (12,) float32, see records
    color: Tensor  # (3,) radiance, power per solid angle, or irradiance

    @classmethod
    def of(cls, light: Light, origin: Tensor, nearest: float, falloff: str) -> LightTable:
        """Places relative to ``origin`` (3,); ``nearest``: length below which the light gets no brighter."""
        numbers = np.zeros(LIGHT_NUMBERS, np.float32)
        numbers[NEAREST], numbers[SQUARE] = nearest, float(falloff == "inverse_square")
        if isinstance(light, DirectionalLight):
            numbers[AXIS : AXIS + 3] = light.direction.numpy()
            return cls(SUN, numbers, light.irradiance)
        place = light.centre if isinstance(light, RectLight) else light.position
        numbers[PLACE : PLACE + 3] = (place.double() - origin).numpy()
        if isinstance(light, RectLight):
            numbers[AXIS : AXIS + 3], numbers[AREA] = light.normal.numpy(), light.area
            return cls(RECT, numbers, light.radiance)
        numbers[FADE] = light.range**-2
        if isinstance(light, SpotLight):
            numbers[AXIS : AXIS + 3] = light.direction.numpy()
            numbers[INNER], numbers[OUTER] = light.versines
            return cls(SPOT, numbers, light.intensity)
        assert isinstance(light, PointLight)
        return cls(LAMP, numbers, light.intensity)

    def airlight(self, table: MediaTable, reach: float) -> np.ndarray:
        """(C,R,K) table of a lamp inside the only, homogeneous, medium; (1,1,1) where there is no such thing.

        Args:
            reach: greatest distance of rays from the lamp.
        """
        media = table.arrays
        if self.kind != LAMP or len(table) != 1 or media.kind[0] != FLAT or not self.numbers[SQUARE] > 0:
            return NOTHING
        if self.numbers[FADE] > 0:  # its light ends before
            return NOTHING
        place = self.numbers[PLACE : PLACE + 3]
        depths = media.extinction[0] * media.numbers[0, 0] * np.float32(reach)
        if not ((place >= media.low[0]) & (place <= media.high[0])).all() or not depths.max() <= THICKEST:
            return NOTHING
        made = np.zeros((len(depths), *AIRLIGHT), np.float32)
        fill_airlight(depths.astype(np.float32), float(media.numbers[0, 3]), made)
        return made
