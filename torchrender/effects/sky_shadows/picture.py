"""Shadows under the sky in a picture: light that spheres take from what is seen."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.arrays import view
from torchrender.buffers import GBuffer
from torchrender.effects.sky_shadows.light import SkyLight, cube_radiance, prepare_light
from torchrender.effects.sky_shadows.occluder import Occluder
from torchrender.effects.sky_shadows.options import INSIDE, SkyLightOptions
from torchrender.effects.sky_shadows.shade import shade
from torchrender.kernels.ambient.spread import Few, Many, spread_points
from torchrender.kernels.sky_shadows.lost import Known, Seen, take_away
from torchrender.numerics.color import luminance
from torchrender.scene.environment import Environment
from torchrender.scene.model import Scene
from torchrender.shading.fused import is_of, matt_fused
from torchrender.shading.lobes import Around, metallic_roughness, phong
from torchrender.shading.plain import CHUNK, origin_of
from torchrender.shading.sky import Sky, SkyMaps
from torchrender.shading.surface import METALLIC, PHONG, Reader

_LIGHTS: WeakIdKeyDictionary = WeakIdKeyDictionary()
EVEN = 0.6
"""Spread of radiance over directions, in its mean, below which shadows are too soft to need more than one number."""

SHIFTS = ((-0.25, -0.25, -0.375), (0.25, -0.25, 0.125), (-0.25, 0.25, 0.375), (0.25, 0.25, -0.125))
"""Of four neighbouring points, in texels, texels and bins of radii: their mean is smooth where each has steps."""

SHOWS = 1.0 / 512.0
"""Share of light that may be missing unseen."""


def light_of(environment: Environment, options: SkyLightOptions) -> SkyLight:
    """The environment's light, prepared once."""
    known = _LIGHTS.setdefault(environment, {})
    if options not in known:
        with torch.inference_mode(False), torch.no_grad():
            known[options] = prepare_light(environment, options)
    made: SkyLight = known[options]
    return made


def unevenness(environment: Environment) -> float:
    """Standard deviation of radiance over directions, blurred to a few degrees, in its mean; 0 without light."""
    known = _LIGHTS.setdefault(environment, {})
    if "spread" not in known:
        value = luminance(cube_radiance(environment)).reshape(6, 8, 4, 8, 4).mean((2, 4))
        mean = float(value.mean())
        known["spread"] = float(value.std()) / mean if mean > 0 else 0.0
    found: float = known["spread"]
    return found


def light_left(scene: Scene, gbuffer: GBuffer, occluder: Occluder, light: SkyLight, spacing: int = 1) -> Tensor:
    """Share (B,H,W,4) of the environment's light on matt surfaces that the occluder's spheres leave; 1 where empty.

    The fourth is that of light that is the same from everywhere. Shaded are one of ``spacing`` times ``spacing``
    pixels; those between follow along the surfaces seen. Neighbouring points round
    directions and sizes of spheres differently, so that steps of a texel do not show.
    """
    spheres = occluder.spheres(scene)
    own, body = occluder.face_spheres(scene), occluder.bodies
    batch, height, width = gbuffer.covered.shape
    if gbuffer.cameras.orthographic or min(height, width) < 2 * spacing:
        spacing = 1  # no eye to spread from, or too few rows
    out = torch.ones(batch, height, width, 4)
    rows = slice(spacing // 2, None, spacing)
    grid = len(range(height)[rows]), len(range(width)[rows])
    shifts = _shifts(*grid) if spacing > 1 else torch.zeros(*grid, 3)
    for b in range(batch):
        triangle = gbuffer.triangle[b, rows, rows]
        seen = triangle >= 0
        values = torch.ones(*triangle.shape, 4)
        if bool(seen.any()):
            surface = gbuffer.position[b, rows, rows][seen], gbuffer.normal[b, rows, rows][seen]
            values[seen] = _share(surface, own[triangle[seen]], (spheres, body), light, shifts[seen])
        if spacing == 1:
            out[b] = values
        else:
            _spread(gbuffer, b, (rows, values), out[b], spacing)
    return out


def _shifts(rows: int, columns: int) -> Tensor:
    """(h,w,3) shifts of points that repeat after two, along rows and columns: spreading weighs all four alike."""
    odd = torch.arange(rows)[:, None] % 2 * 2 + torch.arange(columns)[None] % 2
    return torch.tensor(SHIFTS)[odd]


def _share(
    surface: tuple[Tensor, Tensor], own: Tensor, hiding: tuple[Tensor, Tensor], light: SkyLight, shift: Tensor
) -> Tensor:
    """Share (N,4) of the light that is left, channel by channel, and of even light; 1 where there is none."""
    # A surface that spheres reach through touches what they stand for; one of that itself is not hidden by it.
    points, normals = surface
    spheres, body = hiding
    inside = torch.full_like(own, INSIDE.index("half"))[None]
    found = shade(
        points[None], normals[None], spheres[None], light, own_sphere=own[None], inside=inside, body=body,
        shift=shift[None],
    )  # fmt: skip
    left, whole = found.radiance[0], found.whole[0]
    share = torch.where(whole > 0, left / whole.clamp_min(1e-30), 1.0)
    return torch.cat([share, found.open_share[0, :, None]], dim=1).clamp(0.0, 1.0)


def _spread(gbuffer: GBuffer, b: int, few: tuple[slice, Tensor], out: Tensor, spacing: int) -> None:
    rows, values = few
    cameras = gbuffer.cameras
    pose = cameras.camera_from_world[b].double()
    position = gbuffer.position[b, rows, rows] @ pose[:3, :3].T + pose[:3, 3]
    normal = gbuffer.normal[b, rows, rows].double() @ pose[:3, :3].T
    k = cameras.intrinsics[b]
    lens = torch.stack([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    points = Few(
        view(position, np.float32), view(normal, np.float32), view(values, np.float32), spacing,
    )  # fmt: skip
    pixels = Many(
        view(gbuffer.depth[b], np.float32), view(gbuffer.normal[b], np.float32), view(pose[:3, :3], np.float32),
        view(lens, np.float32),
    )  # fmt: skip
    spread_points(points, pixels, out.numpy())


def no_more_than_hides(left: Tensor, sky: Tensor, own: Tensor) -> Tensor:
    """Shares (B,H,W,4) that spheres leave: on the occluder itself they hide no more than all surfaces together.

    Spheres bulge out of flat faces and hide those beside them, where the object itself may hide nothing.

    Args:
        left: (B,H,W,4) as :func:`light_left` has it.
        sky: (B,H,W) share of the sky that is open.
        own: (B,H,W) bool: pixels that see the occluder.
    """
    hidden = 1.0 - left[..., 3]
    share = ((1.0 - sky) / hidden.clamp_min(1e-6)).clamp(0.0, 1.0)
    return torch.where(own[..., None], 1.0 - (1.0 - left) * share[..., None], left)


class Surroundings(NamedTuple):
    """What all surfaces together leave of the sky's light, as the picture's light was computed with."""

    taken: Tensor  # (B,H,W) share of the light that arrived
    normal: Tensor | None  # (B,H,W,3) unit, where it was looked up; None: along the surface's normal
    sky: Tensor  # (B,H,W) share of the sky that is open, the occluder among what hides it


class _LostSky(Sky):
    """The environment's light that does not arrive: diffuse only."""

    def __init__(self, scene: Scene) -> None:
        super().__init__(replace(scene, ambient=torch.zeros(3)))
        self.lost = torch.zeros(3, 0)

    def diffuse(self, normal: Tensor) -> Tensor:
        """Irradiance over pi (3,N)."""
        del normal
        return self.lost

    def arriving(self, normal: Tensor) -> Tensor:
        """Irradiance over pi (3,N) at normals (3,N), all of it."""
        return super().diffuse(normal)

    def mirrored(self, direction: Tensor, roughness: Tensor) -> Tensor:
        """Nothing."""
        del roughness
        return torch.zeros_like(direction)


def light_lost(scene: Scene, gbuffer: GBuffer, left: Tensor, around: Surroundings | None = None) -> Tensor:
    """Radiance (B,H,W,3) that surfaces send less of the environment's light, of which shares ``left`` arrive.

    Where all surfaces hide a part of the sky (``around``), the occluder is among them: its part, the share of even
    light that its spheres hide, is taken out of theirs, and ``left`` put in its place. Where the occluder stands before
    what is dark, surfaces so gain light: the loss is negative.

    Samples of the scene's own triangles go through compiled kernels, others through torch.

    Args:
        left: (B,H,W,4) as :func:`light_left` has it.
        around: what the picture's light was computed with; None: nothing was hidden.
    """
    flat = left.reshape(-1, 4)
    chosen = gbuffer.covered.reshape(-1) & (flat < 1.0 - SHOWS).any(dim=-1)
    image = torch.zeros(len(flat), 3)
    if bool(chosen.any()):
        (_lost_fused if is_of(gbuffer, scene) else _lost_plain)(scene, gbuffer, (flat, around), chosen, image)
    return image.reshape(*left.shape[:-1], 3)


_Shares = tuple[Tensor, Surroundings | None]
"""(N,4) what spheres leave, and what all surfaces together do."""


def _lost_fused(scene: Scene, gbuffer: GBuffer, shares: _Shares, chosen: Tensor, out: Tensor) -> None:
    """Fill the chosen pixels (N,) of ``out`` (N,3)."""
    left, around = shares
    sent, surface = matt_fused(scene, gbuffer, chosen)
    none = torch.zeros(0)
    known = Known(*(view(v, np.float32) for v in (none, none, none.reshape(0, 3))))
    if around is not None:
        bent = torch.zeros(0, 3)
        if around.normal is not None:
            smooth = torch.where(chosen[:, None], gbuffer.normal.reshape(-1, 3), surface[:, :3])
            bent = Around(None, around.normal.reshape(-1, 3).T).towards(surface[:, :3].T, smooth.T).T
        known = Known(*(view(v, np.float32) for v in (around.taken.reshape(-1), around.sky.reshape(-1), bent)))
    assert scene.environment is not None
    texels = SkyMaps.of(scene.environment, scene.material_table.has_physical).irradiance.reshape(-1, 3)
    seen = Seen(view(left, np.float32), view(surface, np.float32), view(sent, np.float32))
    take_away(seen, known, view(texels, np.float32), out.numpy())


def _lost_plain(scene: Scene, gbuffer: GBuffer, shares: _Shares, chosen: Tensor, out: Tensor) -> None:
    """The same in torch."""
    left, around = shares
    reader, sky = Reader(scene, gbuffer, origin_of(scene, gbuffer)), _LostSky(scene)
    for chunk in chosen.nonzero().reshape(-1).split(CHUNK):
        out[chunk] = _lost_of(reader, sky, chunk, (left[chunk], around))


def _lost_of(reader: Reader, sky: _LostSky, rows: Tensor, shares: _Shares) -> Tensor:
    surface = reader.surface(rows)
    surface = replace(surface, emission=torch.zeros_like(surface.emission))
    lost = _lost_light(sky, (surface.normal, surface.smooth), rows, shares)
    value = torch.zeros(3, len(rows))
    for kind, sent in ((PHONG, phong), (METALLIC, metallic_roughness)):
        some = (surface.kind == kind).nonzero().reshape(-1)
        if len(some):
            sky.lost = lost[:, some]
            value[:, some] = sent(surface.select(some), sky, Around(), []).radiance
    return value.T


def _lost_light(sky: _LostSky, normals: tuple[Tensor, Tensor], rows: Tensor, shares: _Shares) -> Tensor:
    """Irradiance over pi (3,N) that does not arrive at normals (3,N), with their maps and without."""
    (left, around), (normal, smooth) = shares, normals
    if around is None:
        return sky.arriving(normal) * (1.0 - left[:, :3]).T
    taken, whole = around.taken.reshape(-1)[rows], around.sky.reshape(-1)[rows]
    others = (whole / left[:, 3].clamp_min(1e-6)).clamp(0.0, 1.0)  # share that is left by what else is there
    was = towards = normal
    if around.normal is not None:
        was = Around(None, around.normal.reshape(-1, 3)[rows].T).towards(normal, smooth)
        # The open sky's middle lies off the normal in the measure in which others hide it.
        part = ((1.0 - others) / (1.0 - whole).clamp_min(1e-6)).clamp(0.0, 1.0)
        towards = normalize(torch.lerp(normal, was, part), dim=0)
    return sky.arriving(was) * taken - sky.arriving(towards) * (others * left[:, :3].T)
