"""What the study shades: built-in scenes, and one of them with all maps of metallic-roughness."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from torchrender.buffers import GBuffer, VisibilityBuffer
from torchrender.raster import rasterize_visibility, surface_attributes
from torchrender.scene.load import load
from torchrender.scene.material import Material
from torchrender.scene.model import Scene


@dataclass(frozen=True, eq=False)
class Subject:
    """A scene, what its first camera sees, and shadow factors as a picture has them: mostly lit, some penumbra."""

    name: str
    scene: Scene
    seen: VisibilityBuffer
    visibility: Tensor  # (1,L,H,W)

    @property
    def gbuffer(self) -> GBuffer:
        """New, so that nothing of it has been made yet."""
        return surface_attributes(self.scene, self.seen)


def subject(scene: Scene, name: str, side: int) -> Subject:
    """The scene as a picture of it is lit."""
    lit = scene.with_default_light()
    camera = lit.camera(width=side, height=side)
    generator = torch.Generator().manual_seed(0)
    coarse = torch.rand(1, len(lit.lights), 16, 16, generator=generator)
    smooth = torch.nn.functional.interpolate(coarse, size=(side, side), mode="bilinear") if len(lit.lights) else coarse
    factors = (
        (smooth * 3.0 - 0.5).clamp(0.0, 1.0).reshape(1, len(lit.lights), *([side, side] if len(lit.lights) else []))
    )
    return Subject(
        name, lit, rasterize_visibility(lit.geometry, camera), factors.reshape(1, len(lit.lights), side, side)
    )


def built_in(name: str, side: int) -> Subject:
    """One of the procedural scenes."""
    return subject(load(name), name, side)


def with_all_maps(name: str, side: int) -> tuple[Subject, Subject]:
    """A scene whose textured materials are Phong ones without highlight, and the same with four kinds of maps more."""
    scene = load(name)
    plain = tuple(Material(diffuse=m.diffuse, diffuse_texture=m.diffuse_texture) for m in scene.materials)
    mapped = tuple(_mapped(m, number) for number, m in enumerate(plain))
    made = []
    for materials in (plain, mapped):
        made.append(subject(replace(scene, materials=materials), name, side))
    return made[0], made[1]


def _mapped(material: Material, seed: int) -> Material:
    texture = material.diffuse_texture
    if texture is None:
        return Material(metallic=0.4, roughness=0.6, diffuse=material.diffuse)
    height, width, _ = texture.shape
    generator = torch.Generator().manual_seed(seed)

    def noise(channels: int) -> Tensor:
        coarse = torch.rand(1, channels, 16, 16, generator=generator)
        return (
            torch.nn.functional.interpolate(coarse, size=(height, width), mode="bilinear")[0]
            .permute(1, 2, 0)
            .contiguous()
        )

    tilt = 0.4 * (noise(2) - 0.5)
    bump = torch.cat([tilt, (1 - tilt.square().sum(-1, keepdim=True)).sqrt()], dim=-1) * 0.5 + 0.5
    orm = noise(3)
    return Material(
        metallic=0.8,
        roughness=0.9,
        diffuse=material.diffuse,
        diffuse_texture=texture[..., :3].contiguous(),
        metallic_roughness_texture=orm,
        occlusion_texture=orm[..., :1].contiguous(),
        normal_texture=bump,
        emission=torch.full((3,), 0.02),
        emission_texture=noise(3),
    )


def machine_limits() -> dict[str, float]:
    """Bytes copied and numbers gathered per second, on this machine now."""
    source = np.ones(1 << 25, np.float32)
    target = np.empty_like(source)
    begin = time.perf_counter()
    for _ in range(4):
        np.copyto(target, source)
    copied = 8.0 * source.nbytes / (time.perf_counter() - begin)
    places = torch.randint(0, 1 << 20, (1 << 22,), generator=torch.Generator().manual_seed(0))
    values = torch.rand(1 << 20)
    begin = time.perf_counter()
    for _ in range(4):
        values.index_select(0, places)
    return {"bytes_per_s": copied, "gathers_per_s": 4.0 * len(places) / (time.perf_counter() - begin)}
