"""The sun in a picture of the sky: found, taken out, and returned as parallel light that can cast shadows."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from torchrender.numerics.color import luminance
from torchrender.scene.sky.irradiance import latlong_directions, solid_angles

REACH_DEG = 5.0
"""A sun and its glare lie within this angle of the brightest pixel; the sky around it is known from twice as far."""

DISC_DEG = 2.0
"""Half of what a sun sends comes from within this angle of its centre, or from within three pixels."""

MOST_BEYOND = 0.3
"""Light around a sun that exceeds the sky as well, in what the sun sends."""

LEAST_SHARE = 0.15
"""A sun is worth a shadow if it gives a surface that faces it this share of what everything else gives it."""


class Sun(NamedTuple):
    """What was taken out of a picture."""

    rest: Tensor  # (H,W,3) the picture without it
    direction: Tensor  # (3,) unit, towards the sun, in the picture's own frame
    irradiance: Tensor  # (3,) on a surface that faces it: with ``rest`` all of the picture's light


def find_sun(radiance: Tensor) -> Sun | None:
    """The sun of a latitude-longitude picture (H,W,3), or None: nothing small gives a good part of the light.

    What exceeds the sky around the brightest place is the sun; a lamp as wide as a softbox exceeds little.
    """
    value = radiance.detach().double()
    height, width, _ = value.shape
    if height < 16 or width < 32:
        return None  # a pixel is wider than any sun
    solid = solid_angles(height, width)
    directions = latlong_directions(height, width).double()
    bright = luminance(value)
    centre = directions.reshape(-1, 3)[int(bright.argmax())]
    for _ in range(2):  # about the brightest pixel, then about the centre of what was found
        angle = torch.rad2deg(torch.acos((directions @ centre).clamp(-1.0, 1.0)))
        reach = max(REACH_DEG, 3 * 180.0 / height)
        inside, ring = angle <= reach, (angle > reach) & (angle <= 2 * reach)
        around = value[ring].median(dim=0).values
        excess = torch.where(inside[..., None], (value - around).clamp_min(0.0), 0.0)
        power = luminance(excess) * solid
        total = float(power.sum())
        if total <= 0.0:
            return None
        centre = torch.nn.functional.normalize((directions * power[..., None]).sum(dim=(0, 1)), dim=0)
    beyond = luminance((value - around).clamp_min(0.0)) * solid
    disc = angle <= max(DISC_DEG, 3 * 180.0 / height)
    rest = value - excess
    facing = (directions @ centre).clamp_min(0.0)
    others = float((luminance(rest) * facing * solid).sum())
    if float(beyond[ring].sum()) > MOST_BEYOND * total:
        return None  # the end of something larger
    if float(power[disc].sum()) < 0.5 * total or total < LEAST_SHARE * others:
        return None
    return Sun(rest.to(radiance.dtype), centre.float(), (excess * solid[..., None]).sum(dim=(0, 1)).float())


def turned(directions: Tensor, angle_deg: float) -> Tensor:
    """Directions (...,3) turned about +y, so that their azimuth in a picture grows by the angle."""
    if angle_deg == 0.0:
        return directions
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    x, y, z = directions.unbind(-1)
    return torch.stack([c * x - s * z, y, c * z + s * x], dim=-1)
