"""The numerical functions of the package, each on random arguments that are the same in float32 and in float64."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.numerics.color import linear_from_srgb, luminance, srgb_from_linear
from torchrender.numerics.lobe import frame, lobe_directions, reflect, schlick
from torchrender.numerics.polygon_light import polygon_irradiance
from torchrender.numerics.tonemap import tone_map

Draw = Callable[[int], Tensor]


@dataclass(frozen=True, kw_only=True)
class HardFunction:
    """A function of tensors that takes either precision and answers in it."""

    name: str
    arguments: Callable[[torch.Generator, int], tuple[Tensor, ...]]  # float64
    call: Callable[..., Tensor]
    limit: float  # largest difference that is rounding

    def results(self, count: int, seed: int = 0) -> tuple[Tensor, Tensor]:
        """In float32 and in float64, of arguments that float32 holds exactly."""
        drawn = self.arguments(torch.Generator().manual_seed(seed), count)
        single = tuple(a.float() for a in drawn)
        return self.call(*single), self.call(*(a.double() for a in single))

    def difference(self, count: int, seed: int = 0) -> float:
        """Largest difference, relative to the result or where that is small to its mean size."""
        short, long = self.results(count, seed)
        size = torch.maximum(long.abs(), long.abs().mean()).clamp_min(1e-300)
        return float(((short.double() - long).abs() / size).max())


def _sizes(generator: torch.Generator, *shape: int) -> Tensor:
    """Numbers of both signs and of sizes from 1e-6 to 1e3."""
    exponent = 9.0 * torch.rand(shape, generator=generator, dtype=torch.float64) - 6.0
    sign = torch.where(torch.rand(shape, generator=generator) < 0.5, -1.0, 1.0)
    return sign * 10.0**exponent


def _share(generator: torch.Generator, *shape: int) -> Tensor:
    return torch.rand(shape, generator=generator, dtype=torch.float64)


def _units(generator: torch.Generator, count: int) -> Tensor:
    return torch.nn.functional.normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1)


def _lobes(generator: torch.Generator, count: int) -> tuple[Tensor, ...]:
    axis, normal = _units(generator, count), _units(generator, count)
    normal = normal * torch.where((axis * normal).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    return axis, normal, _share(generator, count), 6.0 * _share(generator, count)


def _receivers(generator: torch.Generator, count: int) -> tuple[Tensor, ...]:
    """A rectangle of radiance one, places around it, and normals."""
    corners = torch.tensor(
        [[-1.0, 3.0, -1.0], [1.0, 3.0, -1.0], [1.0, 3.0, 1.0], [-1.0, 3.0, 1.0]], dtype=torch.float64
    )
    return corners, 4.0 * (_share(generator, 3, count) - 0.5), _units(generator, count).T.contiguous()


NUMERICS = (
    HardFunction(name="linear_from_srgb", arguments=lambda g, n: (_sizes(g, n),), call=linear_from_srgb, limit=1e-5),
    HardFunction(name="srgb_from_linear", arguments=lambda g, n: (_sizes(g, n),), call=srgb_from_linear, limit=1e-5),
    HardFunction(name="luminance", arguments=lambda g, n: (_sizes(g, n, 3).abs(),), call=luminance, limit=1e-6),
    HardFunction(
        name="tone_map, reinhard",
        arguments=lambda g, n: (_sizes(g, n, 3),),
        call=lambda x: tone_map(x, "reinhard"),
        limit=1e-5,
    ),
    HardFunction(
        name="tone_map, aces", arguments=lambda g, n: (_sizes(g, n, 3),), call=lambda x: tone_map(x, "aces"), limit=1e-4
    ),
    HardFunction(name="reflect", arguments=lambda g, n: (_units(g, n), _units(g, n)), call=reflect, limit=1e-5),
    HardFunction(name="schlick", arguments=lambda g, n: (_share(g, n), _share(g, n)), call=schlick, limit=1e-5),
    HardFunction(
        name="frame",
        arguments=lambda g, n: (_units(g, n),),
        call=lambda axis: torch.cat(frame(axis), dim=-1),
        limit=1e-3,  # the frame turns quickly beside -z
    ),
    HardFunction(
        name="lobe_directions",
        arguments=_lobes,
        call=lambda axis, normal, gloss, turn: lobe_directions(axis, normal, gloss, 8, turn),
        limit=1e-3,
    ),
    HardFunction(name="polygon_irradiance", arguments=_receivers, call=polygon_irradiance, limit=1e-4),
)
