"""Puts parts, materials, lights and cameras together to a :class:`~torchrender.scene.model.Scene`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import Light
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.shapes import Array, Part
from torchrender.scene.procedural.parts.textures import noise

Color = Sequence[float]
CAMERA_SIZE = (1024, 768)


def as_tensor(values: Array | Sequence[float]) -> Tensor:
    """float32 copy."""
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))


class Assembly:
    """Collects the objects of one scene. Materials are known by name, objects are numbered in order of arrival."""

    def __init__(self, materials: dict[str, Material] | None = None) -> None:
        self.materials: dict[str, Material] = dict(materials or {})
        self.meshes: list[Mesh] = []
        self.count = 0
        self.objects = 0

    def material(self, name: str, color: Color, *, texture: Array | None = None, **options: float | Tensor) -> str:
        """Define a material; ``options`` go to :class:`Material`. With a texture, ``color`` multiplies it."""
        self.materials[name] = Material(
            name=name,
            diffuse=as_tensor(color),
            diffuse_texture=None if texture is None else as_tensor(texture),
            **options,  # type: ignore[arg-type]
        )
        return name

    def mirror(
        self, name: str, color: Color, specular: float, tint: Color = (1.0, 1.0, 1.0), shininess: float = 400.0
    ) -> str:
        """Define a material that reflects: polished metal, glass, glazed ceramic."""
        return self.material(name, color, specular=specular, specular_color=as_tensor(tint), shininess=shininess)

    def add(self, name: str, pieces: dict[str, Part] | tuple[str, Part]) -> None:
        """Add one object: parts by material name. Several materials make several meshes with one object id."""
        for material, part in pieces.items() if isinstance(pieces, dict) else (pieces,):
            if not part.count:
                continue
            self.meshes.append(
                Mesh(
                    name=name if not isinstance(pieces, dict) or len(pieces) == 1 else f"{name}/{material}",
                    vertices=as_tensor(part.vertices),
                    faces=torch.from_numpy(np.ascontiguousarray(part.faces, dtype=np.int64)),
                    normals=None if part.normals is None else as_tensor(part.normals),
                    uv=None if part.uv is None or not self.textured(material) else as_tensor(part.uv),
                    colors=None if part.colors is None else as_tensor(part.colors),
                    material=list(self.materials).index(material),
                    object_id=self.objects,
                )
            )
            self.count += part.count
        self.objects += 1

    def textured(self, material: str) -> bool:
        """Whether the material has a texture, and its meshes therefore need coordinates."""
        return self.materials[material].diffuse_texture is not None

    def scene(
        self,
        name: str,
        *,
        lights: Sequence[Light],
        cameras: dict[str, Cameras],
        ambient: Color,
        environment: Environment | None = None,
    ) -> Scene:
        """The finished scene."""
        return Scene(
            name=name,
            meshes=tuple(self.meshes),
            materials=tuple(self.materials.values()),
            lights=tuple(lights),
            cameras=cameras,
            ambient=as_tensor(ambient),
            environment=environment,
        )


def fitted(make: Callable[[float], Assembly], wanted: int, *, usual: int) -> tuple[Assembly, int]:
    """The assembly that ``make(detail)`` builds, and how many triangles are left for filling up to ``wanted``.

    Detail 1 belongs to ``usual`` triangles, and the count grows about with its square. The search ends when between
    3 % and 30 % of the wish are left over.
    """
    detail = math.sqrt(wanted / usual)
    best: tuple[Assembly, int] | None = None
    for _ in range(12):
        made = make(detail)
        left = wanted - made.count
        if best is None or (left >= 0 and not 0 <= best[1] <= left):
            best = made, left
        if 0.03 * wanted <= left <= 0.3 * wanted:
            return made, left
        detail *= math.sqrt(min(max(0.86 * wanted / made.count, 0.3), 3.0))
    assert best is not None
    return best


def view(eye: Sequence[float], target: Sequence[float], fov_deg: float, near: float, far: float) -> Cameras:
    """One camera at the stored size."""
    width, height = CAMERA_SIZE
    return Cameras.look_at(eye, target, width=width, height=height, fov_deg=fov_deg, near=near, far=far)


def sky(
    rng: np.random.Generator,
    sun: Sequence[float],
    *,
    zenith: Color = (0.16, 0.32, 0.72),
    horizon: Color = (0.72, 0.82, 0.92),
    ground: Color = (0.16, 0.15, 0.11),
    clouds: float = 0.6,
    height: int = 128,
) -> Environment:
    """A day sky: gradient, soft clouds and a glow about the direction (3,) *to* the sun.

    The sun's disc itself is left to a directional light, so it is not counted twice.
    """
    polar = (np.arange(height)[:, None] + 0.5) * np.pi / height
    azimuth = ((np.arange(2 * height)[None] + 0.5) / (2 * height) - 0.5) * 2 * np.pi
    d = np.stack(
        np.broadcast_arrays(np.sin(polar) * np.sin(azimuth), np.cos(polar), -np.sin(polar) * np.cos(azimuth)), -1
    )
    up = d[..., 1:2]
    color = np.asarray(horizon) + (np.asarray(zenith) - np.asarray(horizon)) * np.clip(up, 0, 1) ** 0.55
    field = noise(rng, 2 * height, slope=1.9)[:height] * 1.3 + 0.35 * noise(rng, 2 * height, slope=1.1)[:height]
    cover = clouds * np.clip(0.5 * field, 0, 1)[..., None] * np.clip(up * 6, 0, 1) * np.clip(1.6 - 1.6 * up, 0, 1)
    color = color * (1 - cover) + np.array([0.95, 0.95, 0.96]) * cover
    cosine = np.clip(d @ (np.asarray(sun) / np.linalg.norm(sun)), 0, 1)[..., None]
    color = color + np.array([1.0, 0.86, 0.62]) * (0.25 * cosine**12 + 1.6 * cosine**300)
    haze = 0.93 * np.asarray(horizon)
    below = haze + (np.asarray(ground) - haze) * (1 - np.exp(7.0 * np.clip(up, -1, 0)))
    return Environment(radiance=as_tensor(np.where(up > 0, color, below)), name="sky")
