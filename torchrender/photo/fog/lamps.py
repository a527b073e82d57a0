"""Lamps with halos: street lamps, headlights, spots, marked in a photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.scatter import Illumination, scatter
from torchrender.errors import InputError
from torchrender.numerics.color import luminance
from torchrender.photo.fog.marks.records import LampMark
from torchrender.photo.fog.options import FogMedium
from torchrender.photo.fog.picture import disc_mask
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight, SpotLight
from torchrender.scene.medium import Medium

INTENSITY = 8.0
"""Radiance of white times square metres: intensity of a lamp of strength 1."""
NEAREST_M = 0.15
"""Metres: a lamp gets no brighter below this distance, for it has a size."""
FAR = 1e4


@dataclass(frozen=True, eq=False)
class Lamps:
    """Lamps in the world, and the pixels that are lamps themselves."""

    lights: tuple[PointLight | SpotLight, ...]
    mask: Tensor  # (H,W) bool
    length: Tensor  # (H,W) float32 metres from the eye to the lamp that a pixel of the mask is


def place_lamps(marks: Sequence[LampMark], photo: Tensor, camera: Cameras, depth: Tensor) -> Lamps:
    """Lamps of a photo (H,W,3), as far away as told, as their foot on the ground, or as the depth (H,W) says.

    Raises:
        InputError: a lamp outside the photo of which nothing tells its distance, or a foot above the horizon.
    """
    h, w = photo.shape[:2]
    lights: list[PointLight | SpotLight] = []
    mask, nearest = torch.zeros(h, w, dtype=torch.bool), torch.full((h, w), torch.inf, dtype=torch.float64)
    for number, mark in enumerate(marks):
        name = f"lamp[{number}]"
        x, y = mark.at
        inside = 0 <= x < w and 0 <= y < h
        z = _distance(mark, name, camera, depth, inside)
        place = camera.unproject(torch.tensor([[[x, y]]], dtype=torch.float64), torch.tensor([[z]]))[0, 0]
        own = disc_mask(mark.at, max(mark.radius, 1.0), h, w)
        color = torch.tensor(mark.color) if mark.color is not None else _color(photo[own])
        intensity = color * (mark.strength * INTENSITY)
        shown = own & (depth >= z * 0.98)  # what stands before the lamp is none
        mask |= shown
        nearest = torch.where(shown, nearest.clamp_max(z), nearest)
        if mark.kind == "point":
            lights.append(PointLight(position=place, intensity=intensity, name=name))
        else:
            lights.append(
                SpotLight(
                    position=place, direction=torch.tensor(mark.direction), intensity=intensity,
                    inner_deg=0.7 * mark.angle_deg, outer_deg=mark.angle_deg, name=name,
                )
            )  # fmt: skip
    stretch = camera.rays()[1][0].norm(dim=-1) if marks else torch.ones(h, w)
    return Lamps(tuple(lights), mask, torch.where(mask, nearest * stretch, 0.0).float())


def _distance(mark: LampMark, name: str, camera: Cameras, depth: Tensor, inside: bool) -> float:
    if mark.distance is not None:
        return mark.distance
    if mark.foot is not None:
        origin, way = camera.rays(torch.tensor([[mark.foot]], dtype=torch.float64))
        t = -float(origin[0, 0, 1]) / float(way[0, 0, 1]) if float(way[0, 0, 1]) < -1e-9 else -1.0
        if not 0 < t < 1e5:
            raise InputError(f"{name} foot must lie on the ground, below the horizon")
        return t
    if not inside:
        raise InputError(f"{name} lies outside the photo: name its distance or its foot")
    return float(depth[int(mark.at[1]), int(mark.at[0])])


def _color(pixels: Tensor) -> Tensor:
    """(3,) of luminance 1; saturated pixels say little, so those around them count as much."""
    mean = pixels.reshape(-1, 3).mean(dim=0) if pixels.numel() else torch.ones(3)
    level = luminance(mean)
    return (mean / level).clamp(0.2, 3.0) if float(level) > 1e-4 else torch.ones(3)


def lamp_light(lamps: Lamps, camera: Cameras, depth: Tensor, medium: FogMedium, top: float) -> Tensor:
    """(H,W,3) float32 light of all lamps that the air scatters to the eye before what is seen."""
    if not lamps.lights:
        return torch.zeros(*depth.shape, 3)
    eye = camera.eye[0].float()
    reach = FAR
    low = torch.tensor([float(eye[0]) - reach, -reach, float(eye[2]) - reach])
    high = torch.tensor([float(eye[0]) + reach, max(top, 0.1), float(eye[2]) + reach])
    box = Medium(
        low=low, high=high, absorption=medium.absorption, scattering=medium.scattering, asymmetry=medium.asymmetry
    )
    options = ScatterOptions(shadows="none", block=2, halo_guard_px=20)
    lit = Illumination(lights=lamps.lights, nearest=NEAREST_M)
    made = scatter([box], camera, depth[None].float(), lit, options)
    return made.scattered[0].clamp_min(0.0)
