"""Coloured panes before each other on a table: what lies behind shows through up to eight of them."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.scene.environment import Environment
from torchrender.scene.light import DirectionalLight, PointLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, view
from torchrender.scene.procedural.parts.shapes import gridded_box, yaw_matrix

FEWEST = 192
USUAL = 4_800

PANES = (  # name, colour, opacity
    ("amber pane", (0.90, 0.55, 0.10), 0.45),
    ("blue pane", (0.10, 0.25, 0.80), 0.35),
    ("green pane", (0.10, 0.65, 0.25), 0.40),
    ("red pane", (0.80, 0.08, 0.10), 0.30),
    ("violet pane", (0.45, 0.15, 0.70), 0.35),
)
GLASS = (("clear glass", (0.95, 0.98, 0.97)), ("bottle glass", (0.45, 0.80, 0.50)), ("smoked glass", (0.5, 0.45, 0.4)))

_SOLID = (  # name, colour, centre, half size, yaw
    ("table", (0.55, 0.42, 0.30), (0.0, -0.05, 0.0), (1.6, 0.05, 1.2), 0.0),
    ("back", (0.75, 0.74, 0.70), (0.0, 0.8, -1.25), (1.6, 0.9, 0.04), 0.0),
    ("block", (0.80, 0.30, 0.18), (-0.55, 0.205, -0.75), (0.2, 0.2, 0.2), 24.0),
    ("post", (0.20, 0.45, 0.62), (0.1, 0.355, -0.95), (0.08, 0.35, 0.08), 0.0),
    ("step", (0.85, 0.80, 0.55), (0.7, 0.105, -0.6), (0.25, 0.1, 0.18), -15.0),
)
_BODIES = len(_SOLID) + len(PANES) + len(GLASS)


def _cells(wanted: int) -> tuple[int, int]:
    """Cells along each edge of all bodies, and of the first one, for about ``wanted`` triangles."""
    each = max(int(np.sqrt(wanted / (12.0 * _BODIES))), 1)
    left = wanted - 12 * each * each * (_BODIES - 1)
    return each, max(round(float(np.sqrt(max(left, 12) / 12.0))), 1)


def panes(triangles: int, seed: int) -> Scene:
    """Five blended panes and three thin walls of glass before solid blocks; the seed turns and shifts the panes."""
    rng = np.random.default_rng(seed)
    made = Assembly()
    each, first = _cells(triangles)
    for number, (name, color, centre, half, yaw) in enumerate(_SOLID):
        made.material(name, color)
        cells = np.full(3, first if number == 0 else each)
        part = gridded_box(-np.array(half), np.array(half), cells)
        made.add(name, (name, part.transformed(yaw_matrix(yaw), np.array(centre))))
    for name, color, opacity in PANES:
        made.material(name, color, metallic=0.0, roughness=0.2, opacity=opacity, blend=True)
    for name, color in GLASS:
        made.material(name, color, metallic=0.0, roughness=0.05, transmission=0.95)
    order = [name for name, *_ in PANES] + [name for name, _ in GLASS]
    for number, name in enumerate(order):
        size = np.array((0.34, 0.3, 0.006))
        middle = np.array((-0.85 + 0.24 * number, 0.305, 0.75 - 0.13 * number + rng.uniform(-0.02, 0.02)))
        part = gridded_box(-size, size, np.full(3, each))
        made.add(name, (name, part.transformed(yaw_matrix(rng.uniform(-12.0, 12.0)), middle)))
    sun = DirectionalLight(direction=torch.tensor([-0.45, -1.0, -0.7]), irradiance=torch.tensor([1.6, 1.5, 1.35]))
    lamp = PointLight(position=as_tensor((0.9, 1.3, 0.9)), intensity=torch.tensor([0.8, 0.8, 0.9]), name="lamp")
    sky = torch.linspace(0.5, 0.2, 16)[:, None, None] * torch.tensor([0.9, 0.97, 1.1])
    cameras = {
        "default": view((1.1, 0.95, 2.1), (-0.05, 0.22, 0.0), 42.0, 0.01, 20.0),
        "close": view((-1.9, 0.75, 1.9), (0.1, 0.2, 0.1), 42.0, 0.01, 20.0),
    }
    air = Environment(radiance=sky.expand(16, 2, 3).contiguous(), name="overcast")
    return made.scene("panes", lights=[sun, lamp], cameras=cameras, ambient=(0.01, 0.01, 0.012), environment=air)
