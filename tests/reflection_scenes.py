"""Small scenes with reflectors, and the steps to their reflection layers."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, RayHits, ReflectionLayer
from torchrender.effects.reflections.clustered import ClusteredReflections, ClusterOptions, clustered_reflections
from torchrender.effects.reflections.reflectors import ReflectivePixels, reflected_rays, reflective_pixels
from torchrender.effects.reflections.traced import TraceOptions, trace_reflections
from torchrender.pipeline.hit_shader import HitShader
from torchrender.pipeline.options import RenderOptions
from torchrender.raster import rasterize
from torchrender.rays import RayCaster
from torchrender.report.common.hits import hit_shader
from torchrender.scene.camera import Cameras
from torchrender.scene.light import PointLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import box, sphere


def rectangle(corner: list[float], u: list[float], v: list[float], material: int) -> Mesh:
    a, eu, ev = (torch.tensor(x, dtype=torch.float64) for x in (corner, u, v))
    vertices = torch.stack([a, a + eu, a + eu + ev, a + ev])
    uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), uv=uv, material=material)


def checks(size: int = 8) -> Tensor:
    board = (torch.arange(size)[:, None] + torch.arange(size)) % 2
    return (0.1 + 0.8 * board.float())[..., None].expand(size, size, 3).contiguous()


def materials(gloss: float = 0.0) -> tuple[Material, ...]:
    return (
        Material(name="mirror", specular=1.0, gloss=gloss, diffuse=torch.zeros(3)),
        Material(name="card", diffuse=torch.ones(3), diffuse_texture=checks()),
        Material(name="red", diffuse=torch.tensor([0.8, 0.1, 0.1])),
        Material(name="chrome", specular=0.9, diffuse=torch.full((3,), 0.05)),
    )


LIGHT = PointLight(position=torch.tensor([0.5, 2.5, 2.0]), intensity=torch.full((3,), 20.0))


def scene_of(*meshes: Mesh, gloss: float = 0.0) -> Scene:
    return Scene(meshes=meshes, materials=materials(gloss), lights=(LIGHT,), ambient=torch.full((3,), 0.2))


def placed(mesh: Mesh, offset: tuple[float, float, float], material: int) -> Mesh:
    return replace(mesh, vertices=mesh.vertices + torch.tensor(offset), material=material)


def mirror_scene(gloss: float = 0.0) -> Scene:
    """A mirror in the plane z = 0, facing +z, and a textured card at z = 4 that faces it."""
    return scene_of(
        rectangle([-3.0, -3.0, 0.0], [6.0, 0.0, 0.0], [0.0, 6.0, 0.0], 0),
        rectangle([3.0, -2.0, 4.0], [-4.0, 0.0, 0.0], [0.0, 4.0, 0.0], 1),
        gloss=gloss,
    )


def sphere_scene(gloss: float = 0.0, material: int = 0) -> Scene:
    """A mirror sphere in a closed room of checks, with a red box above it."""
    low, high = -3.0, 3.0
    side = high - low
    walls = (
        rectangle([low, low, low], [0, 0, side], [side, 0, 0], 1),
        rectangle([low, high, low], [side, 0, 0], [0, 0, side], 1),
        rectangle([low, low, low], [side, 0, 0], [0, side, 0], 1),
        rectangle([high, low, high], [-side, 0, 0], [0, side, 0], 1),
        rectangle([low, low, high], [0, 0, -side], [0, side, 0], 1),
        rectangle([high, low, low], [0, 0, side], [0, side, 0], 1),
    )
    ball = placed(sphere(0.8, 48), (0.0, 0.0, 0.0), material)
    block = placed(box(torch.tensor([0.8, 0.4, 0.8])), (0.0, 1.8, 0.0), 2)
    return scene_of(ball, block, *walls, gloss=gloss)


def looking(size: int = 96, eye: tuple[float, float, float] = (0.0, 0.6, 2.7)) -> Cameras:
    return Cameras.look_at(list(eye), [0.0, 0.0, 0.0], width=size, height=size, fov_deg=50.0)


def prepared(scene: Scene, cameras: Cameras) -> tuple[GBuffer, ReflectivePixels, HitShader]:
    gbuffer = rasterize(scene, cameras)
    return gbuffer, reflective_pixels(scene, gbuffer), hit_shader(scene, RenderOptions(shadows=False))


def clustered(scene: Scene, cameras: Cameras, **options: object) -> tuple[ReflectivePixels, ClusteredReflections]:
    _, pixels, shader = prepared(scene, cameras)
    made = clustered_reflections(
        scene,
        pixels,
        shader,
        ClusterOptions(**options),  # type: ignore[arg-type]
        caster=lambda: RayCaster(scene.geometry),
    )
    return pixels, made


def traced(scene: Scene, cameras: Cameras, rays: int = 8) -> ReflectionLayer:
    _, pixels, shader = prepared(scene, cameras)
    return trace_reflections(RayCaster(scene.geometry), pixels, shader, TraceOptions(glossy_rays=rays))


def true_hits(scene: Scene, pixels: ReflectivePixels) -> RayHits:
    return reflected_rays(pixels).first_hits(RayCaster(scene.geometry))
