"""Small scenes and hand-built depth images for tests of reconstruction and reprojection."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.raster import rasterize
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene


def front_camera(
    size: int = 32, *, eye: tuple[float, float, float] = (0.0, 0.0, 0.0), fov_deg: float = 60.0
) -> Cameras:
    """Looks along -z of the world."""
    target = (eye[0], eye[1], eye[2] - 1.0)
    return Cameras.look_at(eye, target, width=size, height=size, fov_deg=fov_deg, near=0.01)


def offset_camera(cameras: Cameras) -> Cameras:
    return cameras.sub_camera(-0.5, -0.5, cameras.width + 1, cameras.height + 1)


def depth_images(scene: Scene, cameras: Cameras) -> DepthImages:
    """Conventional depth images with interpolated vertex colours."""
    g = rasterize(scene, cameras, cull="back")
    return DepthImages(
        cameras=cameras,
        depth=g.depth,
        triangle=g.triangle,
        object_id=g.object_id,
        barycentric=g.barycentric,
        position=g.position,
        normal=g.geometric_normal,
        color=g.color,
        layer=torch.zeros(g.depth.shape, dtype=torch.int32),
        truncated=torch.zeros(g.depth.shape, dtype=torch.bool),
        parameters={},
    )


def both(scene: Scene, cameras: Cameras) -> tuple[DepthImages, DepthImages]:
    return depth_images(scene, cameras), depth_images(scene, offset_camera(cameras))


def wall(z: float, *, left: float = -1e3, right: float = 1e3, tilt_deg: float = 0.0) -> Mesh:
    """A large rectangle that faces +z, tilted about the y axis through (0, 0, z)."""
    angle = torch.deg2rad(torch.tensor(tilt_deg, dtype=torch.float64))
    x = torch.tensor([left, left, right, right], dtype=torch.float64)
    y = torch.tensor([-1e3, 1e3, 1e3, -1e3], dtype=torch.float64)
    vertices = torch.stack([x * angle.cos(), y, z + x * angle.sin()], dim=1)
    return Mesh(vertices=vertices, faces=torch.tensor([[0, 2, 1], [0, 3, 2]]), colors=wave(vertices))


def wave(points: Tensor) -> Tensor:
    """A smooth colour (N,3) of the position."""
    return (0.5 + 0.4 * torch.sin(points * torch.tensor([0.7, 0.9, 1.1], dtype=torch.float64))).float()


def empty_image(images: DepthImages, index: int) -> DepthImages:
    """The set with one image emptied, in place."""
    images.depth[index] = torch.inf
    for name in ("triangle", "object_id"):
        getattr(images, name)[index] = -1
    for name in ("normal", "color"):
        getattr(images, name)[index] = 0.0
    return images


def keep_pixels(images: DepthImages, mask: Tensor) -> DepthImages:
    """The set with the pixels outside ``mask`` (B,H,W) emptied, in place."""
    images.depth[~mask] = torch.inf
    images.triangle[~mask] = -1
    images.object_id[~mask] = -1
    images.normal[~mask] = 0.0
    images.color[~mask] = 0.0
    return images


def psnr(a: Tensor, b: Tensor, mask: Tensor) -> float:
    error = float((a - b)[mask].double().square().mean())
    return -10.0 * float(torch.log10(torch.tensor(max(error, 1e-30))))
