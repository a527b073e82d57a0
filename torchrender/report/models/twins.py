"""Scenes, made here, that ask what well-known test models of glTF ask: each has the name of the one it is a twin of."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import torch
from torch import Tensor

from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight, SpotLight
from torchrender.scene.material import Material, Sampler
from torchrender.scene.mesh import Mesh
from torchrender.scene.model import Scene
from torchrender.scene.shapes import quad, sphere

UV = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
"""Texture coordinates of the corners of a board."""


@dataclass(frozen=True)
class Twin:
    """One scene, what it is to show, and where Mitsuba means something else."""

    name: str
    means: str
    make: Callable[[Environment], Scene]
    differs: str = ""
    fov_deg: float = 30.0


def seen(twin: Twin, scene: Scene, side: int) -> Cameras:
    """All of the board, straight from before it."""
    low, high = scene.bounds
    middle, size = (low + high) / 2, high - low
    away = 0.53 * float(size[:2].max()) / math.tan(math.radians(twin.fov_deg / 2)) + 0.5 * float(size[2])
    eye = middle + torch.tensor([0.0, 0.0, away], dtype=torch.float64)
    return Cameras.look_at(eye, middle, width=side, height=side, fov_deg=twin.fov_deg, near=1e-3 * away)


def _grid(materials: Sequence[Sequence[Material]], sky: Environment) -> Scene:
    """Balls in rows from above to below, columns from left to right."""
    ball = sphere(0.45, segments=48)
    ball = replace(ball, normals=torch.nn.functional.normalize(ball.vertices, dim=-1).float())
    meshes, flat = [], [m for row in materials for m in row]
    for number in range(len(flat)):
        row, column = divmod(number, len(materials[0]))
        place = torch.tensor([float(column), -float(row), 0.0])
        meshes.append(replace(ball, vertices=ball.vertices + place, material=number, name=f"ball {number}"))
    return Scene(meshes=tuple(meshes), materials=tuple(flat), environment=sky)


def _physical(color: Sequence[float] = (0.8, 0.8, 0.8), **more: Any) -> Material:
    values: dict[str, Any] = {"diffuse": torch.tensor(color), "metallic": 0.0, "roughness": 0.5}
    return Material(**values | more)


def _board(x: float, y: float, material: int, size: tuple[float, float] = (0.9, 0.9), z: float = 0.0) -> Mesh:
    w, h = size
    sheet = quad(torch.tensor((x - w / 2, y - h / 2, z)), torch.tensor((w, 0.0, 0.0)), torch.tensor((0.0, h, 0.0)))
    return replace(sheet, uv=UV, material=material)


def arrow(side: int = 64) -> Tensor:
    """(S,S,3) picture of an arrow to the upper right, which tells turns, flips and shifts apart."""
    y, x = (1.0 - (torch.arange(side) + 0.5) / side)[:, None], ((torch.arange(side) + 0.5) / side)[None]
    shaft = ((x - y).abs() < 0.08) & (x + y > 0.4) & (x + y < 1.6)
    head = (x < 0.85) & (y < 0.85) & (x + y > 1.25) & ((x > 0.72) | (y > 0.72))
    edge = (torch.minimum(torch.minimum(x, 1 - x), torch.minimum(y, 1 - y))) < 0.03
    picture = torch.tensor([0.75, 0.75, 0.72]).expand(side, side, 3).clone()
    picture[shaft | head] = torch.tensor([0.7, 0.1, 0.05])
    picture[edge] = torch.tensor([0.05, 0.1, 0.4])
    return picture


def bumps(side: int = 96) -> Tensor:
    """(S,S,3) normal map of a dome that stands out."""
    place = (torch.arange(side) + 0.5) / side * 2.0 - 1.0
    x, y = place[None].expand(side, -1), -place[:, None].expand(-1, side)
    inside = x.square() + y.square() < 0.64
    flat = torch.tensor([0.0, 0.0, 1.0]).expand(side, side, 3)
    dome = torch.stack([x, y, (1.0 - x.square() - y.square()).clamp_min(0.01).sqrt()], dim=-1)
    return torch.where(inside[..., None], dome, flat) * 0.5 + 0.5


def _metal_rough(sky: Environment) -> Scene:
    rows = [
        [_physical((0.95, 0.7, 0.3), metallic=m, roughness=r) for r in (0.0, 0.25, 0.5, 0.75, 1.0)]
        for m in (1.0, 0.5, 0.0)
    ]
    return _grid(rows, sky)


def _indices(sky: Environment) -> Scene:
    rows = [[_physical((0.01, 0.01, 0.01), roughness=r, ior=i) for i in (1.0, 1.2, 1.5, 1.8, 2.4)] for r in (0.0, 0.3)]
    return _grid(rows, sky)


def _sheens(sky: Environment) -> Scene:
    rows = [
        [
            _physical((0.1, 0.02, 0.02), roughness=1.0, sheen_color=torch.full((3,), c), sheen_roughness=r)
            for c in (0.0, 0.5, 1.0)
        ]
        for r in (0.3, 0.8)
    ]
    return _grid(rows, sky)


def _coats(sky: Environment) -> Scene:
    rows = [
        [_physical((0.3, 0.02, 0.02), roughness=0.7, clearcoat=c, clearcoat_roughness=r) for c in (0.0, 0.5, 1.0)]
        for r in (0.0, 0.4)
    ]
    return _grid(rows, sky)


def _unlit(sky: Environment) -> Scene:
    rows = [[_physical((0.8, 0.2, 0.05), unlit=True), _physical((0.05, 0.2, 0.8), unlit=True)]]
    return _grid(rows, sky)


def _emissive(sky: Environment) -> Scene:
    lamps = [
        _physical((0.0, 0.0, 0.0), emission=0.1 * strength * torch.tensor([0.4, 0.8, 1.0]))
        for strength in (1, 2, 4, 8, 16)
    ]
    wall = _physical((0.5, 0.5, 0.5), roughness=1.0)
    meshes = [_board(float(k), 0.0, k, (0.7, 1.6)) for k in range(5)] + [_board(2.0, 0.0, 5, (5.4, 2.4), -0.15)]
    return Scene(meshes=tuple(meshes), materials=(*lamps, wall), environment=replace(sky, intensity=0.2))


def _textured(sky: Environment) -> Scene:
    def laid(*rows: Sequence[float], **how: Any) -> Material:
        sampler = Sampler(transform=torch.tensor(rows), **how)
        return _physical(
            roughness=1.0, diffuse=torch.ones(3), diffuse_texture=arrow(), samplers={"diffuse_texture": sampler}
        )

    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    materials = (
        laid((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
        laid((1.0, 0.0, 0.5), (0.0, 1.0, 0.25)),
        laid((c, -s, 0.0), (s, c, 0.0)),
        laid((2.0, 0.0, 0.0), (0.0, 2.0, 0.0)),
        laid((3.0, 0.0, -1.0), (0.0, 3.0, -1.0), wrap_u="clamp", wrap_v="clamp"),
        laid((2.0, 0.0, 0.0), (0.0, 2.0, 0.0), wrap_u="mirror", wrap_v="mirror"),
    )
    meshes = tuple(_board(float(k % 3), -float(k // 3), k) for k in range(6))
    return Scene(meshes=meshes, materials=materials, environment=sky)


def _vertex_colors(sky: Environment) -> Scene:
    sheet = replace(_board(0.0, 0.0, 0), colors=torch.eye(4, 3) + torch.tensor([[0.0], [0.0], [0.0], [0.8]]))
    return Scene(meshes=(sheet,), materials=(_physical((1.0, 1.0, 1.0), roughness=1.0),), environment=sky)


def _mirrored_normals(sky: Environment) -> Scene:
    sun = DirectionalLight(direction=torch.tensor([0.6, -0.6, -0.5]), irradiance=torch.full((3,), 2.0))
    dome = _physical((0.5, 0.6, 0.7), roughness=0.4, normal_texture=bumps())
    flipped = [
        replace(_board(float(k), 0.0, 0), uv=UV @ torch.tensor(m) + torch.tensor(b))
        for k, (m, b) in enumerate(
            [
                ([[1.0, 0.0], [0.0, 1.0]], [0.0, 0.0]),
                ([[-1.0, 0.0], [0.0, 1.0]], [1.0, 0.0]),
                ([[0.0, 1.0], [-1.0, 0.0]], [1.0, 0.0]),
            ]
        )
    ]
    ball = sphere(0.36, segments=48)
    ball = replace(ball, normals=torch.nn.functional.normalize(ball.vertices, dim=-1).float())
    real = replace(ball, vertices=ball.vertices + torch.tensor([3.0, 0.0, -0.2]), material=1)
    materials = (dome, replace(dome, normal_texture=None))
    return Scene(
        meshes=(*flipped, real, _board(3.0, 0.0, 1)), materials=materials, lights=(sun,),
        environment=replace(sky, intensity=0.3),
    )  # fmt: skip


def _stripes(count: int, width: float) -> tuple[Mesh, ...]:
    step = width / count
    return tuple(_board(step * (k + 0.5), -0.5, k % 2, (step, 2.4), -0.4) for k in range(count))


def _panes(sky: Environment) -> Scene:
    white, dark = _physical((0.8, 0.8, 0.8), roughness=1.0), _physical((0.05, 0.05, 0.05), roughness=1.0)
    blends = [_physical((0.1, 0.3, 0.8), roughness=1.0, blend=True, opacity=a) for a in (0.0, 0.25, 0.5, 0.75, 1.0)]
    meshes = [_board(k + 0.5, -0.5, 2 + k, (0.8, 1.8)) for k in range(5)]
    return Scene(meshes=(*_stripes(20, 5.0), *meshes), materials=(white, dark, *blends), environment=sky)


def _glass(sky: Environment) -> Scene:
    white, dark = _physical((0.8, 0.8, 0.8), roughness=1.0), _physical((0.05, 0.05, 0.05), roughness=1.0)
    panes = [_physical((1.0, 0.4, 0.3), roughness=0.05, transmission=t) for t in (0.0, 0.5, 1.0)]
    panes.append(_physical((1.0, 1.0, 1.0), roughness=0.05, transmission=1.0))
    meshes = [_board(k + 0.5, -0.5, 2 + k, (0.8, 1.8)) for k in range(4)]
    return Scene(meshes=(*_stripes(16, 4.0), *meshes), materials=(white, dark, *panes), environment=sky)


def _lamps(sky: Environment) -> Scene:
    del sky
    wall = _physical((0.6, 0.6, 0.6), roughness=0.8)
    ball = sphere(0.3, segments=48)
    ball = replace(ball, normals=torch.nn.functional.normalize(ball.vertices, dim=-1).float())
    meshes = [_board(1.5, 0.0, 0, (5.0, 3.0)), replace(ball, vertices=ball.vertices + torch.tensor([1.5, -0.4, 0.4]))]
    lights = (
        PointLight(position=torch.tensor([0.3, 0.9, 0.8]), intensity=torch.tensor([1.2, 0.5, 0.2])),
        SpotLight(
            position=torch.tensor([2.8, 0.3, 2.5]), direction=torch.tensor([0.05, -0.1, -1.0]),
            intensity=torch.tensor([1.0, 3.0, 8.0]), inner_deg=12.0, outer_deg=16.0,
        ),
        DirectionalLight(direction=torch.tensor([0.4, -0.6, -1.0]), irradiance=torch.full((3,), 0.4)),
    )  # fmt: skip
    return Scene(meshes=tuple(meshes), materials=(wall,), lights=lights)


def _holes(sky: Environment) -> Scene:
    place = (torch.arange(96) + 0.5) / 96 * 2 - 1
    alpha = 1.0 - (place[None].square() + place[:, None].square()).sqrt()
    picture = torch.cat([torch.tensor([0.2, 0.6, 0.1]).expand(96, 96, 3), alpha.clamp_min(0.0)[..., None]], dim=-1)
    sheets = [
        _physical((1.0, 1.0, 1.0), roughness=1.0, diffuse_texture=picture, alpha_cutoff=a) for a in (0.25, 0.5, 0.75)
    ]
    wall = _physical((0.7, 0.7, 0.7), roughness=1.0)
    sun = DirectionalLight(direction=torch.tensor([0.3, -0.3, -1.0]), irradiance=torch.full((3,), 2.0))
    meshes = [_board(float(k), 0.0, k) for k in range(3)] + [_board(1.0, 0.0, 3, (3.2, 1.4), -0.4)]
    return Scene(
        meshes=tuple(meshes), materials=(*sheets, wall), lights=(sun,), environment=replace(sky, intensity=0.3)
    )


TWINS = (
    Twin("MetalRoughSpheres", "Metal above, half, plastic below; roughness 0 to 1 from left to right.", _metal_rough),
    Twin("Index of refraction", "Black balls, polished and rough: from 1 (mirrors nothing) to 2.4.", _indices),
    Twin("ClearCoatSpheres", "Coat 0, .5, 1; polished above, rough below.", _coats, "its coat is a quarter as bright"),
    Twin("SheenSpheres", "Sheen 0, .5, 1 brightens rims; narrow above.", _sheens, "another sheen, one roughness"),
    Twin("UnlitTest", "Flat discs of one colour: no light changes them.", _unlit),
    Twin("EmissiveStrengthTest", "Lamps of strengths 1 to 16; the wall is lit by the sky.", _emissive,
         "lamps light the wall there"),
    Twin("TextureTransformTest", "As it is, shifted, turned by 30 degrees, twice; clamped, mirrored.", _textured),
    Twin("VertexColorTest", "Red, green, blue and white corners.", _vertex_colors),
    Twin("NormalTangentMirrorTest", "Maps laid straight, mirrored, turned: all three as the real dome.",
         _mirrored_normals, "mirrored ones are lit from the wrong side there"),
    Twin("AlphaBlendTest", "Blue panes of opacity 0, 1/4 ... 1 before stripes.", _panes),
    Twin("TransmissionThinTest", "Red panes that let 0, half, all pass; the last is clear.", _glass),
    Twin("AlphaMaskTest", "Holes by cutoffs 1/4, 1/2, 3/4, and their shadows.", _holes),
    Twin("LightsPunctual", "A lamp, a spot with a soft edge, a sun; shadows of each.", _lamps,
         "no light comes back here"),
)  # fmt: skip
