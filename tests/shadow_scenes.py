"""Small scenes, analytic planes and shadow-edge distances that several shadow tests share."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.buffers import ShadowMap
from torchrender.scene.camera import Cameras
from torchrender.scene.mesh import Mesh


def quad(corner, edge_u, edge_v, name: str = "quad") -> Mesh:
    """A parallelogram whose right-hand normal is ``edge_u x edge_v``."""
    c, u, v = (torch.tensor(x, dtype=torch.float64) for x in (corner, edge_u, edge_v))
    return Mesh(
        vertices=torch.stack([c, c + u, c + u + v, c + v]), faces=torch.tensor([[0, 1, 2], [0, 2, 3]]), name=name
    )


def floor(half: float = 4.0, y: float = 0.0) -> Mesh:
    return quad((-half, y, half), (2 * half, 0, 0), (0, 0, -2 * half), "floor")


def box(low, high, name: str = "box") -> Mesh:
    """A closed axis-aligned box, faces counter-clockwise from outside."""
    low, high = torch.tensor(low, dtype=torch.float64), torch.tensor(high, dtype=torch.float64)
    choice = torch.cartesian_prod(*[torch.tensor([0.0, 1.0], dtype=torch.float64)] * 3)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))]
    return Mesh(vertices=low + choice * (high - low), faces=torch.tensor(faces), name=name)


def plane_map(cameras: Cameras, point: Tensor, normal: Tensor) -> ShadowMap:
    """The exact depth of the infinite plane through ``point`` at every texel centre; +inf where it is not seen."""
    origins, directions = cameras.rays()
    slant = directions @ normal.double()
    t = ((point.double() - origins) @ normal.double()) / torch.where(slant.abs() > 1e-15, slant, torch.nan)
    seen = (t > 0) if not cameras.orthographic else torch.isfinite(t)
    return ShadowMap(cameras=cameras, depth=torch.where(seen, t, torch.inf).float())


def on_plane(points: Tensor, normal: Tensor) -> tuple[Tensor, Tensor]:
    """Points (N,3) of one plane as the (1,1,N,3) images that shadow functions take."""
    return points[None, None], normal.float().expand(points.shape)[None, None]


def flat_image(width: int = 200, height: int = 160) -> Cameras:
    """A camera that looks straight down on the floor around the origin."""
    return Cameras.look_at((0.0, 12.0, 0.0), (0.0, 0.0, 0.0), width=width, height=height, fov_deg=30.0)


def edge_distance(lit: Tensor) -> Tensor:
    """(B,H,W) distance in pixels of each pixel to the nearest pixel of the other kind."""
    from scipy.ndimage import distance_transform_edt

    out = torch.zeros(lit.shape)
    for image, result in zip(lit.numpy(), out.numpy()):
        result[:] = distance_transform_edt(image) + distance_transform_edt(~image)
    return out
