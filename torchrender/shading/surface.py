"""What the materials are at N points: the numbers of the table times the textures, point by point."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn.functional import normalize

from torchrender.buffers import GBuffer, RaySurface
from torchrender.numerics.texture import Addressing, sample_texture, texture_pyramid
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Sampler
from torchrender.scene.model import Scene

PHONG, METALLIC, UNLIT = range(3)
"""Places in :data:`torchrender.scene.material_table.KINDS`."""

LEAST_TILT = 1e-4
"""Least cosine between a normal that a map has bent and the triangle's own."""


@dataclass(frozen=True, eq=False)
class Surface:
    """N points, component by component, so that sums over components run along memory."""

    position: Tensor  # (3,N) relative to the origin: float32 keeps its precision far from the world's origin, too
    normal: Tensor  # (3,N) unit shading normal, with its map
    smooth: Tensor  # (3,N) the same without
    geometric: Tensor  # (3,N) normal of the triangle
    to_eye: Tensor  # (3,N) unit
    kind: Tensor  # (N,) int64 PHONG, METALLIC or UNLIT
    base: Tensor  # (3,N) diffuse reflectance or base colour
    alpha: Tensor  # (N,)
    emission: Tensor  # (3,N)
    occlusion: Tensor  # (N,) share of ambient light that arrives
    highlight: Tensor  # (3,N) Phong: colour of highlights
    degree: Tensor  # (N,) Phong: share of mirrored light at normal incidence
    shininess: Tensor  # (N,)
    metallic: Tensor  # (N,)
    roughness: Tensor  # (N,)
    dielectric: Tensor  # (3,N) what the part that is no metal mirrors at normal incidence
    weight: Tensor  # (N,) the same at grazing incidence
    reflectance: Tensor  # (N,) at normal incidence, weight and tint left out
    slowed: Tensor  # (N,) squared index of refraction less one
    excess: Tensor  # (2,N) of :class:`torchrender.numerics.ggx.Refraction`
    clearcoat: Tensor  # (N,)
    coat_roughness: Tensor  # (N,)
    sheen: Tensor  # (3,N)
    sheen_roughness: Tensor  # (N,)
    transmission: Tensor  # (N,)

    def select(self, rows: Tensor) -> Surface:
        """Some of the points."""
        return Surface(**{f.name: getattr(self, f.name).index_select(-1, rows) for f in fields(self)})


class Reader:
    """Reads the materials of a scene at some of the samples.

    Args:
        origin: (3,) float64 world space, what positions are counted from.
    """

    def __init__(self, scene: Scene, samples: GBuffer | RaySurface, origin: Tensor) -> None:
        self.scene = scene
        self.samples = samples
        self.origin = origin
        self.table = scene.material_table

    def surface(self, rows: Tensor) -> Surface:
        """The points in the given flat rows of the samples."""
        samples, table, physical = self.samples, self.table, self.table.physical
        material = samples.material.reshape(-1).index_select(0, rows)
        look_up = _Textures(self.scene, samples, rows, material)
        color, tint = look_up("diffuse_texture", 4), look_up("specular_texture", 4)
        rough, coat = look_up("metallic_roughness_texture", 3), look_up("clearcoat_texture", 2)
        position = (_planes(samples.position, rows) - self.origin[:, None]).float()
        smooth, to_eye = _planes(samples.normal, rows), self._to_eye(position, rows)
        geometric = _planes(samples.geometric_normal, rows)
        degree = table.specular[material] * tint[3]
        hue = physical.tint[material].T * tint[:3]
        weight = physical.weight[material] * tint[3]
        occlusion = 1.0 + physical.occlusion_strength[material] * (look_up("occlusion_texture", 1)[0] - 1.0)
        alpha = physical.opacity[material] * color[3]
        if samples.alpha is not None:
            alpha = alpha * samples.alpha.reshape(-1)[rows]
        return Surface(
            position=position,
            normal=self._bent(look_up, smooth, geometric, to_eye),
            smooth=smooth,
            geometric=geometric,
            to_eye=to_eye,
            kind=physical.kind[material],
            base=table.diffuse[material].T * _planes(samples.color, rows) * color[:3],
            alpha=alpha,
            emission=table.emission[material].T * look_up("emission_texture", 3),
            occlusion=occlusion.clamp(0.0, 1.0),
            highlight=degree * table.tint[material].T * tint[:3],
            degree=degree,
            shininess=table.shininess[material],
            metallic=(physical.metallic[material] * rough[2]).clamp(0.0, 1.0),
            roughness=(physical.roughness[material] * rough[1]).clamp(0.0, 1.0),
            dielectric=(physical.dielectric[material] * hue).clamp_max(1.0) * weight,
            weight=weight,
            reflectance=physical.dielectric[material],
            slowed=physical.slowed[material],
            excess=physical.excess[material].T,
            clearcoat=physical.clearcoat[material, 0] * coat[0],
            coat_roughness=(physical.clearcoat[material, 1] * coat[1]).clamp(0.0, 1.0),
            sheen=physical.sheen[material].T,
            sheen_roughness=physical.sheen_roughness[material],
            transmission=physical.transmission[material] * look_up("transmission_texture", 1)[0],
        )

    def albedo(self, rows: Tensor) -> Tensor:
        """Diffuse reflectance or base colour (3,N) alone."""
        material = self.samples.material.reshape(-1).index_select(0, rows)
        color = _Textures(self.scene, self.samples, rows, material)("diffuse_texture", 3)
        return self.table.diffuse[material].T * _planes(self.samples.color, rows) * color

    def _to_eye(self, position: Tensor, rows: Tensor) -> Tensor:
        """Unit directions (3,N) from the surface to the camera that sees it, or back along the ray."""
        if isinstance(self.samples, RaySurface):
            return _planes(self.samples.to_eye, rows)
        cameras: Cameras = self.samples.cameras
        camera = rows // (cameras.width * cameras.height)
        if cameras.orthographic:
            return -cameras.forward.float()[camera].T
        return normalize((cameras.eye - self.origin).float()[camera].T - position, dim=0, eps=1e-30)

    def _bent(self, look_up: _Textures, smooth: Tensor, geometric: Tensor, to_eye: Tensor) -> Tensor:
        """Normals (3,N) as their maps bend them; never below the triangle, nor turned from the eye."""
        tangent = self.samples.tangent
        if tangent is None or not look_up.has("normal_texture"):
            return smooth
        along = tangent.reshape(-1, 4).index_select(0, look_up.rows).T
        has_map = torch.tensor([m.normal_texture is not None for m in self.scene.materials])[look_up.material]
        told = look_up("normal_texture", 3, empty=0.5)
        scale = self.table.physical.normal_scale[look_up.material]
        x, y, z = (2.0 * told[0] - 1.0) * scale, (2.0 * told[1] - 1.0) * scale, 2.0 * told[2] - 1.0
        across = torch.linalg.cross(smooth, along[:3], dim=0) * along[3]
        bent = normalize(x * along[:3] + y * across + z * smooth, dim=0, eps=1e-30)
        usable = (along[:3].square().sum(0) > 0) & (bent.square().sum(0) > 0.5)
        usable = usable & has_map
        return torch.where(usable, raised(raised(bent, geometric), to_eye), smooth)


def raised(normal: Tensor, axis: Tensor) -> Tensor:
    """Unit normals (3,N), those that look away from unit axes (3,N) lifted to just where they do not."""
    cosine = (normal * axis).sum(0)
    lifted = normalize(normal + (LEAST_TILT - cosine).clamp_min(0.0) * axis, dim=0, eps=1e-30)
    return torch.where(cosine < LEAST_TILT, lifted, normal)


class _Textures:
    """Values of textures at points: one look-up per material over the points that use it."""

    def __init__(self, scene: Scene, samples: GBuffer | RaySurface, rows: Tensor, material: Tensor) -> None:
        self.scene, self.samples, self.rows, self.material = scene, samples, rows, material
        count = torch.bincount(material, minlength=len(scene.materials))
        self.present = count.nonzero().reshape(-1).tolist()
        self._chosen: dict[int, Tensor] = {}

    def has(self, name: str) -> bool:
        """Some point's material has that texture."""
        return any(getattr(self.scene.materials[n], name) is not None for n in self.present)

    def __call__(self, name: str, channels: int, empty: float = 1.0) -> Tensor:
        """(channels,N) of the texture of that name, ``empty`` where there is none or it has fewer channels."""
        value = torch.full((len(self.rows), channels), empty)
        for number in self.present:
            material = self.scene.materials[number]
            texture = getattr(material, name)
            if texture is None:
                continue
            if number not in self._chosen:
                self._chosen[number] = (self.material == number).nonzero().reshape(-1)
            chosen = self._chosen[number]
            found = self._sampled(texture, material.sampler(name), self.rows[chosen])[:, :channels]
            if found.shape[1] < channels:
                found = torch.nn.functional.pad(found, (0, channels - found.shape[1]), value=empty)
            value = value.index_copy(0, chosen, found)
        return value.T

    def _sampled(self, texture: Tensor, sampler: Sampler, pixels: Tensor) -> Tensor:
        samples = self.samples
        second = sampler.uv_set == 1
        uv, footprint = (samples.uv1, samples.uv1_footprint) if second else (samples.uv, samples.uv_footprint)
        if uv is None or footprint is None:
            uv, footprint = torch.zeros_like(samples.uv), torch.zeros_like(samples.uv_footprint)
        place, width = uv.reshape(-1, 2).index_select(0, pixels), footprint.reshape(-1)[pixels]
        matrix = sampler.transform
        if not torch.equal(matrix, PLAIN_TRANSFORM):
            place = (place.double() @ matrix[:, :2].double().T + matrix[:, 2].double()).float()
            width = width * float(torch.linalg.det(matrix[:, :2]).abs().sqrt())
        how = Addressing(sampler.wrap_u, sampler.wrap_v, sampler.filter)
        return sample_texture(texture_pyramid(texture), place, width, how)


PLAIN_TRANSFORM = Sampler().transform


def _planes(image: Tensor, rows: Tensor) -> Tensor:
    return image.reshape(-1, 3).index_select(0, rows).T.contiguous()
