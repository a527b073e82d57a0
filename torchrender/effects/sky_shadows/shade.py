"""Light that spheres leave at points. Source: specification 08, sections 5, 8 and 9."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from torchrender.arrays import view
from torchrender.checks import check_finite, check_tensor
from torchrender.effects.sky_shadows.light import SkyLight
from torchrender.effects.sky_shadows.options import INSIDE, SkyLightOptions
from torchrender.effects.sky_shadows.tables import NO_TABLE, cap_table, code_wavelets
from torchrender.errors import InputError
from torchrender.kernels.sky_shadows.light import Caps, Samples, hidden_words, light_points

Rows = np.ndarray[Any, np.dtype[np.int32]]


class Shaded(NamedTuple):
    """Light at B sets of P points."""

    radiance: Tensor  # (B,P,3) float32 sent by a white matt surface: times its colour, what it sends
    whole: Tensor  # (B,P,3) the same where nothing is hidden
    open_share: Tensor  # (B,P) share of even light that arrives
    negative: int  # values that truncation had made negative, now zero


def shade(
    points: Tensor,
    normals: Tensor,
    spheres: Tensor,
    light: SkyLight,
    *,
    own_sphere: Tensor | None = None,
    inside: Tensor | None = None,
    body: Tensor | None = None,
    shift: Tensor | None = None,
) -> Shaded:
    """What white matt surfaces send under light from all around that spheres hide in part.

    Args:
        points: (B,P,3) world space.
        normals: (B,P,3) unit.
        spheres: (B,S,4) centre and radius; S may be 0, and spheres without radius hide nothing.
        light: as prepared, with its options.
        own_sphere: (B,P) integers: the sphere that covers the surface a point lies on, which does not hide anything
            from it; -1 for none. None: of no point.
        inside: (B,P) integers: what spheres around a point do, by place in :data:`~.options.INSIDE`; None: as the
            options say.
        body: (S,) integers: which spheres stand for the same thing: those around a point do nothing to it where its
            own sphere is of their body. None: every sphere is a body of its own.
        shift: (B,P,3) added to column, row and radius of a sphere, in texels and bins, before the table of caps rounds
            them, -0.5 to 0.5: the mean over points with other shifts knows directions and radii between. None: 0.

    No gradients.

    Raises:
        InputError: wrong shapes, values that are not finite, or inputs that want a gradient.
    """
    points, normals, spheres = _checked(points, normals, spheres)
    count, number = points.shape[:2]
    own = _rows("own_sphere", own_sphere, (count, number), -1)
    solid = _rows("inside", inside, (count, number), INSIDE.index(light.options.inside))
    moved = torch.zeros(count, number, 3) if shift is None else check_tensor("shift", shift, (count, number, 3))
    caps, fine, chunk = caps_of(light.options), code_wavelets(), light.options.chunk
    out = np.zeros((count, number, 8), np.float32)
    negative = 0
    for b in range(count):
        samples = samples_of(points[b], normals[b], own[b], solid[b], moved[b])
        below = np.zeros(-(-number // chunk), np.int64)
        light_points(samples, with_bodies(spheres[b], body), caps, light.record, fine, chunk, out[b], below)
        negative += int(below.sum())
    made = torch.from_numpy(out)
    return Shaded(made[..., :3], made[..., 4:7], made[..., 3] / made[..., 7].clamp_min(1e-30), negative)


def hidden_bits(
    points: Tensor, normals: Tensor, spheres: Tensor, options: SkyLightOptions, own_sphere: Tensor | None = None
) -> Tensor:
    """(B,P,6,32,32) bool: texels of the cube map that spheres hide from points; arguments as of :func:`shade`."""
    points, normals, spheres = _checked(points, normals, spheres)
    count, number = points.shape[:2]
    own = _rows("own_sphere", own_sphere, (count, number), -1)
    solid = _rows("inside", None, (count, number), INSIDE.index(options.inside))
    words = np.zeros((count, number, 96), np.int64)
    for b in range(count):
        samples = samples_of(points[b], normals[b], own[b], solid[b])
        hidden_words(samples, with_bodies(spheres[b]), caps_of(options), words[b])
    return bits_of_words(torch.from_numpy(words))


def samples_of(
    points: Tensor, normals: Tensor, own: Rows | None = None, solid: Rows | None = None, shift: Tensor | None = None
) -> Samples:
    """Points (P,3) as the kernels take them; left out: no sphere of their own, spheres around do nothing, no shift."""
    count = len(points)
    return Samples(
        view(points, np.float64),
        view(normals, np.float32),
        np.full(count, -1, np.int32) if own is None else own,
        np.full(count, INSIDE.index("skip"), np.int32) if solid is None else solid,
        np.zeros((count, 3), np.float32) if shift is None else view(shift, np.float32),
    )


def with_bodies(spheres: Tensor, body: Tensor | None = None) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    """(S,5) float64 as the kernels take them: spheres (S,4) and the number of the body that each stands for."""
    if body is None:
        body = torch.arange(len(spheres))
    check_tensor("body", body, (len(spheres),))
    return view(torch.cat([spheres.detach().double(), body.double()[:, None]], dim=1), np.float64)


def bits_of_words(words: Tensor) -> Tensor:
    """(...,6,32,32) bool of words (...,96) int64."""
    codes = torch.from_numpy(words.numpy().view(np.uint16).astype(np.int32))
    bits = (codes[..., None] >> (15 - torch.arange(16, dtype=torch.int32))) & 1
    lead = words.shape[:-1]
    return bits.bool().reshape(*lead, 6, 8, 8, 4, 4).transpose(-3, -2).reshape(*lead, 6, 32, 32)


def caps_of(options: SkyLightOptions) -> Caps:
    """The table that the options ask for."""
    bits, filled = NO_TABLE if options.direct_bits else cap_table(options.radii)
    return Caps(bits, filled, options.radii, options.smallest)


def _checked(points: Tensor, normals: Tensor, spheres: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    check_tensor("points", points, ("B", "P", 3))
    check_tensor("normals", normals, tuple(points.shape))
    check_tensor("spheres", spheres, (points.shape[0], "S", 4))
    for name, value in (("points", points), ("normals", normals), ("spheres", spheres)):
        check_finite(name, value)
        if value.requires_grad and torch.is_grad_enabled():
            raise InputError(f"{name} wants a gradient, which shadows of spheres do not give")
    return points, normals, spheres


def _rows(name: str, value: Tensor | None, shape: tuple[int, int], empty: int) -> Rows:
    if value is None:
        return np.full(shape, empty, np.int32)
    check_tensor(name, value, shape)
    return value.detach().int().contiguous().numpy()
