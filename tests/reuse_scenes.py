"""Mirrors of closed form in front of a shell that they mirror, as key frames; and small scenes with mirrors."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import GBuffer, ReflectionLayer, ReflectionState
from torchrender.effects.reflections.key_frame import ReflectionKeyFrame, make_key_frame
from torchrender.effects.reflections.reuse_options import ReuseOptions
from torchrender.scene.camera import Cameras
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene

SHELL = 8.0
FIELD = 0.8  # half width of the mirror


def eye_camera(eye: list[float], size: int = 64, target: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Cameras:
    return Cameras.look_at(eye, list(target), width=size, height=size, fov_deg=36.0)


def mirror_surface(kind: str, rho: float, camera: Cameras) -> tuple[Tensor, Tensor, Tensor]:
    """Position (H,W,3), normal and mask of a mirror near z = 0 that faces +z; convex or concave of radius rho."""
    origin, direction = (v[0] for v in camera.rays())
    unit = torch.nn.functional.normalize(direction, dim=-1)
    if kind == "plane":
        t = -origin[..., 2] / unit[..., 2]
        position = origin + t[..., None] * unit
        normal = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand_as(position)
    else:
        centre = torch.tensor([0.0, 0.0, -rho if kind == "convex" else rho], dtype=torch.float64)
        offset = origin - centre
        b = (offset * unit).sum(-1)
        root = (b * b - offset.square().sum(-1) + rho * rho).clamp_min(0.0).sqrt()
        t = -b - root if kind == "convex" else -b + root
        position = origin + t[..., None] * unit
        normal = (position - centre) / rho * (1.0 if kind == "convex" else -1.0)
    mask = (position[..., :2].abs() < FIELD).all(-1) & (t > 0)
    return position, normal, mask


def shell_distance(position: Tensor, direction: Tensor) -> Tensor:
    """Ray length to the sphere of radius SHELL about the origin."""
    b = (position * direction).sum(-1)
    return -b + (b * b - position.square().sum(-1) + SHELL**2).sqrt()


def shell_color(point: Tensor) -> Tensor:
    """A smooth colour of points on the shell."""
    return 0.5 + 0.45 * torch.sin(point * torch.tensor([0.9, 1.3, 0.7], dtype=torch.float64)).float()


def views_of(
    kind: str, camera: Cameras, rho: float = 1.0, endless: bool = False, id_of: object = None
) -> tuple[GBuffer, ReflectionLayer]:
    """G-buffer and exact reflections of the closed-form mirror."""
    position, normal, mask = mirror_surface(kind, rho, camera)
    depth = camera.transform(position.reshape(1, -1, 3))[..., 2].reshape(mask.shape)
    view = torch.nn.functional.normalize(position - camera.eye[0], dim=-1)
    direction = view - 2 * (view * normal).sum(-1, keepdim=True) * normal
    distance = shell_distance(position, direction)
    point = position + distance[..., None] * direction
    color = shell_color(SHELL * direction if endless else point)
    ids = torch.zeros(mask.shape, dtype=torch.int64)
    if id_of is not None:
        ids = id_of(position)
    zeros = torch.zeros(1, *mask.shape)
    gbuffer = GBuffer(
        cameras=camera,
        depth=torch.where(mask, depth, torch.inf).float()[None],
        triangle=torch.where(mask, 0, -1)[None],
        object_id=torch.where(mask, ids, -1)[None],
        barycentric=torch.zeros(1, *mask.shape, 2),
        position=torch.where(mask[..., None], position, 0.0)[None],
        normal=torch.where(mask[..., None], normal, 0.0).float()[None],
        geometric_normal=torch.where(mask[..., None], normal, 0.0).float()[None],
        uv=torch.zeros(1, *mask.shape, 2),
        uv_footprint=zeros,
        color=torch.ones(1, *mask.shape, 3),
        material=torch.where(mask, 0, -1)[None],
    )
    length = torch.full_like(distance, torch.inf) if endless else distance
    layer = ReflectionLayer(
        color=torch.where(mask[..., None], color, 0.0)[None].float(),
        distance=torch.where(mask, length, 0.0).float()[None],
        direction=torch.where(mask[..., None], direction, 0.0).float()[None],
        state=torch.where(mask, int(ReflectionState.TRACED), 0).to(torch.uint8)[None],
        cluster=torch.full((1, *mask.shape), -1),
    )
    return gbuffer, layer


def mirror_key(kind: str, eye: list[float], size: int = 64, **options: object) -> ReflectionKeyFrame:
    return make_key_frame(*views_of(kind, eye_camera(eye, size), **options), ReuseOptions(contrast=1.0))


def mirror_scene() -> Scene:
    """A one-material scene for closed-form views: a perfect mirror."""
    return Scene(materials=(Material(name="mirror", specular=1.0, diffuse=torch.zeros(3)),))


def rectangle(corner: list[float], u: list[float], v: list[float], material: int) -> Mesh:
    a, eu, ev = (torch.tensor(x, dtype=torch.float64) for x in (corner, u, v))
    vertices = torch.stack([a, a + eu, a + eu + ev, a + ev])
    uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    return Mesh(vertices=vertices, faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), uv=uv, material=material)
