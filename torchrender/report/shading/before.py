"""Direct light as torch computed it, from a whole G-buffer, before there was a kernel: what the study compares with.

``colour = texture (ambient + sum_l s_l diffuse_l) + sum_l s_l specular_l + emission`` with shadow factors ``s_l`` as
an input: shadows never darken the ambient part, so that a fully shadowed pixel is exactly texture times ambient plus
emission.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RaySurface
from torchrender.checks import ArrayLike, as_vector, check_choice, check_tensor
from torchrender.numerics.polygon_light import polygon_irradiance
from torchrender.numerics.texture import color_pyramid, sample_texture
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene
from torchrender.scene.sky.harmonics import environment_bands, harmonics_2

CHUNK = 1 << 15
"""Pixels shaded at a time: their intermediate values stay in the processor's cache."""

AREA_LIGHTS = ("polygon", "centre")

NEAREST_LIGHT = 1e-4
"""Closest distance to a point light that counts, in bounding-box diagonals: keeps inverse squares finite."""


_HARMONICS: dict[Environment, Tensor] = {}


@dataclass(frozen=True, eq=False)
class _Tables:
    """The M materials of a scene as shading reads them."""

    diffuse: Tensor  # (M+1,3)
    specular: Tensor  # (3,M+1) degree times tint
    shininess: Tensor  # (M+1,)
    emission: Tensor  # (3,M+1)
    textures: tuple[Tensor | None, ...]
    origin: Tensor  # (3,) float64 world space: where float32 positions are finest

    @classmethod
    def of(cls, scene: Scene, cameras: Cameras | None = None) -> _Tables:
        """Positions are finest at the scene's centre, or with perspective cameras where the first one stands: what is
        near it must not suffer from a backdrop far away. An eye outside the scene's box counts as being at its side.
        """
        table, bounds = scene.material_table, scene.bounds
        origin = bounds.mean(dim=0)
        if cameras is not None and not cameras.orthographic:
            origin = torch.minimum(torch.maximum(cameras.eye[0], bounds[0]), bounds[1])
        return cls(
            diffuse=table.diffuse,
            specular=table.highlight.T.contiguous(),
            shininess=table.shininess,
            emission=table.emission.T.contiguous(),
            textures=tuple(m.diffuse_texture for m in scene.materials),
            origin=origin,
        )


@dataclass(frozen=True, eq=False)
class _Surface:
    """N covered pixels, component by component, so that sums over components run along memory."""

    origin: Tensor  # (3,) float64, world space
    position: Tensor  # (3,N) relative to the origin: float32 keeps its precision far from the world's origin, too
    normal: Tensor  # (3,N)
    geometric_normal: Tensor  # (3,N)
    mirror: Tensor | None  # (3,N) direction to the eye, mirrored at the shading normal; None: nothing is specular
    albedo: Tensor  # (3,N) diffuse reflectance times texture times vertex colour
    specular: Tensor  # (3,N) tint of mirrored light
    shininess: Tensor  # (N,) Phong exponent
    emission: Tensor  # (3,N)


@dataclass(frozen=True, eq=False)
class _Arrival:
    """What one light brings to N points, for shadow factor one."""

    irradiance: Tensor  # (N,) cosine-weighted, to be multiplied by ``color``
    direction: Tensor  # (3,N) unit, towards the light (its centre, if it has an area)
    color: Tensor  # (3,)


def shade(
    scene: Scene,
    samples: GBuffer | RaySurface,
    visibility: Tensor | None = None,
    *,
    background: ArrayLike | None = None,
    area_light: str = "polygon",
) -> Tensor:
    """Linear radiance (B,H,W,3) of a scene's G-buffer under its own lights, or of what rays hit (as an image).

    Args:
        samples: what cameras see; or :attr:`RaySurface.image`, whose light goes back along its rays.
        visibility: shadow factors (B,L,H,W) in [0,1], one image per scene light; None: every light reaches everything.
        background: colour (3,) of empty pixels; None: the environment in that direction, or where there is none the
            scene's ambient light, which is the radiance of a surrounding of one colour. Rays that hit nothing give 0.
        area_light: irradiance of rectangles: "polygon", the exact one, or "centre", as if all came from their centre,
            which is quicker and too bright close by.

    The diffuse part is Lambert's. The specular part is a Phong lobe about the mirrored eye direction with the factor
    (n + 2) / (2 pi): so normalised, a surface that faces the eye mirrors exactly its specular degree whatever the
    exponent n, and never more at other angles (Lafortune and Willems, *Using the modified Phong reflectance model for
    physically based rendering*, 1994). Point and spot lights fall off with the squared distance; area lights use the
    exact irradiance of the rectangle, and their highlight is centred on the rectangle's centre. A light behind the
    geometric surface gives nothing; cosines use the shading normal. Differentiable in colours and intensities.

    Raises:
        InputError: ``visibility`` or ``background`` of a wrong shape, or samples that are no image.
        OptionError: another ``area_light``.
    """
    check_choice("area_light", area_light, AREA_LIGHTS)
    check_tensor("samples.material", samples.material, ("B", "H", "W"))
    count, height, width = samples.material.shape
    if visibility is not None:
        check_tensor("visibility", visibility, (count, len(scene.lights), height, width))
        visibility = visibility.permute(1, 0, 2, 3).reshape(len(scene.lights), count * height * width)
    covered = samples.covered.reshape(-1)
    cameras = samples.cameras if isinstance(samples, GBuffer) else None
    if cameras is None:
        image = torch.zeros(len(covered), 3)
    else:
        image = _background(scene, cameras, ~covered, background)
    rows = covered.nonzero().reshape(-1)
    if len(rows):
        tables = _Tables.of(scene, cameras)
        parts = [
            _shade_pixels(scene, _surface(tables, samples, chunk), visibility, chunk, area_light)
            for chunk in rows.split(CHUNK)
        ]
        image = image.index_copy(0, rows, torch.cat(parts, dim=1).T)
    return image.reshape(count, height, width, 3)


# ------------------------------------------------------------------- pixels


def _shade_pixels(scene: Scene, surface: _Surface, visibility: Tensor | None, rows: Tensor, area_light: str) -> Tensor:
    """Radiance (3,N) of the covered pixels in the given flat rows."""
    diffuse = _ambient(scene, surface.normal)
    specular = torch.zeros(3, len(rows))
    reach = NEAREST_LIGHT * scene.diagonal
    for number, light in enumerate(scene.lights):
        arrival = _arrival(light, surface, reach, area_light)
        amount = arrival.irradiance if visibility is None else arrival.irradiance * visibility[number, rows]
        color = arrival.color[:, None]
        diffuse = diffuse + color * (amount / math.pi)
        if surface.mirror is not None:
            specular = specular + color * (amount * _phong_lobe(surface, arrival.direction))
    return surface.albedo * diffuse + surface.specular * specular + surface.emission


def _surface(tables: _Tables, gbuffer: GBuffer | RaySurface, rows: Tensor) -> _Surface:
    def planes(image: Tensor) -> Tensor:
        return image.reshape(-1, 3).index_select(0, rows).T.contiguous()

    materials = gbuffer.material.reshape(-1).index_select(0, rows)
    position = (planes(gbuffer.position) - tables.origin[:, None]).float()
    normal, specular = planes(gbuffer.normal), tables.specular[:, materials]
    mirror = None
    if bool((specular > 0).any()):
        if isinstance(gbuffer, RaySurface):
            to_eye = planes(gbuffer.to_eye)
        else:
            to_eye = _to_eye(gbuffer.cameras, position, tables.origin, rows)
        mirror = 2.0 * (normal * to_eye).sum(0) * normal - to_eye
    return _Surface(
        origin=tables.origin,
        position=position,
        normal=normal,
        geometric_normal=planes(gbuffer.geometric_normal),
        mirror=mirror,
        albedo=_albedo(tables, gbuffer, rows).T,
        specular=specular,
        shininess=tables.shininess[materials],
        emission=tables.emission[:, materials],
    )


def _to_eye(cameras: Cameras, position: Tensor, origin: Tensor, rows: Tensor) -> Tensor:
    """Unit directions (3,N) from the surface to the camera that sees it."""
    camera = rows // (cameras.width * cameras.height)
    if cameras.orthographic:
        return -cameras.forward.float()[camera].T
    return torch.nn.functional.normalize((cameras.eye - origin).float()[camera].T - position, dim=0, eps=1e-30)


def _albedo(tables: _Tables, gbuffer: GBuffer | RaySurface, rows: Tensor) -> Tensor:
    """Diffuse reflectance (N,3): one texture look-up per material over the pixels that use it."""
    materials = gbuffer.material.reshape(-1).index_select(0, rows)
    albedo = tables.diffuse.index_select(0, materials) * gbuffer.color.reshape(-1, 3).index_select(0, rows)
    present = torch.bincount(materials, minlength=len(tables.textures)).nonzero().reshape(-1).tolist()
    for number in present:
        texture = tables.textures[number]
        if texture is None:
            continue
        chosen = (materials == number).nonzero().reshape(-1)
        pixels = rows[chosen]
        uv = gbuffer.uv.reshape(-1, 2).index_select(0, pixels)
        value = sample_texture(color_pyramid(texture), uv, gbuffer.uv_footprint.reshape(-1)[pixels])
        albedo = albedo.index_copy(0, chosen, albedo.index_select(0, chosen) * value)
    return albedo


def _ambient(scene: Scene, normal: Tensor) -> Tensor:
    """Light (3,N) that shadows do not darken, as radiance of a white surface."""
    ambient = scene.ambient.float()[:, None].expand(3, normal.shape[1])
    if scene.environment is None:
        return ambient
    return ambient + _irradiance(scene.environment, normal.T).T / math.pi


def _irradiance(environment: Environment, normals: Tensor) -> Tensor:
    """Irradiance (N,3) by second-order spherical harmonics (Ramamoorthi and Hanrahan 2001)."""
    if environment not in _HARMONICS:
        _HARMONICS[environment] = environment_bands(environment, 64)
    band = torch.tensor([math.pi] + [2 * math.pi / 3] * 3 + [math.pi / 4] * 5, dtype=normals.dtype)
    return ((harmonics_2(normals) * band) @ _HARMONICS[environment].to(normals.dtype)).clamp_min(0.0)


def _phong_lobe(surface: _Surface, direction: Tensor) -> Tensor:
    """Phong lobe (N,) in the direction of the light, per steradian."""
    assert surface.mirror is not None
    cosine = (surface.mirror * direction).sum(0).clamp(0.0, 1.0)
    exponent = surface.shininess
    return (exponent + 2.0) / (2.0 * math.pi) * cosine.pow(exponent)


# ------------------------------------------------------------------- lights


def _arrival(light: Light, surface: _Surface, reach: float, area_light: str) -> _Arrival:
    if isinstance(light, RectLight):
        return _from_rectangle(light, surface, reach if area_light == "centre" else None)
    if isinstance(light, DirectionalLight):
        direction = -light.direction[:, None].expand_as(surface.position)
        return _Arrival(_cosine(surface, direction), direction, light.irradiance)
    direction, falloff = _towards(light, surface, reach)
    amount = _cosine(surface, direction) * falloff
    if isinstance(light, SpotLight):
        amount = amount * light.cone(-(direction * light.direction[:, None]).sum(0))
    return _Arrival(amount, direction, light.intensity)


def _towards(light: PointLight | SpotLight, surface: _Surface, reach: float) -> tuple[Tensor, Tensor]:
    """Unit direction to the light (3,N) and inverse squared distance (N,), no closer than ``reach``."""
    offset = (light.position - surface.origin).float()[:, None] - surface.position
    square = offset.square().sum(0)
    direction = offset / square.sqrt().clamp_min(1e-18)
    return direction, 1.0 / square.clamp_min(max(reach * reach, 1e-12))


def _cosine(surface: _Surface, direction: Tensor) -> Tensor:
    """Cosine (N,) at the shading normal; 0 where the light lies behind the geometric surface."""
    above = (surface.geometric_normal * direction).sum(0) > 0
    cosine = (surface.normal * direction).sum(0).clamp_min(0.0)
    return torch.where(above, cosine, 0.0)


def _from_rectangle(light: RectLight, surface: _Surface, reach: float | None) -> _Arrival:
    """The exact irradiance; with ``reach`` that of a small light at the centre, no closer than that."""
    corner, u, v = (light.corner - surface.origin).float(), light.edge_u, light.edge_v
    corners = torch.stack([corner, corner + u, corner + u + v, corner + v])
    # Plane tests as differences of two numbers per point: cheaper than vectors to each corner.
    along = light.normal @ surface.position - light.normal @ corner
    height = (corners @ surface.geometric_normal) - (surface.position * surface.geometric_normal).sum(0)
    sees = (along > 0) & (height > 0).any(0)
    offset = (corner + (u + v) / 2)[:, None] - surface.position
    square = offset.square().sum(0)
    direction = offset / square.sqrt().clamp_min(1e-18)
    if reach is not None:
        emitted = -(light.normal[:, None] * direction).sum(0).clamp_max(0.0) * light.area
        falloff = emitted / square.clamp_min(max(reach * reach, light.area / math.pi, 1e-12))
        return _Arrival(torch.where(along > 0, _cosine(surface, direction) * falloff, 0.0), direction, light.radiance)
    amount = torch.zeros_like(along)
    chosen = sees.nonzero().reshape(-1)
    if len(chosen):
        amount[chosen] = polygon_irradiance(corners, surface.position[:, chosen], surface.normal[:, chosen])
    return _Arrival(amount, direction, light.radiance)


# --------------------------------------------------------------- background


def _background(scene: Scene, cameras: Cameras, empty: Tensor, color: ArrayLike | None) -> Tensor:
    """An image (B*H*W,3) that holds the background wherever ``empty`` (B*H*W,)."""
    size = cameras.width * cameras.height
    if color is not None or scene.environment is None:
        value = scene.ambient.float() if color is None else as_vector("background", color)
        return value.expand(len(cameras) * size, 3)
    image = torch.zeros(len(cameras) * size, 3)
    for number in range(len(cameras)):
        rows = empty[number * size : (number + 1) * size].nonzero().reshape(-1)
        pixels = torch.stack([rows % cameras.width, rows // cameras.width], dim=-1) + 0.5
        for chunk, part in zip(rows.split(CHUNK), pixels.split(CHUNK)):
            _, direction = cameras[number].rays(part[None])
            unit = torch.nn.functional.normalize(direction[0], dim=-1).float()
            image[number * size + chunk] = scene.environment.lookup(unit)
    return image
