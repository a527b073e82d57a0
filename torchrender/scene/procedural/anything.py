"""Scenes at random, over everything that a scene can be: for measuring on what nobody tuned for.

Rooms and open ground, few or many bodies that are flat, curved, thin or leafy, materials of every kind, one to five
lights of all kinds with and without a sky, and cameras near and far. A seed always gives the same scene.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from torchrender.scene.camera import Cameras
from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, Light, PointLight, RectLight, SpotLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts import curves, shapes, textures
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, sky, view
from torchrender.scene.procedural.parts.shapes import Array, Part

UNIT_BODIES = ("box", "rounded", "sphere", "ring", "pillar", "rods", "leaves", "blades")
MATERIALS = ("plain", "plain", "textured", "textured", "plastic", "metal", "mirror", "glazed")


def anything(seed: int) -> Scene:
    """The scene of a seed, a few hundred to a hundred thousand triangles; its size is 3 to 30 units."""
    rng = np.random.default_rng(seed)
    made = Assembly()
    inside = bool(rng.random() < 0.45)
    width, depth = rng.uniform(3.0, 8.0, 2) if inside else rng.uniform(4.0, 24.0, 2)
    height = float(rng.uniform(2.2, 4.0)) if inside else float(0.35 * min(width, depth))
    names = [_material(made, rng, f"material {n}") for n in range(int(rng.integers(2, 9)))]
    _shell(made, rng, inside, (width, height, depth))
    for number in range(int(rng.choice([2, 5, 12, 30, 60]))):
        scale = float(rng.uniform(0.08, 0.3) * min(width, depth) * rng.uniform(0.4, 1.0))
        place = np.array([rng.uniform(-0.42, 0.42) * width, 0.0, rng.uniform(-0.42, 0.42) * depth])
        body = _body(rng, str(rng.choice(UNIT_BODIES))).transformed(scale * shapes.yaw_matrix(rng.uniform(0, 360)))
        place[1] = -body.vertices[:, 1].min() + (rng.uniform(0.0, 0.5) * height if rng.random() < 0.2 else 0.002)
        made.add(f"body {number}", (str(rng.choice(names)), body.moved(place)))
    lights, environment, ambient = _lights(rng, inside, (width, height, depth))
    return made.scene(
        f"anything {seed}",
        lights=lights,
        cameras=_cameras(rng, inside, (width, height, depth)),
        ambient=ambient,
        environment=environment,
    )


def _color(rng: np.random.Generator, low: float = 0.05, high: float = 0.9) -> list[float]:
    grey, tint = rng.uniform(low, high), rng.uniform(-0.35, 0.35, 3)
    return [float(value) for value in np.clip(grey * (1 + tint), 0.02, 0.95)]


def _material(made: Assembly, rng: np.random.Generator, name: str) -> str:
    kind = str(rng.choice(MATERIALS))
    color = _color(rng)
    if kind == "textured":
        low, high = _color(rng), _color(rng)
        picture = (
            textures.mottled(rng, low, high, slope=float(rng.uniform(0.6, 2.0))),
            textures.stripes((low, high), (1.0, float(rng.uniform(0.3, 3.0)))),
            textures.wood(rng, low, high),
        )[int(rng.integers(3))]
        return made.material(name, (1.0, 1.0, 1.0), texture=picture)
    if kind == "plastic":
        return made.material(name, color, metallic=0.0, roughness=float(rng.uniform(0.05, 0.9)))
    if kind == "metal":
        return made.material(name, color, metallic=1.0, roughness=float(rng.uniform(0.0, 0.7)))
    if kind == "mirror":
        return made.mirror(name, [0.05 * c for c in color], float(rng.uniform(0.6, 0.95)), _color(rng, 0.6, 0.95))
    if kind == "glazed":
        return made.material(name, color, specular=float(rng.uniform(0.05, 0.3)), gloss=float(rng.uniform(0.0, 0.4)))
    return made.material(name, color)


def _shell(made: Assembly, rng: np.random.Generator, inside: bool, size: tuple[float, float, float]) -> None:
    """Floor and walls, or ground that may be hilly."""
    width, height, depth = size
    floor = _material(made, rng, "floor")
    if inside:
        walls = made.material("walls", _color(rng, 0.4, 0.85))
        for n, (x, y, z) in enumerate(((0, -1, 0), (0, 1, 0), (-1, 0, 0), (1, 0, 0), (0, 0, -1), (0, 0, 1))):
            half = np.array([width, height, depth]) / 2
            centre = np.array([x, y, z]) * (half + 0.05) + np.array([0, half[1], 0])
            thick = np.where(np.array([x, y, z]) != 0, 0.05, half + 0.1)
            part = shapes.gridded_box(centre - thick, centre + thick, np.full(3, 4))
            made.add(f"side {n}", (floor if n == 0 else walls, part))
        return
    steps = int(rng.choice([2, 24, 96]))
    line = np.linspace(-1.5, 1.5, steps)
    across, along = np.meshgrid(line, line, indexing="ij")
    hills = np.sin(3 * across + rng.uniform(0, 6)) * np.cos(2 * along) - 1.0
    rise = (0.03 * min(width, depth) if steps > 2 else 0.0) * hills
    ground = np.stack([across * width, rise, along * depth], axis=-1)[:, ::-1]
    made.add("ground", (floor, shapes.sheet(ground, smooth=steps > 2).mapped(float(rng.uniform(1.0, 12.0)))))


def _body(rng: np.random.Generator, kind: str) -> Part:
    """About one unit large, about the origin."""
    if kind == "box":
        sides = rng.uniform(0.3, 1.6, 3)
        return shapes.box(-sides / 2, sides / 2)
    if kind == "rounded":
        return shapes.rounded_box(rng.uniform(0.5, 1.4, 3), float(rng.uniform(0.05, 0.2)), steps=3, cells=2)
    if kind == "sphere":
        return curves.sphere([float(r) for r in rng.uniform(0.3, 0.7, 3)], int(rng.choice([16, 32, 64])))
    if kind == "ring":
        return curves.torus(0.5, float(rng.uniform(0.08, 0.22)), 48, 20).moved(tilt_deg=float(rng.uniform(0, 90)))
    if kind == "pillar":
        return curves.cylinder(float(rng.uniform(0.1, 0.3)), -0.7, 0.7, 32, bevel=0.03)
    if kind == "rods":
        count = int(rng.integers(6, 40))
        ends = rng.uniform(-0.6, 0.6, (2, count, 3))
        paths = np.stack([ends[0] * (1 - t) + ends[1] * t for t in np.linspace(0, 1, 4)], axis=1)
        return curves.tubes(paths, np.full((count, 4), float(rng.uniform(0.008, 0.03))), 8)
    count = int(rng.integers(60, 900))
    base = rng.normal(0.0, 0.28, (count, 3))
    if kind == "leaves":
        along, up = rng.normal(size=(2, count, 3))
        return curves.leaves(
            base, shapes.unit(along), shapes.unit(up), _sizes(rng, count, 0.14), _sizes(rng, count, 0.06)
        )
    base[:, 1] = 0.0
    lean = rng.normal(0.0, 0.15, (count, 3)) * np.array([1.0, 0.0, 1.0])
    return curves.blades(base, lean, _sizes(rng, count, 0.6), _sizes(rng, count, 0.03), 3)


def _sizes(rng: np.random.Generator, count: int, size: float) -> Array:
    return np.asarray(size * rng.uniform(0.6, 1.4, count))


def _lights(
    rng: np.random.Generator, inside: bool, size: tuple[float, float, float]
) -> tuple[list[Light], Environment | None, list[float]]:
    """One to five lights, the sky, and constant light; together neither dark nor white."""
    width, height, depth = size
    kinds = ("point", "spot", "rect", "rect") if inside else ("sun", "sun", "point", "spot", "rect")
    count = int(rng.choice([1, 1, 2, 3, 5]))
    lights: list[Light] = []
    for number in range(count):
        kind = str(rng.choice(kinds))
        place = np.array(
            [rng.uniform(-0.35, 0.35) * width, height * rng.uniform(0.75, 0.93), rng.uniform(-0.35, 0.35) * depth]
        )
        if not inside:
            place[1] = height * rng.uniform(0.8, 2.0)
        power = float(rng.uniform(1.2, 3.0)) / count
        tint = as_tensor([1.0, float(rng.uniform(0.75, 1.0)), float(rng.uniform(0.55, 1.1))])
        square = float(0.25 * (width**2 + depth**2) * 0.4 + place[1] ** 2)
        name = f"{kind} {number}"
        down = torch.tensor([float(rng.uniform(-0.6, 0.6)), -1.0, float(rng.uniform(-0.6, 0.6))])
        if kind == "sun":
            lights.append(DirectionalLight(direction=down, irradiance=power * tint, name=name))
        elif kind == "point":
            lights.append(PointLight(position=torch.from_numpy(place), intensity=power * square * tint, name=name))
        elif kind == "spot":
            outer = float(rng.uniform(20.0, 60.0))
            lights.append(
                SpotLight(
                    position=torch.from_numpy(place), direction=down, intensity=power * square * tint,
                    inner_deg=outer * float(rng.uniform(0.3, 0.9)), outer_deg=outer, name=name,
                )
            )  # fmt: skip
        else:
            side = float(rng.uniform(0.05, 0.35) * min(width, depth))
            lights.append(
                RectLight(
                    corner=torch.from_numpy(place - np.array([side / 2, 0.0, side / 2])),
                    edge_u=torch.tensor([side, 0.0, 0.0]), edge_v=torch.tensor([0.0, 0.0, side]),
                    radiance=power * square / side**2 * tint, name=name,
                )
            )  # fmt: skip
    if inside or rng.random() < 0.4:
        return lights, None, [float(v) for v in rng.uniform(0.02, 0.35) * np.array([0.9, 0.97, 1.1])]
    if rng.random() < 0.5:
        return lights, sky(rng, (0.4, 0.7, 0.3), clouds=float(rng.uniform(0.0, 0.8))), [0.0, 0.0, 0.0]
    ramp = torch.linspace(float(rng.uniform(0.3, 0.9)), 0.1, 16)[:, None, None] * torch.tensor([0.9, 0.97, 1.1])
    return lights, Environment(radiance=ramp.expand(16, 2, 3).contiguous(), name="overcast"), [0.0, 0.0, 0.0]


def _cameras(rng: np.random.Generator, inside: bool, size: tuple[float, float, float]) -> dict[str, Cameras]:
    """Two: across the scene, and a closer one."""
    width, height, depth = size
    found: dict[str, Cameras] = {}
    for name, near in (("default", 1.0), ("close", 0.5)):
        turn = rng.uniform(0.0, 2 * np.pi)
        reach = 0.42 if inside else float(rng.uniform(0.6, 1.1))
        eye = [
            near * reach * width * np.cos(turn),
            height * rng.uniform(0.25, 0.7),
            near * reach * depth * np.sin(turn),
        ]
        target: Sequence[float] = [rng.uniform(-0.15, 0.15) * width, 0.2 * height, rng.uniform(-0.15, 0.15) * depth]
        far = 20.0 * max(width, depth)
        found[name] = view([float(v) for v in eye], target, float(rng.uniform(35.0, 70.0)), 1e-3 * width, far)
    return found
