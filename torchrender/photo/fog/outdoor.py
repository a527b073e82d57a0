"""Fog outdoors: a layer over level ground, lit by sky and sun.

All integrals along rays of sight have closed forms. Source: specification 12, section 5.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from torchrender.effects.media.phase import henyey_greenstein
from torchrender.errors import InputError
from torchrender.numerics.color import luminance
from torchrender.photo.fog.air import held_back
from torchrender.photo.fog.depth.labels import SKY, Labelled, soft_sky
from torchrender.photo.fog.marks.records import Marks
from torchrender.photo.fog.options import FogMedium, FogOptions, FogWarning
from torchrender.photo.fog.picture import polygon_mask
from torchrender.scene.camera import Cameras

LEAST_COSINE = 0.05
WHITER = 0.7
"""Share of white in light that is only guessed."""
SKY_DIFFUSE = 2.0
"""Light from the whole sky runs through so many times the layer's height."""


@dataclass(frozen=True, eq=False)
class OutdoorLight:
    """Sky and sun, in the photo's units."""

    sky: Tensor  # (3,) radiance
    sun: Tensor  # (3,) irradiance across its direction
    to_sun: Tensor  # (3,) float64 unit
    share_sun: Tensor  # (3,) of the light on sunlit ground
    ground: Tensor  # (3,) radiance of the sunlit ground


@dataclass(frozen=True, eq=False)
class OutdoorScene:
    """An outdoor photo, ready for any medium."""

    camera: Cameras
    depth: Tensor  # (H,W) float64 camera z
    sky: Tensor  # (H,W) float32 share of sky in each pixel
    light: OutdoorLight
    options: FogOptions

    @cached_property
    def direction(self) -> Tensor:
        """(H,W,3) float32 unit."""
        return torch.nn.functional.normalize(self.camera.rays()[1][0], dim=-1).float()

    @cached_property
    def length(self) -> Tensor:
        """(H,W) float32 metres to what is seen."""
        return (self.depth * self.camera.rays()[1][0].norm(dim=-1)).float()

    @property
    def eye(self) -> float:
        """Height above the ground, metres."""
        return float(self.camera.eye[0, 1])

    def facts(self) -> dict[str, object]:
        """What was found out about the photo, in numbers."""
        elevation = math.degrees(math.asin(max(-1.0, min(1.0, float(self.light.to_sun[1])))))
        return {
            "sky_radiance": [round(float(v), 4) for v in self.light.sky],
            "sun_irradiance": [round(float(v), 4) for v in self.light.sun],
            "sun_elevation_deg": round(elevation, 2),
            "to_sun": [round(float(v), 4) for v in self.light.to_sun],
            "depth_m": [round(float(self.depth.min()), 2), round(float(self.depth.max()), 2)],
        }


def prepare_outdoor(
    photo: Tensor, marks: Marks, camera: Cameras, labelled: Labelled, options: FogOptions
) -> OutdoorScene:
    """Everything about a photo (H,W,3) that does not depend on the medium."""
    light = estimate_light(photo, marks, camera, labelled, options)
    return OutdoorScene(camera, labelled.depth, soft_sky(photo, labelled, options.matte_px), light, options)


def estimate_light(
    photo: Tensor, marks: Marks, camera: Cameras, labelled: Labelled, options: FogOptions
) -> OutdoorLight:
    """Sky and sun from ground in shadow and in the sun; from the sky's pixels, or all ground, where nothing is marked.

    Raises:
        InputError: marks outside the photo, or an object and its shadow at one place.
    """
    h, w = photo.shape[:2]
    outdoor = marks.outdoor
    to_sun = sun_direction(marks, camera, labelled.depth)
    medians: dict[str, Tensor] = {}
    for name in ("shadow", "sunlit"):
        polygon = getattr(outdoor, name)
        if polygon is not None:
            pixels = photo[polygon_mask(polygon, h, w)]
            if not len(pixels):
                raise InputError(f"outdoor {name} lies outside the photo")
            medians[name] = pixels.median(dim=0).values * options.scale
    sky_pixels = photo[labelled.label == SKY]
    ground = photo[labelled.label != SKY].reshape(-1, 3)
    usual = ground.median(dim=0).values * options.scale if len(ground) else torch.full((3,), 0.2)
    lit = medians.get("sunlit", medians.get("shadow", usual))
    rho = options.albedo / math.pi
    if "shadow" in medians:
        shadow = medians["shadow"]
        sky = shadow / options.albedo / outdoor.sky_share
    elif len(sky_pixels):
        sky = _paler(sky_pixels.median(dim=0).values * options.scale)
        shadow = torch.minimum(lit, sky * options.albedo)
    else:
        shadow, sky = lit, _paler(lit / options.albedo)
    sun = torch.zeros(3)
    if "sunlit" in medians:
        cosine = max(float(to_sun[1]), LEAST_COSINE)
        sun = (lit - shadow) / (rho * cosine)
        if bool((sun < 0).any()):
            warnings.warn(
                "the ground marked as sunlit is darker than the shadow: are the marks swapped? The sun is left out",
                FogWarning, stacklevel=2,
            )  # fmt: skip
            sun = torch.zeros(3) if float(sun.mean()) <= 0 else sun.clamp_min(0.0)
    share = torch.where(sun > 0, (1.0 - shadow / lit.clamp_min(1e-6)).clamp(0.0, 1.0), 0.0)
    gain = options.light_gain
    return OutdoorLight(sky.float() * gain, sun.float() * gain, to_sun, share.float(), lit.float())


def _paler(light: Tensor) -> Tensor:
    """Daylight guessed from one colour of the photo: sky and sun together are whiter than the sky, or the ground."""
    return torch.lerp(light, luminance(light).expand(3), WHITER)


def sun_direction(marks: Marks, camera: Cameras, depth: Tensor) -> Tensor:
    """(3,) float64 unit, towards the sun: from the tip of a shadow to the top of what casts it; else 45 degrees."""
    outdoor = marks.outdoor
    if outdoor.object_top is None or outdoor.shadow_tip is None:
        return torch.nn.functional.normalize(torch.tensor([0.5, 1.0, 0.866], dtype=torch.float64), dim=0)
    h, w = depth.shape
    places = []
    for name in ("object_top", "shadow_tip"):
        x, y = getattr(outdoor, name)
        if not (0 <= x < w and 0 <= y < h):
            raise InputError(f"outdoor {name} lies outside the photo")
        pixel = torch.tensor([[[x, y]]], dtype=torch.float64)
        places.append(camera.unproject(pixel, depth[int(y), int(x)].reshape(1, 1))[0, 0])
    way = places[0] - places[1]
    if not float(way.norm()) > 1e-6:
        raise InputError("object_top and shadow_tip are one place")
    way = torch.nn.functional.normalize(way, dim=0)
    if float(way[1]) < math.sin(math.radians(1.0)):
        warnings.warn(
            "the sun lies below one degree by its marks: are object_top and shadow_tip swapped, or on one depth?",
            FogWarning, stacklevel=3,
        )  # fmt: skip
        flat = way * torch.tensor([1.0, 0.0, 1.0], dtype=torch.float64)
        flat = torch.nn.functional.normalize(flat, dim=0) if float(flat.norm()) > 1e-9 else flat
        return torch.nn.functional.normalize(flat + torch.tensor([0.0, LEAST_COSINE, 0.0], dtype=torch.float64), dim=0)
    return way


@dataclass(frozen=True, eq=False)
class _Inside:
    """The part of each ray within the layer."""

    begin_height: Tensor  # (H,W) below the top, metres, where it enters
    run: Tensor  # (H,W) metres within the layer
    rise: Tensor  # (H,W) of the ray per metre


def _inside(scene: OutdoorScene, length: Tensor) -> _Inside:
    rise, top, eye = scene.direction[..., 1], scene.options.top, scene.eye
    if eye <= top:
        leaves = torch.where(rise > 1e-9, (top - eye) / rise.clamp_min(1e-9), torch.inf)
        return _Inside(torch.full_like(length, top - eye), torch.minimum(length, leaves), rise)
    enters = torch.where(rise < -1e-9, (eye - top) / (-rise).clamp_min(1e-9), torch.inf)
    return _Inside(torch.zeros_like(length), (length - enters).clamp_min(0.0).nan_to_num(0.0), rise)


def transmittance(scene: OutdoorScene, medium: FogMedium) -> Tensor:
    """(H,W,3) float32 in [0,1]: of sky pixels on the way to the eye, of all others on the way of their light, too."""
    far = torch.exp(-_inside(scene, torch.full_like(scene.length, float(scene.length.max()))).run[..., None]
                    * medium.extinction)  # fmt: skip
    inside = _inside(scene, scene.length)
    seen = torch.exp(-inside.run[..., None] * medium.extinction)
    lost = _lost(scene.options, medium)
    if bool((lost > 0).any()):
        height = (scene.eye + scene.direction[..., 1] * scene.length).clamp_min(0.0)
        below = (scene.options.top - height).clamp_min(0.0)[..., None] * lost
        share, slope = scene.light.share_sun, max(float(scene.light.to_sun[1]), LEAST_COSINE)
        surface = seen * (share * torch.exp(-below / slope) + (1 - share) * torch.exp(-SKY_DIFFUSE * below))
    else:
        surface = seen
    sky = scene.sky[..., None]
    return (sky * torch.where(sky > 0, far, 1.0) + (1 - sky) * surface).clamp(0.0, 1.0)


def scattered(scene: OutdoorScene, medium: FogMedium) -> Tensor:
    """(H,W,3) float32 radiance of the layer before each pixel."""
    near = _added(scene, medium, scene.length)
    edge = scene.sky > 0
    if not bool(edge.any()):
        return near
    far = _added(scene, medium, torch.full_like(scene.length, float(scene.length.max())))
    sky = scene.sky[..., None]
    return near * (1 - sky) + far * sky


def _added(scene: OutdoorScene, medium: FogMedium, length: Tensor) -> Tensor:
    inside, light = _inside(scene, length), scene.light
    slope = max(float(light.to_sun[1]), LEAST_COSINE)
    cosine = scene.direction @ light.to_sun.float()  # light goes on towards the eye where we look towards the sun
    phase = henyey_greenstein(cosine, medium.asymmetry)[..., None]
    upper = upper_share(scene.direction[..., 1], medium.asymmetry)[..., None]
    if scene.options.loss == "absorbed":
        # Fog is lit by fog: from below, too, the more of it there is.
        upper = upper + (1.0 - upper) * -torch.expm1(-medium.scattering * scene.options.top)
    total = torch.zeros(*length.shape, 3)
    if bool((light.sun > 0).any()):
        total += light.sun * phase * _integral(inside, medium.extinction, _lost(scene.options, medium), 1.0 / slope)
    total += light.sky * upper * _integral(inside, medium.extinction, _lost(scene.options, medium), SKY_DIFFUSE)
    if scene.options.ground_bounce:
        total += 0.5 * light.ground * held_back(medium.extinction, inside.run[..., None])
    return (total * medium.scattering).clamp_min(0.0)


def _lost(options: FogOptions, medium: FogMedium) -> Tensor:
    """(3,) 1/m that daylight loses on its way down."""
    if options.loss == "single":
        return medium.extinction
    return medium.absorption if options.loss == "absorbed" else torch.zeros(3)


def _integral(inside: _Inside, extinction: Tensor, lost: Tensor, slant: float) -> Tensor:
    """(H,W,3) integral over a ray of transmittance to the eye times that to the layer's top at a slant.

    The exponent is linear along the ray; the larger end's exponential is taken out, so that nothing overflows.
    """
    run = inside.run[..., None]
    rate = extinction - lost * slant * inside.rise[..., None]
    begin = -lost * slant * inside.begin_height[..., None]
    end = begin - rate * run
    return torch.exp(torch.maximum(begin, end).clamp_max(0.0)) * held_back(rate.abs(), run.expand_as(rate))


def upper_share(rise: Tensor, asymmetry: float) -> Tensor:
    """(...) share of what a place scatters to the eye that comes from above, of light that is even there.

    Args:
        rise: (...) height gained per metre of the line of sight. One half for asymmetry 0.
    """
    if asymmetry == 0.0:
        return torch.full_like(rise, 0.5)
    count = 65
    table_rise = torch.linspace(-1.0, 1.0, count, dtype=torch.float64)
    up = (torch.arange(64, dtype=torch.float64) + 0.5) / 64
    turn = (torch.arange(64, dtype=torch.float64) + 0.5) * (2 * math.pi / 64)
    flat = (1 - table_rise**2).clamp_min(0.0).sqrt()
    # Light from a direction w goes on along -w; seen from a place, the eye lies along minus the line of sight.
    cosine = (
        table_rise[:, None, None] * up[None, :, None]
        + flat[:, None, None] * ((1 - up**2).sqrt()[:, None] * turn.cos()[None, :])[None]
    )
    table = henyey_greenstein(cosine, asymmetry).mean(dim=(1, 2)) * 2 * math.pi
    place = ((rise.double().clamp(-1.0, 1.0) + 1) / 2 * (count - 1)).clamp(0.0, count - 1 - 1e-9)
    low = place.floor().long()
    return (table[low] * (1 - (place - low)) + table[low + 1] * (place - low)).to(rise.dtype)
