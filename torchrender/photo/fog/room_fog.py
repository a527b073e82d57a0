"""Transmittance and scattered light of a room, kept ready for other media of the same density."""

from __future__ import annotations

import math
from typing import Any

import torch
from torch import Tensor

from torchrender.effects.media.phase import henyey_greenstein
from torchrender.errors import OptionError
from torchrender.numerics.color import LUMINANCE_WEIGHTS
from torchrender.photo.fog.air import Air, held_back
from torchrender.photo.fog.indoor import RoomScene, air_of, with_lights
from torchrender.photo.fog.options import FogMedium, FogOptions
from torchrender.photo.fog.picture import nearest_on_part
from torchrender.photo.fog.room.emitters import patches_per_side
from torchrender.photo.fog.room.shafts import shaft_light, shaft_ways
from torchrender.photo.fog.room.transport import Arriving, Paths, Sources, arriving, trace_paths

GRID_FACTOR = 1.0  # columns of places with known transmittance over columns of rays with known light
PENUMBRA = 0.05
"""Share of the picture's width within which a place that sees no patch's centre takes the share of one that does."""
_WEIGHTS = torch.tensor(LUMINANCE_WEIGHTS)


class RoomFog:
    """Fog for one room. What depends on the density alone is kept: other coefficients then take little time."""

    def __init__(self, scene: RoomScene, options: FogOptions) -> None:
        self.scene, self.options = scene, options
        self._density: Tensor | str | None = "none yet"
        self._air = Air(None, scene.room.low, scene.room.high)
        self._kept: dict[object, Any] = {}
        self._sun_factor = 1.0  # the sun is so much stronger than it was for what is kept

    def _set_air(self, medium: FogMedium) -> None:
        if medium.density is not self._density:
            self._density, self._air = medium.density, air_of(self.scene, medium)
            self._kept.clear()

    def adjusted(self, options: FogOptions) -> RoomFog:
        """The same room with other gains of its lights; what is kept is shared.

        Raises:
            OptionError: shafts were switched off, so that no factor brings them back.
        """
        gain = options.light_gain / self.options.light_gain
        if self.options.shaft_gain == 0 and options.shaft_gain > 0:
            raise OptionError("shaft_gain cannot be adjusted from 0")
        shaft = 1.0 if options.shaft_gain == self.options.shaft_gain else options.shaft_gain / self.options.shaft_gain
        scene = self.scene
        other = RoomFog(with_lights(scene, scene.radiance * gain, sun=scene.sun * gain * shaft,
                                    ambient=scene.ambient * gain), options)  # fmt: skip
        other._density, other._air, other._kept = self._density, self._air, self._kept
        other._sun_factor = self._sun_factor * shaft
        if shaft == 0.0:  # what others trace with the sun must not be traced without it
            other._kept, other._sun_factor = {k: v for k, v in self._kept.items() if k != "paths"}, 1.0
        return other

    # ------------------------------------------------------- what of the photo is left

    def transmittance(self, medium: FogMedium) -> Tensor:
        """(H,W,3) float32 in [0,1]: on the way to the eye, and of lit surfaces on the way to them."""
        self._set_air(medium)
        seen = self.to_eye(medium)
        if not self.options.attenuated_light:
            return seen
        towards = self._ratio(medium) if self.options.transmittance == "ratio" else self._direct(medium)
        return torch.where(self.scene.glowing[..., None], seen, seen * towards)

    def to_eye(self, medium: FogMedium) -> Tensor:
        """(H,W,3) transmittance from what is seen to the eye."""
        self._set_air(medium)
        return _decay(self._way_to_eye(), medium.extinction)

    def _rays(self) -> tuple[Tensor, Tensor]:
        """Directions (HW,3) and lengths (HW,) of all rays of sight; they outlast other strengths of the lights."""
        if "rays" not in self._kept:
            self._kept["rays"] = (self.scene.ray_direction.reshape(-1, 3), self.scene.ray_length.reshape(-1))
        found: tuple[Tensor, Tensor] = self._kept["rays"]
        return found

    def _way_to_eye(self) -> Tensor:
        """(H,W) float32 air between what is seen and the eye."""
        if "eye" not in self._kept:
            flat = self._air.ways(self.scene.eye[None], *self._rays())
            self._kept["eye"] = flat.reshape(self.scene.seen.depth.shape)
        found: Tensor = self._kept["eye"]
        return found

    def _direct(self, medium: FogMedium) -> Tensor:
        """(H,W,3) by centres of lights, or of their patches: one factor for each source, by its share."""
        scene = self.scene
        place = (scene.seen.place + 1e-6 * scene.seen.normal).reshape(-1, 3)
        total, weights = torch.zeros(len(place), 3), torch.zeros(len(place), 3)
        equal, sources = torch.zeros(len(place), 3), 0
        kappa = float(medium.extinction.max())
        for number, emitter in enumerate(scene.emitters):
            strength = float(scene.radiance[number] @ _WEIGHTS)
            if strength <= 0:
                continue
            split = 1
            if self.options.transmittance == "patches":
                split = patches_per_side(emitter, kappa, self.options.patch_limit)
            found = self._arriving(number, split)
            lit = found.lit()[:, None] * strength
            whole = found if split > 1 else self._centre(number)
            dimmed = (
                found.dimmed(medium.extinction) * strength
                if split > 1
                else lit * _decay(whole.way[:, 0], medium.extinction)
            )
            total, weights = total + dimmed, weights + lit
            equal, sources = equal + _decay(whole.way.mean(dim=1), medium.extinction), sources + 1
        total, weights = self._sun_and_ambient(medium, place, total, weights)
        share = total / weights.clamp_min(1e-12)
        usual = equal / sources if sources else torch.ones(len(place), 3)
        lit = weights[:, 0] > 1e-9
        towards = torch.where(lit[:, None], share, usual)
        if self.options.transmittance == "patches":
            near = nearest_on_part(scene.seen.part, lit.reshape(scene.seen.part.shape), PENUMBRA)
            towards = torch.where((near >= 0)[:, None], towards[near.clamp_min(0)], towards)
        return towards.clamp(0.0, 1.0).reshape(*scene.seen.depth.shape, 3)

    def _sun_and_ambient(
        self, medium: FogMedium, place: Tensor, total: Tensor, weights: Tensor
    ) -> tuple[Tensor, Tensor]:
        scene = self.scene
        sun, ambient = float(scene.sun @ _WEIGHTS), float(scene.ambient @ _WEIGHTS)
        if scene.shafts is not None and sun > 0:
            if "sunlit" not in self._kept:
                self._kept["sunlit"] = scene.shafts.reach(place)
            distance, inside = self._kept["sunlit"]
            facing = (-(scene.seen.normal.reshape(-1, 3) @ scene.shafts.direction)).clamp_min(0.0)
            lit = torch.where(inside, facing, 0.0).float()[:, None] * sun
            total, weights = total + lit * _decay(distance.float(), medium.extinction), weights + lit
        if ambient > 0:
            far = torch.exp(-medium.extinction * scene.proxy.mean_chord)
            total, weights = total + math.pi * ambient * far, weights + math.pi * ambient
        return total, weights

    def _centre(self, number: int) -> Arriving:
        key = ("centre", number)
        if key not in self._kept:
            place = self.scene.seen.place.reshape(-1, 3)
            way = self._air.between(self.scene.emitters[number].centre.expand_as(place), place)
            self._kept[key] = Arriving(torch.ones(len(place), 1), way[:, None])
        found: Arriving = self._kept[key]
        return found

    def _arriving(self, number: int, per_side: int) -> Arriving:
        key = ("surface", number, per_side)
        if key not in self._kept:
            scene = self.scene
            normal = scene.seen.normal.reshape(-1, 3)
            place = scene.seen.place.reshape(-1, 3) + 1e-6 * normal
            emitter = scene.emitters[number]
            self._kept[key] = arriving(emitter, scene.proxy, self._air, place, normal, per_side)
        found: Arriving = self._kept[key]
        return found

    def _ratio(self, medium: FogMedium) -> Tensor:
        """(H,W,3) ratio of irradiance, at some pixels by random paths, between them by place and normal."""
        if "paths" not in self._kept:
            self._kept["paths"] = self._traced()
        paths, number, weight = self._kept["paths"]
        if self._sun_factor != 1.0:
            paths = paths.with_sun(self._sun_factor)
        found = paths.ratio(medium.extinction, self.scene.proxy.mean_chord)
        size = self.scene.seen.depth.shape
        out = torch.zeros(number.shape[0], 3)
        for k in range(number.shape[1]):
            out += found[number[:, k]] * weight[:, k, None]
        return out.reshape(*size, 3)

    def _traced(self) -> tuple[Paths, Tensor, Tensor]:
        scene, options = self.scene, self.options
        h, w = scene.seen.depth.shape
        step = max(1, round(w / (options.columns * GRID_FACTOR)))
        rows, columns = torch.arange(step // 2, h, step), torch.arange(step // 2, w, step)
        pick = (rows[:, None], columns[None, :])
        sources = Sources(
            emitters=scene.emitters, radiance=(scene.radiance @ _WEIGHTS).tolist(), shafts=scene.shafts,
            sun=float(scene.sun @ _WEIGHTS) / self._sun_factor, ambient=float(scene.ambient @ _WEIGHTS),
        )  # fmt: skip
        place, normal = scene.seen.place[pick], scene.seen.normal[pick]
        paths = trace_paths(
            sources, scene.proxy, self._air, (place.reshape(-1, 3), normal.reshape(-1, 3)), scene.albedo,
            count=options.paths, bounces=options.bounces, seed=options.seed,
        )  # fmt: skip
        number, weight = self._neighbours(place, normal, step)
        # Places that nothing lights know no ratio: their neighbours do.
        weight = weight * (paths.lit[number] + 1e-6)
        return paths, number, weight / weight.sum(dim=1, keepdim=True)

    def _neighbours(self, place: Tensor, normal: Tensor, step: int) -> tuple[Tensor, Tensor]:
        """For each pixel the four places around it, (HW,4), and their weights: near ones on the same surface count."""
        h, w = self.scene.seen.depth.shape
        high, wide = place.shape[:2]
        v = (torch.arange(h) - step // 2) / step
        u = (torch.arange(w) - step // 2) / step
        r0, c0 = v.floor().long().clamp(0, high - 1), u.floor().long().clamp(0, wide - 1)
        fv, fu = (v - r0).clamp(0.0, 1.0), (u - c0).clamp(0.0, 1.0)
        numbers, weights = [], []
        own_place, own_normal = self.scene.seen.place.float(), self.scene.seen.normal.float()
        scale = self.scene.ray_length.float().clamp_min(1e-3) * 0.02
        flat_place, flat_normal = place.float().reshape(-1, 3), normal.float().reshape(-1, 3)
        for dr in (0, 1):
            for dc in (0, 1):
                r, c = (r0 + dr).clamp_max(high - 1), (c0 + dc).clamp_max(wide - 1)
                number = r[:, None] * wide + c[None, :]
                share = (fv if dr else 1 - fv)[:, None] * (fu if dc else 1 - fu)[None, :]
                off = ((flat_place[number] - own_place) * own_normal).sum(dim=-1).abs() / scale
                same = (flat_normal[number] * own_normal).sum(dim=-1).clamp_min(0.0)
                numbers.append(number.reshape(-1))
                weights.append(((share + 1e-3) * (same**8 + 1e-4) * torch.exp(-off)).clamp_min(1e-9).reshape(-1))
        weight = torch.stack(weights, dim=1)
        return torch.stack(numbers, dim=1), weight / weight.sum(dim=1, keepdim=True)

    # ---------------------------------------------------------------- what the air adds

    def scattered(self, medium: FogMedium) -> Tensor:
        """(H,W,3) float32 radiance, at least 0."""
        self._set_air(medium)
        scene = self.scene
        shape = scene.seen.depth.shape
        if not bool((medium.scattering > 0).any()):
            return torch.zeros(*shape, 3)
        total = self._from_lights(medium)
        if scene.shafts is not None and bool((scene.sun > 0).any()):
            rays = (scene.eye, *self._rays())
            if "shafts" not in self._kept:
                self._kept["shafts"] = shaft_ways(scene.shafts, *rays)
            sun = shaft_light(scene.shafts, *rays, medium, self._air, self.options.steps, self._kept["shafts"])
            total = total + sun.reshape(*shape, 3) * scene.sun
        if bool((scene.ambient > 0).any()):
            way, grey = self._way_to_eye(), bool((medium.extinction == medium.extinction[0]).all())
            held = -torch.expm1(-way[..., None] * (medium.extinction[:1] if grey else medium.extinction))
            albedo = medium.scattering / medium.extinction.clamp_min(1e-30)
            dimmed = torch.exp(-medium.extinction * scene.proxy.mean_chord * float(self.options.attenuated_light))
            total = total + held * (albedo * scene.ambient * dimmed)
        return total.clamp_min(0.0)

    def _from_lights(self, medium: FogMedium) -> Tensor:
        """(H,W,3) of emitters: known along some rays of sight, and looked up at each pixel's length."""
        scene = self.scene
        h, w = scene.seen.depth.shape
        if not scene.emitters or not bool((scene.radiance > 0).any()):
            return torch.zeros(h, w, 3)
        if "air" not in self._kept:
            self._kept["air"] = self._columns()
        directions, sources, density, before, step = self._kept["air"]
        high, wide, steps = density.shape
        given = torch.zeros(high * wide * steps, 3)
        for radiance, found in zip(scene.radiance, sources, strict=True):
            if found is None:
                continue
            weight = found.weight
            if medium.asymmetry == 0.0:
                weight = weight / (4 * math.pi)
            else:
                towards = -directions.reshape(-1, 1, 3).expand(-1, steps, -1).reshape(-1, 1, 3)
                weight = weight * henyey_greenstein((found.direction * towards).sum(dim=-1), medium.asymmetry)
            extinction = medium.extinction if self.options.attenuated_light else torch.zeros(3)
            given += Arriving(weight, found.way).dimmed(extinction) * radiance
        given = given.reshape(high, wide, steps, 3) * medium.scattering
        lost = before[..., None] * medium.extinction
        part = held_back(density[..., None] * medium.extinction, torch.tensor(step)) * density[..., None]
        layers = torch.exp(-lost) * part * given
        summed = torch.cat([torch.zeros(high, wide, 1, 3), layers.cumsum(dim=2)], dim=2)
        return self._looked_up(summed, step)

    def _looked_up(self, summed: Tensor, step: float) -> Tensor:
        """Sums (h,w,S+1,3) along rays at every pixel's place."""
        h, w = self.scene.seen.depth.shape
        steps = summed.shape[2] - 1
        v, u = (torch.arange(h) + 0.5) / h * 2 - 1, (torch.arange(w) + 0.5) / w * 2 - 1
        z = (self._rays()[1].reshape(h, w).float() / (step * steps)).clamp(0.0, 1.0) * 2 - 1
        grid = torch.stack([u[None, :].expand(h, w), v[:, None].expand(h, w)], dim=-1)
        # Across the picture samples lie at cell centres, along the ray at the ends of steps.
        z = z * steps / (steps + 1)
        where = torch.cat([grid, z[..., None]], dim=-1)[None, None]
        volume = summed.permute(3, 2, 0, 1)[None]
        found = torch.nn.functional.grid_sample(
            volume, where, mode="bilinear", padding_mode="border", align_corners=False
        )
        return found[0, :, 0].permute(1, 2, 0)

    def _columns(self) -> tuple[Tensor, list[Arriving | None], Tensor, Tensor, float]:
        scene, options = self.scene, self.options
        h, w = scene.seen.depth.shape
        wide = min(options.columns, w)
        high = max(1, min(h, round(wide * h / w)))
        v, u = (torch.arange(high) + 0.5) * h / high, (torch.arange(wide) + 0.5) * w / wide
        pixels = torch.stack([u[None, :].expand(high, wide), v[:, None].expand(high, wide)], dim=-1)
        direction = torch.nn.functional.normalize(scene.room.camera.rays(pixels[None].double())[1][0], dim=-1)
        step = float(scene.ray_length.max()) / options.steps
        along = (torch.arange(options.steps, dtype=torch.float64) + 0.5) * step
        place = scene.eye + direction[:, :, None] * along[:, None]
        flat = place.reshape(-1, 3)
        per_side = math.ceil(math.sqrt(options.light_samples))
        sources: list[Arriving | None] = [
            arriving(e, scene.proxy, self._air, flat, None, per_side) if float(r.max()) > 0 else None
            for e, r in zip(scene.emitters, scene.radiance, strict=True)
        ]
        density = self._air.at(place)
        before = density.cumsum(dim=2) * step - density * step
        return direction.float(), sources, density, before, step


def _decay(ways: Tensor, extinction: Tensor) -> Tensor:
    """(...,3) ``exp(-extinction way)``; one exponential where all channels are alike."""
    if bool((extinction == extinction[0]).all()):
        return torch.exp(-extinction[0] * ways)[..., None].expand(*ways.shape, 3)
    return torch.exp(-extinction * ways[..., None])
