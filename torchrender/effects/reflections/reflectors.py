"""Which pixels mirror, in which direction, and how what they mirror is blended with their own colour.

A pixel is reflective if its material is a reflector (:attr:`Material.is_reflector`). Reflectors are the scene's
objects. ``colour = lerp(direct, tint * reflected, F)`` with Schlick's F of the specular degree: specification 03 blends
by the degree itself, specification 04 by Schlick's term, which is the same at normal incidence; one rule serves both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.buffers import GBuffer, RayHits, ReflectionLayer, ReflectionState
from torchrender.checks import check_class, check_tensor
from torchrender.effects.reflections.contacts import with_contacts
from torchrender.numerics.lobe import ggx_directions, lobe_directions, reflect, schlick
from torchrender.rays import RayCaster
from torchrender.scene.camera import Cameras
from torchrender.scene.model import Scene
from torchrender.shading.mirrors import mirror_values

START = 2.0**-4
"""Distance from the reflector at which rays start, in their widths: what is seen from afar is known the less."""
LOBES = ("ggx", "cone")
GGX_WIDTH = 2.0 * math.sqrt(math.pi)
"""Width per alpha of the solid angle ``4 pi alpha^2`` that is one over the density of rays in the middle of a lobe: a
ray is as wide as its share of that (filtered importance sampling, Krivanek and Colbert 2008)."""


@dataclass(frozen=True, eq=False)
class ReflectivePixels:
    """The N reflective pixels of B pictures, in flat (B,H,W) order."""

    shape: tuple[int, int, int]  # (B,H,W) of the pictures
    cameras: Cameras  # that saw them
    pixel: Tensor  # (N,) int64 place in the flat pictures
    position: Tensor  # (N,3) float64
    normal: Tensor  # (N,3) float64 unit shading normal
    geometric_normal: Tensor  # (N,3) float64 unit
    view: Tensor  # (N,3) float64 unit, from the eye
    direction: Tensor  # (N,3) float64 unit, mirrored, never below the geometric surface
    gloss: Tensor  # (N,) float64 lobe width
    object_id: Tensor  # (N,) int64 reflector
    depth: Tensor  # (N,) float64 camera z
    length: Tensor  # (N,) float64 from the eye
    pixel_angle: Tensor  # (N,) float64 width of a pixel per unit of ray length

    __repr__ = brief

    def __len__(self) -> int:
        return len(self.pixel)

    def select(self, index: Tensor) -> ReflectivePixels:
        """Some of the pixels, by index or mask (N,)."""
        own = {name: value for name, value in vars(self).items() if name not in ("shape", "cameras")}
        return ReflectivePixels(
            shape=self.shape, cameras=self.cameras, **{name: value[index] for name, value in own.items()}
        )

    def pictures(self) -> list[ReflectivePixels]:
        """Those of each picture alone."""
        count, size = self.shape[0], self.shape[1] * self.shape[2]
        if count <= 1:
            return [self]
        ends = torch.searchsorted(self.pixel, torch.arange(count + 1) * size).tolist()
        parts = []
        for k in range(count):
            own = self.select(torch.arange(ends[k], ends[k + 1]))
            shape = (1, self.shape[1], self.shape[2])
            parts.append(replace(own, shape=shape, cameras=self.cameras[k], pixel=own.pixel - k * size))
        return parts


@dataclass(frozen=True, eq=False)
class ReflectedRays:
    """N rays that leave reflectors; with ``width + spread t`` as their width at length t."""

    origin: Tensor  # (N,3) float64, on the reflector
    direction: Tensor  # (N,3) float64 unit
    width: Tensor  # (N,) float64
    spread: Tensor  # (N,) float64
    many: bool = False  # each is one of several of a lobe, whose mean counts

    def select(self, index: Tensor) -> ReflectedRays:
        """Some of the rays, by index or mask (N,)."""
        own = (self.origin[index], self.direction[index], self.width[index], self.spread[index])
        return ReflectedRays(*own, self.many)

    def first_hits(self, caster: RayCaster) -> RayHits:
        """What the rays meet, off the reflectors that they leave, and what touches these."""
        start = START * self.width
        hits = caster.first_hit(self.origin, self.direction, t_min=start)
        return with_contacts(caster, self.origin, self.direction, start, hits)


@dataclass(frozen=True, eq=False)
class MirroredPoints:
    """N places on reflectors that rays hit, and where these are mirrored to."""

    rays: ReflectedRays  # that leave them
    normal: Tensor  # (N,3) float64 unit shading normal
    geometric_normal: Tensor  # (N,3) float64 unit
    arriving: Tensor  # (N,3) float64 unit direction of the rays that hit them
    length: Tensor  # (N,) float64 of these rays
    gloss: Tensor  # (N,) float64 lobe width
    object_id: Tensor  # (N,) int64 reflector


Onward = Callable[[MirroredPoints], Tensor]
"""What mirrors show that are themselves seen in mirrors: radiance (N,3) that arrives along the lobes."""


class RayShader(Protocol):
    """Radiance that arrives along rays. Handed in by whoever makes the picture, so that reflections show its light."""

    def __call__(self, rays: ReflectedRays, hits: RayHits, onward: Onward | None = None) -> Tensor:
        """(N,3) towards the rays' origins; rays that hit nothing bring what surrounds the scene.

        Args:
            onward: what mirrors among the hits show; None: a guess by ``surroundings``.
        """

    def environment(
        self,
        direction: Tensor,
        eyes: Tensor | None = None,
        spread: Tensor | None = None,
        leaving: tuple[Tensor, Tensor] | None = None,
    ) -> Tensor:
        """(N,3) the scene as its middle sees it, along unit directions (N,3) of rays that ``spread`` (N,), in a
        picture from ``eyes`` (B,3); or as reflectors do: ``leaving`` = places (N,3) on them, and their objects (N,)."""

    def surroundings(self, position: Tensor, direction: Tensor, eyes: Tensor | None = None) -> Tensor:
        """(N,3) a guess, without rays, at what arrives at positions (N,3) from unit directions (N,3)."""


def reflective(scene: Scene, gbuffer: GBuffer) -> Tensor:
    """(B,H,W) bool: a reflector is seen there, and has a normal."""
    is_reflector = scene.material_table.is_reflector
    if not bool(is_reflector.any()):
        return torch.zeros(gbuffer.material.shape, dtype=torch.bool)
    return is_reflector[gbuffer.material] & (gbuffer.normal.square().sum(-1) > 0.25)


def reflective_pixels(scene: Scene, gbuffer: GBuffer, mask: Tensor | None = None) -> ReflectivePixels:
    """The reflective pixels of a G-buffer, or those of them in ``mask`` (B,H,W) bool."""
    check_class("scene", scene, Scene)
    check_class("gbuffer", gbuffer, GBuffer)
    chosen = reflective(scene, gbuffer)
    if mask is not None:
        chosen = chosen & check_tensor("mask", mask, tuple(chosen.shape))
    pixel = chosen.reshape(-1).nonzero().reshape(-1)
    position, flat = (
        image.reshape(-1, 3).index_select(0, pixel).double() for image in (gbuffer.position, gbuffer.geometric_normal)
    )
    normal, gloss = mirror_values(scene, gbuffer, pixel)
    normal = torch.nn.functional.normalize(normal.double(), dim=-1, eps=1e-30)
    cameras = gbuffer.cameras
    camera = pixel // (cameras.width * cameras.height)
    size = (1.0 / cameras.intrinsics[:, (0, 1), (0, 1)]).amax(dim=1)
    depth = gbuffer.depth.reshape(-1)[pixel].double()
    if cameras.orthographic:
        view = cameras.forward[camera]
        length = torch.ones(len(pixel), dtype=torch.float64)
        angle = size[camera]
    else:
        offset = position - cameras.eye[camera]
        length = offset.norm(dim=-1)
        view = offset / length.clamp_min(1e-300)[:, None]
        angle = size[camera] * depth / length.clamp_min(1e-300)
    return ReflectivePixels(
        shape=(gbuffer.material.shape[0], gbuffer.material.shape[1], gbuffer.material.shape[2]),
        cameras=cameras,
        pixel=pixel,
        position=position,
        normal=normal,
        geometric_normal=flat,
        view=view,
        direction=mirrored_direction(view, normal, flat),
        gloss=gloss,
        object_id=gbuffer.object_id.reshape(-1)[pixel],
        depth=depth,
        length=length,
        pixel_angle=angle,
    )


def mirrored_direction(view: Tensor, normal: Tensor, flat: Tensor) -> Tensor:
    """Mirrored view directions; those that a bent shading normal sends into the surface are mirrored out of it."""
    direction = reflect(view, normal)
    into = (direction * flat).sum(-1, keepdim=True).clamp_max(0.0)
    return torch.nn.functional.normalize(direction - 2.0 * into * flat, dim=-1, eps=1e-30)


def reflected_rays(pixels: ReflectivePixels, direction: Tensor | None = None) -> ReflectedRays:
    """One ray per pixel, along ``direction`` (N,3) or the mirrored direction."""
    angle = pixels.pixel_angle
    toward = pixels.direction if direction is None else direction
    return ReflectedRays(pixels.position, toward, angle * pixels.length, angle)


def lobe_rays(pixels: ReflectivePixels, count: int, lobe: str = "ggx") -> tuple[ReflectedRays, Tensor]:
    """``count`` rays for each pixel, (N count) in all, spread over its lobe, and the weights (N count) of what they
    bring; each ray is as wide as its share of the lobe.

    Args:
        lobe: of facets ("ggx", alpha = gloss squared), or an even "cone" as published.
    """
    column, row = pixels.pixel % pixels.shape[2], pixels.pixel // pixels.shape[2] % pixels.shape[1]
    turn = noise_angle(column, row)
    facing = (pixels.view, pixels.normal, pixels.geometric_normal)
    return spread_rays(reflected_rays(pixels), facing, pixels.gloss, turn, count, lobe)


def noise_angle(column: Tensor, row: Tensor) -> Tensor:
    """Angles (N,) that differ much between neighbouring places, without a random generator.

    Interleaved gradient noise (Jimenez 2014).
    """
    return 2.0 * torch.pi * (52.9829189 * (0.06711056 * column.double() + 0.00583715 * row.double()).frac()).frac()


def spread_rays(
    mirrored: ReflectedRays,
    seen: tuple[Tensor, Tensor, Tensor],
    gloss: Tensor,
    turn: Tensor,
    count: int,
    lobe: str = "ggx",
) -> tuple[ReflectedRays, Tensor]:
    """:func:`lobe_rays` of N mirrored rays: ``seen`` = directions of arrival, shading and geometric normals (N,3).
    Weights have a mean of 1: how much a surface mirrors in all, whatever its lobe loses, is the material's to say."""
    arriving, normal, flat = seen
    if lobe == "cone":
        toward = lobe_directions(mirrored.direction, flat, gloss, count, turn)
        weight = torch.ones(toward.shape[:2], dtype=torch.float64)
        share = gloss * (torch.pi / 6.0) * 2.0 / count**0.5
    else:
        alpha = gloss.square()
        toward, weight = ggx_directions(-arriving, normal, alpha, count, turn)
        mean = weight.mean(1, keepdim=True)
        weight = torch.where(mean > 0.0, weight / mean.clamp_min(1e-30), 1.0)  # all below a bent normal: all count
        below = (toward * flat[:, None]).sum(-1, keepdim=True).clamp_max(0.0)
        toward = toward - 2.0 * below * flat[:, None]
        share = GGX_WIDTH * alpha / count**0.5
    rays = ReflectedRays(
        origin=mirrored.origin.repeat_interleave(count, 0),
        direction=toward.reshape(-1, 3),
        width=mirrored.width.repeat_interleave(count),
        spread=torch.maximum(mirrored.spread, share).repeat_interleave(count),
        many=mirrored.many or count > 1,
    )
    return rays, weight.reshape(-1)


def reflection_layer(
    pixels: ReflectivePixels, color: Tensor, distance: Tensor, state: Tensor, cluster: Tensor | None = None
) -> ReflectionLayer:
    """The layer that holds values (N,...) of the given pixels and nothing elsewhere."""
    count = pixels.shape[0] * pixels.shape[1] * pixels.shape[2]

    def image(value: Tensor, dtype: torch.dtype, empty: float = 0) -> Tensor:
        flat = torch.full((count, *value.shape[1:]), empty, dtype=dtype)
        return flat.index_copy(0, pixels.pixel, value.to(dtype)).reshape(*pixels.shape, *value.shape[1:])

    none = torch.full((len(pixels),), -1, dtype=torch.int64)
    return ReflectionLayer(
        color=image(color, torch.float32),
        distance=image(distance, torch.float32),
        direction=image(pixels.direction, torch.float32),
        state=image(state, torch.uint8),
        cluster=image(none if cluster is None else cluster, torch.int64, -1),
    )


def blend_reflections(scene: Scene, gbuffer: GBuffer, direct: Tensor, layer: ReflectionLayer) -> Tensor:
    """Radiance (B,H,W,3): ``direct`` with what its reflective pixels mirror; other pixels stay untouched."""
    rows = (layer.state != ReflectionState.NONE).reshape(-1).nonzero().reshape(-1)
    if not len(rows):
        return direct
    own = direct.reshape(-1, 3).index_select(0, rows)
    mirrored = layer.color.reshape(-1, 3).index_select(0, rows)
    if layer.share is not None:
        replaced, weight = (
            v.reshape(-1, 3).index_select(0, rows) for v in (layer.share.replaced, layer.share.mirrored)
        )
        mixed = own - replaced + weight * mirrored
        return direct.reshape(-1, 3).index_copy(0, rows, mixed.clamp_min(0.0)).reshape(direct.shape)
    normal = gbuffer.normal.reshape(-1, 3).index_select(0, rows)
    toward = layer.direction.reshape(-1, 3).index_select(0, rows)
    mixed = blend_colors(scene, gbuffer.material.reshape(-1)[rows], (normal * toward).sum(-1).abs(), own, mirrored)
    return direct.reshape(-1, 3).index_copy(0, rows, mixed).reshape(direct.shape)


def mirrored_light(scene: Scene, gbuffer: GBuffer, layer: ReflectionLayer) -> Tensor:
    """(B,H,W,3) the part of :func:`blend_reflections` that was mirrored; 0 where nothing is."""
    if layer.share is not None:
        part = layer.share.mirrored * layer.color
    else:
        cosine = (gbuffer.normal * layer.direction).sum(-1).abs()
        share, tint = _share(scene, gbuffer.material, cosine)
        part = share[..., None] * tint * layer.color
    return torch.where((layer.state != ReflectionState.NONE)[..., None], part, 0.0)


def blend_colors(scene: Scene, material: Tensor, cosine: Tensor, direct: Tensor, mirrored: Tensor) -> Tensor:
    """The same for N points: colours (N,3), material (N,), cosine (N,) between normal and reflected direction."""
    share, tint = _share(scene, material, cosine)
    return torch.lerp(direct, tint * mirrored, share[:, None])


def _share(scene: Scene, material: Tensor, cosine: Tensor) -> tuple[Tensor, Tensor]:
    """Share (N,) of mirrored light and its tint (N,3)."""
    table = scene.material_table
    return schlick(table.mirrored[material], cosine), table.tint[material]


def mirrored_share(scene: Scene, gbuffer: GBuffer, pixels: ReflectivePixels) -> Tensor:
    """(N,) largest share, over the three colours, of what a pixel mirrors in its blended colour."""
    material = gbuffer.material.reshape(-1)[pixels.pixel]
    cosine = (pixels.normal * pixels.direction).sum(-1).abs().float()
    table = scene.material_table
    return schlick(table.mirrored[material], cosine) * table.tint.amax(dim=1).clamp_min(0.0)[material]
