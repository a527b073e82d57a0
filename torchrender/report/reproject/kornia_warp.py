"""What kornia offers for pictures from another viewpoint, as rows beside the reprojection: a homography and a flow.

Neither knows what hides what. The homography takes the scene for one plane; the flow needs the depth of the new
picture, which a reprojection has to find.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import DepthImages
from torchrender.scene.camera import Cameras


def homography_warp(images: DepthImages, camera: Cameras) -> Tensor:
    """Colour (H,W,3) of the image nearest to one camera, as if all lay in one plane at its median depth."""
    from kornia.geometry.transform import warp_perspective

    k = nearest_image(images, camera)
    own, depth = images.cameras[k], images.depth[k]
    distance = float(depth[torch.isfinite(depth)].median())
    matrix = camera.camera_from_world[0] @ own.world_from_camera[0]
    plane = matrix[:3, :3].clone()
    plane[:, 2] += matrix[:3, 3] / distance
    pixels = camera.intrinsics[0] @ plane @ torch.linalg.inv(own.intrinsics[0])
    centre = torch.eye(3, dtype=torch.float64)
    centre[:2, 2] = 0.5  # kornia counts from the centre of the first pixel
    moved = (torch.linalg.inv(centre) @ pixels @ centre).float()
    color = images.color[k].permute(2, 0, 1)[None]
    return warp_perspective(color, moved[None], (camera.height, camera.width))[0].permute(1, 2, 0)


def flow_warp(images: DepthImages, camera: Cameras, depth: Tensor) -> Tensor:
    """Colour (H,W,3) of the image nearest to one camera, fetched along the flow of the camera's own ``depth`` (H,W)."""
    from kornia.geometry.transform import remap

    k = nearest_image(images, camera)
    own = images.cameras[k]
    known = torch.where(torch.isfinite(depth), depth, 1.0)
    points = camera.unproject(camera.pixel_centres()[None], known[None])
    pixels = own.project(points)[0][0].float() - 0.5
    color = images.color[k].permute(2, 0, 1)[None]
    x, y = (pixels[None, ..., axis].contiguous() for axis in (0, 1))
    return remap(color, x, y, align_corners=True)[0].permute(1, 2, 0)


def nearest_image(images: DepthImages, camera: Cameras) -> int:
    """Whose eye is nearest to that of the one camera."""
    return int((images.cameras.eye - camera.eye).norm(dim=1).argmin())
