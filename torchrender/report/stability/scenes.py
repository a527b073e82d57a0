"""Scenes that are difficult for numbers: flat, empty, coincident, tiny, huge, touching, inside out.

Coordinates of :func:`studio` are multiples of 1/16: they survive float32 up to a million units from the origin.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.light import Light, PointLight, RectLight
from torchrender.scene.material import Material
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.place import place_cameras, place_light, place_mesh
from torchrender.scene.shapes import box, quad, sphere

MIRROR, CARD, RED, CHROME, LEAF, LAMP = range(6)
STEP = 1.0 / 16.0


def checks(size: int = 8) -> Tensor:
    """A checkered texture (size,size,3)."""
    board = (torch.arange(size)[:, None] + torch.arange(size)) % 2
    return (0.1 + 0.8 * board.float())[..., None].expand(size, size, 3).contiguous()


def holes(size: int = 8) -> Tensor:
    """A texture (size,size,4) of which every second cell is a hole."""
    solid = ((torch.arange(size)[:, None] // 2 + torch.arange(size) // 2) % 2).float()
    return torch.cat([torch.full((size, size, 3), 0.6), solid[..., None]], dim=-1)


MATERIALS = (
    Material(name="mirror", specular=1.0, diffuse=torch.zeros(3)),
    Material(name="card", diffuse=torch.ones(3), diffuse_texture=checks()),
    Material(name="red", diffuse=torch.tensor([0.8, 0.1, 0.1]), specular=0.05),
    Material(name="chrome", specular=0.9, gloss=0.3, diffuse=torch.full((3,), 0.05)),
    Material(name="leaf", diffuse_texture=holes(), alpha_cutoff=0.5),
    Material(name="lamp", emission=torch.full((3,), 2.0)),
)

POINT = PointLight(position=torch.tensor([2.0, 4.0, 3.0]), intensity=torch.full((3,), 15.0))


def rect(corner: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], radiance: float = 4.0) -> RectLight:
    """A white rectangular light."""
    place, edge_u, edge_v = (torch.tensor(x) for x in (corner, u, v))
    return RectLight(corner=place, edge_u=edge_u, edge_v=edge_v, radiance=torch.full((3,), radiance))


CEILING = rect((-1.0, 5.0, -1.0), (2.0, 0.0, 0.0), (0.0, 0.0, 2.0))


def sheet(corner: tuple[float, ...], u: tuple[float, ...], v: tuple[float, ...], material: int) -> Mesh:
    """A parallelogram that faces ``u x v``."""
    return replace(quad(*(torch.tensor(x, dtype=torch.float64) for x in (corner, u, v))), material=material)


def floor(half: float = 4.0, y: float = 0.0, material: int = CARD) -> Mesh:
    """A square that faces up."""
    return sheet((-half, y, half), (2 * half, 0.0, 0.0), (0.0, 0.0, -2 * half), material)


def back_wall(material: int = MIRROR, z: float = -3.0) -> Mesh:
    """A square that faces +z."""
    return sheet((-4.0, 0.0, z), (8.0, 0.0, 0.0), (0.0, 4.0, 0.0), material)


def block(size: tuple[float, ...], centre: tuple[float, ...], material: int) -> Mesh:
    """A box."""
    return moved(replace(box(torch.tensor(size)), material=material), centre)


def ball(radius: float, centre: tuple[float, ...], material: int, segments: int = 8) -> Mesh:
    """A sphere with its vertices on the grid of 1/16."""
    mesh = sphere(radius, segments)
    rounded = (mesh.vertices / STEP).round() * STEP
    return moved(replace(mesh, vertices=rounded, material=material), centre)


def moved(mesh: Mesh, offset: tuple[float, ...]) -> Mesh:
    """The mesh somewhere else."""
    return replace(mesh, vertices=mesh.vertices + torch.tensor(offset, dtype=torch.float64))


def soup(corners: Tensor, material: int = CARD) -> Mesh:
    """Loose triangles (F,3,3)."""
    count = len(corners)
    vertices = corners.double().reshape(-1, 3)
    uv = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]).repeat(count, 1)
    return Mesh(vertices=vertices, faces=torch.arange(3 * count).reshape(-1, 3), uv=uv, material=material)


def lit(*meshes: Mesh, lights: tuple[Light, ...] = (CEILING, POINT)) -> Scene:
    """A scene of these meshes under a rectangular light, a point light and some ambient light."""
    return Scene(meshes=meshes, materials=MATERIALS, lights=lights, ambient=torch.full((3,), 0.1))


def plain() -> Scene:
    """A wide floor and a mirror wall."""
    return lit(floor(1e3), back_wall())


def studio(*lights: Light | None) -> Scene:
    """Floor, mirror wall, a red block, a glossy ball and a leaf with holes; None among the lights: there are none."""
    return lit(
        floor(),
        back_wall(),
        block((1.0, 1.5, 1.0), (-1.5, 0.75, -0.5), RED),
        ball(0.75, (1.25, 0.75, -0.5), CHROME),
        sheet((-0.5, 0.5, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), LEAF),
        lights=tuple(light for light in lights if light) if lights else (CEILING, POINT),
    )


def views(
    eye: tuple[float, ...] = (0.5, 2.5, 6.0),
    target: tuple[float, ...] = (0.0, 0.75, 0.0),
    *,
    size: tuple[int, int] = (24, 18),
    fov_deg: float = 45.0,
    near: float = 0.01,
) -> Cameras:
    """Two cameras a little apart, the first at ``eye``; ``size`` is width and height."""
    eyes = torch.tensor([eye, eye], dtype=torch.float64)
    eyes[1, 0] += STEP
    return Cameras.look_at(eyes, target, width=size[0], height=size[1], fov_deg=fov_deg, near=near)


def placed(scene: Scene, cameras: Cameras, matrix: Tensor) -> tuple[Scene, Cameras]:
    """Everything after a similarity (4,4)."""
    meshes = tuple(place_mesh(mesh, matrix) for mesh in scene.meshes)
    lights = tuple(place_light(light, matrix) for light in scene.lights)
    return replace(scene, meshes=meshes, lights=lights), place_cameras(cameras, matrix)


def shifted(*offset: float) -> Tensor:
    """The matrix (4,4) of a translation."""
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, 3] = torch.tensor(offset, dtype=torch.float64)
    return matrix


def scaled(factor: float) -> Tensor:
    """The matrix (4,4) of an even scale."""
    return torch.diag(torch.tensor([factor, factor, factor, 1.0], dtype=torch.float64))


def turned() -> Tensor:
    """The matrix (4,4) of a rotation whose entries are no round numbers."""
    axis = torch.tensor([0.36, 0.8, -0.48], dtype=torch.float64)
    cross = torch.linalg.cross(axis.expand(3, 3), torch.eye(3, dtype=torch.float64)).T
    angle = torch.tensor(0.7, dtype=torch.float64)
    matrix = torch.eye(4, dtype=torch.float64)
    matrix[:3, :3] += angle.sin() * cross + (1 - angle.cos()) * cross @ cross
    return matrix


# ------------------------------------------------------------ single scenes


def degenerate() -> Scene:
    """Points, lines, needles, a triangle seen edge-on, in front of a wall."""
    flat = torch.tensor(
        [
            [[0.25, 1.0, 0.5]] * 3,
            [[-1.0, 1.0, 0.5], [0.0, 1.5, 0.5], [1.0, 2.0, 0.5]],
            [[-2.0, 0.5, 0.25], [2.0, 0.5 + 1e-9, 0.25], [2.0, 0.5 + 2e-9, 0.25]],
            [[-2.0, 1.0, 0.25], [2.0, 1.0, 0.25], [2.0, 1.0 + 1e-4, 0.25]],
            [[0.5, 2.5, 6.0], [0.0, 0.75, 0.0], [0.5, 0.0, 0.0]],
        ],
        dtype=torch.float64,
    )
    return lit(floor(), back_wall(), soup(flat, RED), soup(flat + 1.0, MIRROR))


def coincident(copies: int = 2000) -> Scene:
    """Thousands of copies of a triangle, with another one of another material in the same place."""
    triangle = torch.tensor([[[-2.0, 0.5, 0.0], [2.0, 0.5, 0.0], [0.0, 3.0, 0.0]]], dtype=torch.float64)
    return lit(floor(), soup(triangle.expand(copies, 3, 3), RED), soup(triangle, MIRROR))


def coplanar() -> Scene:
    """Sheets that overlap in one plane: mirror, card and red; some turned over."""
    return lit(
        back_wall(CARD, 0.0),
        sheet((-2.0, 1.0, 0.0), (3.0, 0.0, 0.0), (0.0, 2.0, 0.0), MIRROR),
        sheet((1.0, 0.5, 0.0), (0.0, 2.0, 0.0), (-2.0, 0.0, 0.0), RED),
        floor(),
        floor(2.0, material=MIRROR),
    )


def all_sizes(count: int = 80) -> Scene:
    """Triangles whose coordinates are of all sizes from 1e-8 to 1e8, and a floor."""
    generator = torch.Generator().manual_seed(7)
    exponent = 16.0 * torch.rand(count, 3, 3, generator=generator, dtype=torch.float64) - 8.0
    sign = torch.where(torch.rand(count, 3, 3, generator=generator) < 0.5, -1.0, 1.0)
    corners = sign * 10.0**exponent
    half = count // 2
    return lit(floor(), soup(corners[:half], RED), soup(corners[half:], MIRROR))


def facing_mirrors() -> Scene:
    """Two mirrors face to face, a block between them."""
    return lit(
        floor(), back_wall(), sheet((4.0, 0.0, 4.0), (-8.0, 0.0, 0.0), (0.0, 4.0, 0.0), MIRROR),
        block((0.5, 0.5, 0.5), (0.0, 1.0, 0.0), RED),
    )  # fmt: skip


def touching() -> Scene:
    """A glossy ball that touches mirror and floor, and a block whose side lies in the mirror."""
    return lit(
        floor(),
        back_wall(),
        ball(0.75, (1.0, 0.75, -2.25), CHROME),
        block((1.0, 1.0, 1.0), (-1.0, 0.5, -2.5), RED),
    )


def broken_balls() -> Scene:
    """A ball with every third face missing and one with every second face turned over."""
    whole = ball(1.0, (-1.25, 1.0, 0.0), RED, segments=14)
    other = ball(1.0, (1.25, 1.0, 0.0), CHROME, segments=14)
    faces = other.faces.clone()
    faces[::2] = faces[::2].flip(1)
    keep = torch.arange(len(whole.faces)) % 3 > 0
    return lit(floor(), back_wall(), replace(whole, faces=whole.faces[keep]), replace(other, faces=faces))


def inside_out() -> Scene:
    """The studio with all faces turned over."""
    scene = studio()
    return replace(scene, meshes=tuple(replace(m, faces=m.faces.flip(1).contiguous()) for m in scene.meshes))


def fan(side: int = 21) -> Scene:
    """A wall of small triangles whose inner vertices lie exactly where pixel centres look; see :func:`fan_views`."""
    steps = torch.arange(side + 1, dtype=torch.float64) - side / 2
    y, x = torch.meshgrid(steps, steps, indexing="ij")
    vertices = torch.stack([x, y, torch.zeros_like(x)], dim=-1).reshape(-1, 3) / 4
    corner = (torch.arange(side)[:, None] * (side + 1) + torch.arange(side)).reshape(-1)
    lower = torch.stack([corner, corner + 1, corner + side + 2], dim=1)
    upper = torch.stack([corner, corner + side + 2, corner + side + 1], dim=1)
    wall = Mesh(vertices=vertices, faces=torch.cat([lower, upper]), material=RED)
    return lit(wall, lights=(rect((-1.0, 1.0, 4.0), (2.0, 0.0, 0.0), (0.0, -2.0, 0.0)), POINT))


def fan_views(side: int = 20) -> Cameras:
    """Cameras before the fan; pixel centres of the first look exactly at its vertices."""
    eyes = torch.tensor([[0.0, 0.0, 5.0], [STEP, 0.0, 5.0]], dtype=torch.float64)
    ahead = eyes * torch.tensor([1.0, 1.0, 0.0], dtype=torch.float64)
    cameras = Cameras.look_at(eyes, ahead, width=side, height=side)
    k = cameras.intrinsics.clone()
    k[:, 0, 0] = k[:, 1, 1] = 5.0 / 0.25  # one pixel per cell of the wall
    return replace(cameras, intrinsics=k)
