"""A street at night in ground fog: lamps in a row, each with its halo, a fence and bare trees before them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from torchrender.scene.light import PointLight, SpotLight
from torchrender.scene.medium import Medium
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, fitted, view
from torchrender.scene.procedural.parts.curves import cylinder, sphere, tube
from torchrender.scene.procedural.parts.shapes import Part, box, boxes, merge
from torchrender.scene.procedural.parts.textures import bricks, mottled

USUAL, FEWEST = 30_000, 5_000
FULL = 34_000
LAMPS = (-3.0, -12.0, -21.0)  # z
HEIGHT = 4.4
BESIDE = -2.6  # x of the lamps


def _post(detail: float) -> tuple[Part, Part]:
    """The post with its arm and shade, and the bulb at the origin."""
    segments = max(round(14 * detail), 5)
    path = np.array([(-0.9, -HEIGHT, 0.0), (-0.9, -0.6, 0.0), (-0.85, -0.1, 0.0), (-0.6, 0.22, 0.0), (0.0, 0.3, 0.0)])
    shade = cylinder(0.26, 0.2, 0.26, segments, bevel=0.01)
    foot = cylinder(0.16, 0.0, 0.5, segments, bevel=0.02).moved((-0.9, -HEIGHT, 0.0))
    return merge([tube(path, 0.06, segments), shade, foot]), sphere(0.07, segments)


def _fence(count: int) -> Part:
    z = np.linspace(2.0, -26.0, count)
    posts = np.stack([np.full(count, -3.9), np.full(count, 0.55), z], 1)
    rails = np.array([(-3.9, 0.35, -12.0), (-3.9, 0.95, -12.0)])
    sizes = np.concatenate([np.tile((0.05, 1.1, 0.05), (count, 1)), np.tile((0.03, 0.05, 28.0), (2, 1))])
    return boxes(np.concatenate([posts, rails]), sizes)


def _tree(rng: np.random.Generator, detail: float) -> Part:
    """A trunk that forks three times; bare, as in November."""
    sides = max(round(7 * detail), 4)
    parts: list[Part] = []

    def grow(base: np.ndarray, way: np.ndarray, length: float, radius: float, level: int) -> None:
        tip = base + way * length
        bend = (base + tip) / 2 + rng.normal(0, 0.05 * length, 3)
        parts.append(tube(np.stack([base, bend, tip]), np.array([radius, 0.85 * radius, 0.7 * radius]), sides))
        for _ in range(0 if level == 0 else 3):
            turned = way + rng.normal(0, 0.45, 3)
            turned[1] = abs(turned[1]) + 0.15
            grow(tip, turned / np.linalg.norm(turned), length * rng.uniform(0.55, 0.75), 0.65 * radius, level - 1)

    grow(np.zeros(3), np.array([0.0, 1.0, 0.0]), 1.9, 0.14, 3)
    return merge(parts)


def _furnished(detail: float, seed: int) -> Assembly:
    rng = np.random.default_rng((seed, 13))
    made = Assembly()
    made.material("asphalt", (1.0, 1.0, 1.0), texture=mottled(rng, (0.05, 0.05, 0.055), (0.09, 0.09, 0.095)))
    made.material("paving", (0.32, 0.31, 0.3))
    brick = bricks(rng, (0.32, 0.13, 0.09), (0.45, 0.2, 0.14), (0.4, 0.38, 0.35))
    made.material("brick", (1.0, 1.0, 1.0), texture=brick)
    made.material("iron", (0.05, 0.055, 0.06))
    made.material("bark", (0.13, 0.1, 0.08))
    made.material("bulb", (0.9, 0.9, 0.9), emission=as_tensor((9.0, 7.4, 4.8)))
    cell = float(np.clip(1.2 / detail, 0.2, 8.0))
    made.add("street", ("asphalt", box((-2.2, -0.3, -32.0), (3.6, 0.0, 6.0), cell=cell).mapped(0.5)))
    for name, low, high in (("left", -5.5, -2.2), ("right", 3.6, 5.6)):
        made.add(f"{name} pavement", ("paving", box((low, -0.3, -32.0), (high, 0.12, 6.0), cell=cell)))
    made.add("house", ("brick", box((5.6, -0.3, -32.0), (6.2, 7.0, 6.0), cell=cell).mapped(0.5)))
    made.add("fence", ("iron", _fence(max(round(60 * detail), 12))))
    post, bulb = _post(detail)
    for number, z in enumerate(LAMPS):
        made.add(f"lamp {number}", {"iron": post.moved((BESIDE, HEIGHT, z))})
        made.add(f"bulb {number}", ("bulb", bulb.moved((BESIDE, HEIGHT, z))))
    for number, (x, z) in enumerate(((-4.7, -6.5), (-4.9, -15.5), (-4.6, 1.0))):
        made.add(f"tree {number}", ("bark", _tree(rng, detail).moved((x, 0.1, z))))
    return made


def street_lamp(triangles: int, seed: int) -> Scene:
    """Everything gets finer with the count; cobbles along the kerb fill up what is left."""
    made, left = fitted(lambda detail: _furnished(detail, seed), triangles, usual=FULL)
    rng = np.random.default_rng((seed, 14))
    count = max(left // 12, 1)
    place = np.stack([rng.uniform(-2.35, -2.1, count), rng.uniform(0.05, 0.13, count), rng.uniform(-31, 5, count)], 1)
    made.add("cobbles", ("paving", boxes(place, rng.uniform(0.04, 0.12, (count, 3)), rng.uniform(0, 360, count))))
    lights = [
        PointLight(  # below the shade, at the rim of the bulb: a lamp within its own bulb would light nothing
            position=as_tensor((BESIDE, HEIGHT - 0.1, z)), intensity=as_tensor((26.0, 20.0, 12.0)), name=f"lamp {k}"
        )
        for k, z in enumerate(LAMPS)
    ]
    head = SpotLight(
        position=as_tensor((1.2, 0.7, -24.0)), direction=as_tensor((-0.03, 0.0, 1.0)),
        intensity=as_tensor((50.0, 54.0, 60.0)), inner_deg=7.0, outer_deg=15.0, name="headlight",
    )  # fmt: skip
    cameras = {
        "default": view((1.6, 1.7, 4.6), (-1.0, 2.3, -8.0), 58.0, 0.05, 80.0),
        "close": view((-0.4, 1.7, 1.2), (-2.5, 3.4, -3.0), 60.0, 0.05, 80.0),
        "fence": view((1.4, 1.4, -2.5), (-4.2, 1.9, -4.4), 62.0, 0.05, 80.0),
    }
    scene = made.scene("street_lamp", lights=[*lights, head], cameras=cameras, ambient=(0.004, 0.005, 0.008))
    fog = Medium(
        low=torch.tensor([-5.5, 0.0, -32.0]), high=torch.tensor([5.6, 9.0, 6.0]), scattering=torch.full((3,), 0.11),
        absorption=torch.full((3,), 0.01), density=1.0, falloff=0.22, asymmetry=0.6, name="ground fog",
    )  # fmt: skip
    return replace(scene, media=(fog,))
