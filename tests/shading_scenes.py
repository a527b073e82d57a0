"""Scenes that use everything a material can have, for the tests of shading."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import torch
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.texels.coded import CodedTexture
from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment, latlong_directions
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.material import TEXTURES, Material, Sampler
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import sphere

SUN = DirectionalLight(direction=torch.tensor([0.3, -1.0, 0.2]), irradiance=torch.tensor([2.0, 1.5, 1.0]))
LAMP = PointLight(position=torch.tensor([0.5, 2.0, 1.3]), intensity=torch.tensor([3.0, 4.0, 5.0]))
SPOT = SpotLight(position=torch.tensor([-0.5, 3.0, 1.0]), direction=torch.tensor([0.1, -1.0, -0.3]), outer_deg=25.0)
PANEL = RectLight(
    corner=torch.tensor([-0.5, 2.0, 0.5]), edge_u=torch.tensor([1.0, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.3, 1.0])
)
LIGHTS: tuple[Light, ...] = (SUN, LAMP, SPOT, PANEL)


def noise(height: int, width: int, channels: int, seed: int) -> Tensor:
    """A smooth random texture (H,W,C) in [0,1]."""
    coarse = torch.rand(1, channels, 8, 8, generator=torch.Generator().manual_seed(seed))
    image = torch.nn.functional.interpolate(coarse, size=(height, width), mode="bilinear")
    return image[0].permute(1, 2, 0).contiguous()


def bumps(height: int, width: int, seed: int) -> Tensor:
    """A normal map (H,W,3)."""
    tilt = 0.6 * (noise(height, width, 2, seed) - 0.5)
    z = (1 - tilt.square().sum(-1, keepdim=True)).sqrt()
    return torch.cat([tilt, z], dim=-1) * 0.5 + 0.5


TURNED = torch.tensor([[1.5, 0.4, 0.1], [-0.3, 2.0, -0.2]])


def materials() -> tuple[Material, ...]:
    """One of each kind."""
    orm, color = noise(32, 32, 3, 1), noise(32, 32, 4, 2)
    return (
        Material(name="matte", diffuse=torch.tensor([0.5, 0.4, 0.3]), diffuse_texture=noise(16, 24, 3, 3)),
        Material(
            name="glossy",
            specular=0.6,
            shininess=20.0,
            specular_texture=noise(8, 8, 4, 4),
            normal_texture=bumps(16, 16, 5),
            occlusion_texture=noise(16, 16, 1, 6),
            occlusion_strength=0.7,
            emission=torch.tensor([0.0, 0.2, 0.1]),
            emission_texture=noise(16, 16, 3, 7),
        ),
        Material(
            name="all maps",
            metallic=0.7,
            roughness=0.8,
            diffuse_texture=color,
            metallic_roughness_texture=orm,
            occlusion_texture=orm,
            normal_texture=bumps(32, 32, 8),
            normal_scale=0.8,
            emission=torch.full((3,), 0.1),
            emission_texture=noise(32, 32, 3, 9),
        ),
        Material(
            name="coat and sheen",
            metallic=0.1,
            roughness=0.5,
            ior=1.8,
            specular_weight=0.7,
            specular_color=torch.tensor([1.0, 0.7, 0.4]),
            clearcoat=0.8,
            clearcoat_roughness=0.1,
            clearcoat_texture=noise(16, 16, 3, 10),
            sheen_color=torch.tensor([0.3, 0.2, 0.5]),
            sheen_roughness=0.4,
            transmission=0.7,
            transmission_texture=noise(16, 16, 1, 15),
            normal_texture=bumps(16, 16, 11),
            samplers={"clearcoat_texture": Sampler(uv_set=1, wrap_u="mirror", wrap_v="clamp")},
        ),
        Material(
            name="placed",
            metallic=0.0,
            roughness=0.3,
            diffuse_texture=color,
            emission=torch.ones(3),
            emission_texture=noise(16, 16, 3, 12),
            samplers={
                "diffuse_texture": Sampler(transform=TURNED, wrap_u="clamp", wrap_v="mirror"),
                "emission_texture": Sampler(filter="nearest", wrap_u="mirror"),
            },
        ),
        Material(name="unlit", unlit=True, diffuse_texture=noise(8, 8, 3, 13)),
        Material(
            name="smooth metal",
            metallic=1.0,
            roughness=0.0,
            diffuse=torch.tensor([0.9, 0.6, 0.2]),
            diffuse_texture=noise(16, 16, 3, 14),
            samplers={"diffuse_texture": Sampler(filter="bilinear")},
        ),
    )


def as_codes(scene: Scene) -> Scene:
    """The same with textures rounded to 8 bits and kept so, colours as sRGB."""
    made: dict[int, CodedTexture] = {}
    materials = []
    for material in scene.materials:
        changed: dict[str, Any] = {}
        for name in TEXTURES:
            texture = getattr(material, name)
            if texture is None:
                continue
            colors = 3 if name in COLORS else 0
            if id(texture) not in made:
                shown = torch.cat([srgb_from_linear(texture[..., :colors]), texture[..., colors:]], dim=-1)
                made[id(texture)] = CodedTexture((shown.clamp(0, 1) * 255 + 0.5).byte().numpy(), colors)
            changed[name] = made[id(texture)]
        materials.append(replace(material, **changed))
    return scene.replace(materials=tuple(materials))


COLORS = ("diffuse_texture", "emission_texture", "specular_texture")


def ball(number: int, material: int) -> Mesh:
    """A sphere on a grid, with both sets of texture coordinates, colours, and every second one with smooth normals."""
    made = sphere(radius=0.45, segments=16)
    place = torch.tensor([1.1 * (number % 4) - 1.6, 0.0, 1.1 * (number // 4) - 0.6])
    direction = torch.nn.functional.normalize(made.vertices, dim=-1)
    uv = torch.stack([torch.atan2(direction[:, 0], direction[:, 2]) / 3, direction[:, 1]], dim=-1) * 1.3
    return Mesh(
        vertices=made.vertices + place,
        faces=made.faces,
        normals=direction if number % 2 == 0 else None,
        uv=uv,
        uv1=uv.flip(1) * 0.7 + 0.1,
        colors=direction.abs() * 0.5 + 0.5,
        material=material,
    )


def sky() -> Environment:
    """A bright side, a dark one, a coloured floor."""
    d = latlong_directions(32, 64)
    color = torch.tensor([0.5, 0.7, 1.0]) * (1.2 + d[..., 1:2]) + torch.tensor([2.0, 1.0, 0.3]) * d[..., :1].clamp_min(
        0
    )
    return Environment(radiance=color, intensity=0.7, rotation_deg=30.0)


def scene_of_all(*lights: Light, environment: bool = True) -> Scene:
    """A ball of each material."""
    made = materials()
    return Scene(
        meshes=tuple(ball(number, number) for number in range(len(made))),
        materials=made,
        lights=lights,
        environment=sky() if environment else None,
        ambient=torch.tensor([0.05, 0.1, 0.15]),
    )


def views(width: int = 72, height: int = 48, count: int = 1, orthographic: bool = False) -> Cameras:
    """From above the front."""
    eyes = [[0.2 * k, 3.0, 3.5] for k in range(count)]
    targets = [[0.0, 0.0, 0.0]] * count
    made = Cameras.look_at(eyes, targets, width=width, height=height)
    if not orthographic:
        return made
    k = made.intrinsics.clone()
    k[:, 0, 0] = k[:, 1, 1] = height / 4.0
    return replace(made, intrinsics=k, orthographic=True, far=torch.full((count,), 100.0, dtype=torch.float64))
