"""Scattered light and transmittance of pictures of a scene in participating media.

Nothing is kept from picture to picture: every light and every number of a medium may change with each.
Source: specification 09.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import ShadowMap
from torchrender.checks import options_of
from torchrender.effects.media.between import Guard, Integrate, between, every_ray, normaliser
from torchrender.effects.media.eye_rays import EyeRays, eye_of, rays_of
from torchrender.effects.media.lattice import lattice_of, ways_by_lattice
from torchrender.effects.media.light_images import NO_IMAGES, NO_SLICES, images_of, slices_of, views_of
from torchrender.effects.media.march import Marcher
from torchrender.effects.media.options import ScatterOptions
from torchrender.effects.media.surroundings import Surroundings, glow
from torchrender.effects.media.tables import NOTHING, THICKEST, LightTable, MediaTable
from torchrender.errors import InputError
from torchrender.kernels.media.closed import CHUNK, scatter_sliced
from torchrender.kernels.media.integrate import EVERYWHERE, SLICED, WALKED, scatter_rays
from torchrender.kernels.media.records import FLAT, NO_LATTICE, PLACE, SUN, Scattered, Source
from torchrender.kernels.media.ways import ways_through
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.light import DirectionalLight, Light, vectors_to
from torchrender.scene.medium import Medium

GRID_STEPS = 48
"""Steps of the way through a grid from the eye to a surface."""


@dataclass(frozen=True, eq=False)
class ScatteringLayer:
    """What media put before B pictures: ``seen = transmittance * surface + scattered``."""

    transmittance: Tensor  # (B,H,W,3) in [0,1]
    scattered: Tensor  # (B,H,W,3) radiance
    integrated: Tensor  # (B,H,W) float32 share of the lights for which the pixel's ray was integrated


@dataclass(frozen=True, eq=False, kw_only=True)
class Illumination:
    """What lights the media: lights with the depth images that tell what they reach, and what comes from everywhere."""

    lights: Sequence[Light] = ()
    shadow_maps: Sequence[ShadowMap | None] = ()  # one per light; None: the light reaches everything
    caster: RayCaster | None = None  # of shadows="rays"
    surroundings: Surroundings | None = None
    size: float = 1.0  # diagonal of the scene, scene units
    nearest: float | None = None  # scene units below which lamps get no brighter; None: by the options

    def __post_init__(self) -> None:
        if self.shadow_maps and len(self.shadow_maps) != len(self.lights):
            raise InputError(
                f"shadow_maps must have {len(self.lights)} entries, one per light, got {len(self.shadow_maps)}"
            )

    def map_of(self, number: int) -> ShadowMap | None:
        """The depth images of one light."""
        return self.shadow_maps[number] if self.shadow_maps else None

    def nearest_of(self, light: Light, eye: Tensor, options: ScatterOptions) -> float:
        """Length below which a lamp gets no brighter, as seen from ``eye`` (3,): it should be small beside a pixel."""
        if self.nearest is not None:
            return self.nearest
        away = self.size
        if not isinstance(light, DirectionalLight):
            away = min(away, float(vectors_to(light, eye.double()[None]).norm()))
        return options.nearest * max(away, 1e-6 * self.size, 1e-12)


def scatter(
    media: Sequence[Medium],
    cameras: Cameras,
    depth: Tensor,
    illumination: Illumination,
    options: ScatterOptions | None = None,
    *,
    position: Tensor | None = None,
) -> ScatteringLayer:
    """What media put before pictures: of rendered scenes, or of photographs with a depth image.

    Args:
        cameras: B of them.
        depth: (B,H,W) camera z of what they see; +inf where that is nothing.
        position: (B,H,W,3) float64 places of what they see, if they are known.

    Raises:
        InputError: shapes that do not fit, or shadow maps with skew.
    """
    options = options_of(options, ScatterOptions)
    parts = []
    for number in range(len(cameras)):
        place = None if position is None else position[number]
        parts.append(_one(media, cameras[number], depth[number], illumination, options, place))
    if not parts:
        empty = torch.zeros(*depth.shape, 3)
        return ScatteringLayer(empty, empty, torch.zeros(depth.shape))
    return ScatteringLayer(*(_batch(images) for images in zip(*parts, strict=True)))


def _batch(images: Sequence[Tensor]) -> Tensor:
    """One tensor of images; of a single one a view."""
    return images[0][None] if len(images) == 1 else torch.stack(list(images))


def _one(
    media: Sequence[Medium],
    camera: Cameras,
    depth: Tensor,
    illumination: Illumination,
    options: ScatterOptions,
    position: Tensor | None,
) -> tuple[Tensor, Tensor, Tensor]:
    table = MediaTable.of(media, eye_of(camera))
    return scatter_along(rays_of(camera, depth, table, position), table, illumination, options)


def scatter_along(
    rays: EyeRays, table: MediaTable, illumination: Illumination, options: ScatterOptions
) -> tuple[Tensor, Tensor, Tensor]:
    """Transmittance (H,W,3), scattered light (H,W,3) and share that was integrated (H,W), of any rays."""
    shape = rays.shape
    count = shape[0] * shape[1]
    if not len(table) or not bool((rays.length > 0).any()):
        return torch.ones(*shape, 3), torch.zeros(*shape, 3), torch.zeros(shape)
    ways = _ways(table, rays, options)
    channels = table.arrays.extinction.shape[1]
    # Where extinction has no colour, one channel is enough, seen three times.
    transmittance = torch.exp(-(ways @ table.extinction[:, :channels])).reshape(*shape, channels).expand(*shape, 3)
    norm: Tensor | None = None
    parts: list[Tensor] = []
    integrated = torch.zeros(shape)
    for number, light in enumerate(illumination.lights):
        lamp = LightTable.of(
            light, table.origin, illumination.nearest_of(light, table.origin, options), options.falloff
        )
        integrate, quick = _integrator(lamp, illumination, number, table, rays, options)
        if quick:
            found = every_ray(integrate, rays, channels)
            integrated += 1.0
        else:
            norm = normaliser(rays, table, ways, options) if norm is None else norm
            place = (
                None if lamp.kind == SUN or options.block == 1 else torch.from_numpy(lamp.numbers[PLACE : PLACE + 3])
            )
            guard = Guard.of(place, rays, options.halo_guard_px)
            found, marked = between(integrate, rays, norm, guard, channels, options)
            integrated += torch.from_numpy(marked)
        parts.append(_tinted(torch.from_numpy(found), table.tint * lamp.color))
    around = glow(table, rays, illumination.surroundings, ways, options)
    if around is not None:
        parts.append(around)
    total = parts[0] if parts else torch.zeros(count, 3)
    for part in parts[1:]:
        total = total + part
    return transmittance, total.reshape(*shape, -1).expand(*shape, 3), integrated / max(len(illumination.lights), 1)


def _tinted(found: Tensor, color: Tensor) -> Tensor:
    """(N,C) in a colour: one channel, where there is none."""
    return found * (color[:1] if bool((color == color[0]).all()) and found.shape[1] == 1 else color)


def _ways(table: MediaTable, rays: EyeRays, options: ScatterOptions) -> Tensor:
    """(H W,M) integrals of the densities along the rays; through grids they lie between those of a lattice."""
    ways = torch.zeros(len(rays.beams.direction), len(table))
    if not table.has_grid or not ways_by_lattice(table, rays, GRID_STEPS, options, ways.numpy()):
        ways_through(table.arrays, rays.beams, GRID_STEPS, ways.numpy())
    return ways


def _integrator(
    lamp: LightTable, illumination: Illumination, number: int, table: MediaTable, rays: EyeRays, options: ScatterOptions
) -> tuple[Integrate, bool]:
    """What integrates rays of one light, and whether all of them take no longer than to interpolate most of them.

    Everything is made anew: nothing lasts.
    """
    shadow_map = illumination.map_of(number) if options.shadows == "maps" else None
    if options.way == "march":
        sight = illumination.caster if options.shadows == "rays" else shadow_map
        return Marcher(table, lamp, rays, sight, options), False
    reach = _farthest(lamp, rays)
    images, slices, way = NO_IMAGES, NO_SLICES, EVERYWHERE
    if shadow_map is not None:
        views = views_of(shadow_map, table.origin)
        made = None
        if options.way == "slices" and rays.sight is not None:
            made = slices_of(shadow_map, views, lamp, rays.sight, options)
        images = images_of(shadow_map, views, pyramid=made is None)
        slices, way = (NO_SLICES, WALKED) if made is None else (made, SLICED)
    media, airlight = table.towards(lamp.kind, lamp.numbers, options), lamp.airlight(table, reach)
    lattice = lattice_of(media, lamp, table, rays, options) if airlight is NOTHING else NO_LATTICE
    source = Source(lamp.numbers, airlight, *lattice)
    panels = options.panels * (2 if table.has_grid else 1)
    # Most lit parts of a ray; room that is never touched costs time, too.
    most = 8 + slices.rows.shape[1] // 2
    if way == WALKED:
        most += 2 * int(images.levels[0, 1:].sum()) * max(len(images.views), 1)
    settings = (lamp.kind, way, panels, most, np.float32(reach))
    closed = way == SLICED and _has_closed_form(lamp, airlight, table, rays)

    def integrate(rows: np.ndarray, out: Scattered) -> None:
        if closed:
            missed = np.empty(-(-len(rows) // CHUNK), np.int64)
            how = lamp.kind == SUN, np.float32(reach)
            scatter_sliced(media, (lamp.numbers, airlight), slices, rays.beams, rows, how, out, missed)
            if not missed.any():
                return
            rows = rows[out.told[rows, 1] < 0]
        scatter_rays(media, source, images, slices, rays.beams, rows, settings, out)

    return integrate, closed


def _has_closed_form(lamp: LightTable, airlight: np.ndarray, table: MediaTable, rays: EyeRays) -> bool:
    """Light along rays is a table's, or sunlight in the only, homogeneous, medium that is not too thick for
    differences of integrals along them."""
    if lamp.kind != SUN:
        return airlight is not NOTHING
    media = table.arrays
    if len(table) != 1 or media.kind[0] != FLAT or rays.sight is None:
        return False
    longest = min(rays.sight.longest, float(np.linalg.norm(media.high[0] - media.low[0])))
    return bool((media.extinction[0] * media.numbers[0, 0]).max() * longest <= THICKEST)


def _farthest(lamp: LightTable, rays: EyeRays) -> float:
    """A distance from the lamp that no ray's nearest place exceeds."""
    place = lamp.numbers[PLACE : PLACE + 3]
    return float(np.linalg.norm(rays.beams.origin - place, axis=1).max()) + 1e-6
