"""The Cornell box in metres: 0.5528 wide, 0.5488 high, 0.5592 deep, walls as slabs that overlap at the corners."""

from __future__ import annotations

import numpy as np
import torch

from torchrender.scene.light import RectLight
from torchrender.scene.model import Scene
from torchrender.scene.procedural.parts.assembly import Assembly, as_tensor, view
from torchrender.scene.procedural.parts.shapes import Index, gridded_box, yaw_matrix

USUAL, FEWEST = 96, 96
WIDE, HIGH, DEEP, WALL = 0.5528, 0.5488, 0.5592, 0.02
EMISSION = (18.4, 11.8, 5.2)

_BODIES = (  # name, material, low corner, high corner, yaw about the body's own centre; no two faces share a plane
    ("floor", "white", (-WALL, -WALL, 0.001), (WIDE + WALL, 0.0, DEEP + WALL), 0.0),
    ("ceiling", "white", (-WALL, HIGH, 0.001), (WIDE + WALL, HIGH + WALL, DEEP + WALL), 0.0),
    ("back wall", "white", (-0.019, -0.019, DEEP), (WIDE + 0.019, HIGH + 0.019, DEEP + 0.021), 0.0),
    ("red wall", "red", (WIDE, -0.018, 0.0), (WIDE + 0.021, HIGH + 0.018, DEEP + 0.018), 0.0),
    ("green wall", "green", (-0.021, -0.018, 0.0), (0.0, HIGH + 0.018, DEEP + 0.018), 0.0),
    ("short box", "white", (0.103, -0.001, 0.087), (0.268, 0.165, 0.252), 17.0),
    ("tall box", "white", (0.286, -0.001, 0.269), (0.451, 0.33, 0.434), -17.0),
    ("light", "light", (0.213, HIGH - 0.002, 0.227), (0.343, HIGH - 0.001, 0.332), 0.0),
)


def _cells(wanted: int) -> Index:
    """How often to cut each body along each axis so that all of them have ``wanted`` triangles together."""
    n = np.ones((len(_BODIES), 3), dtype=np.int64)
    rough = max(int(np.sqrt(wanted / 96.0)) - 1, 1)
    n[:] = rough

    def total(m: Index) -> int:
        return int(4 * (m[:, 0] * m[:, 1] + m[:, 1] * m[:, 2] + m[:, 2] * m[:, 0]).sum())

    for k in range(3 * len(_BODIES) * 4):
        more = n.copy()
        more[k % len(_BODIES), k // len(_BODIES) % 3] += 1
        if abs(total(more) - wanted) >= abs(total(n) - wanted):
            break
        n = more
    return n


def cornell_box(triangles: int, seed: int) -> Scene:
    """Red wall on the left, green on the right, as seen from the open front; nothing in it is random."""
    del seed
    made = Assembly()
    made.material("white", (0.73, 0.73, 0.73))
    made.material("red", (0.61, 0.055, 0.062))
    made.material("green", (0.117, 0.435, 0.115))
    made.material("light", (0.78, 0.78, 0.78), emission=torch.tensor(EMISSION) * 0.5)
    for (name, material, low, high, yaw), cells in zip(_BODIES, _cells(triangles)):
        a, b = np.array(low), np.array(high)
        centre, half = (a + b) / 2, (b - a) / 2
        made.add(name, (material, gridded_box(-half, half, cells).transformed(yaw_matrix(yaw), centre)))
    low, high = _BODIES[-1][2:4]
    light = RectLight(
        corner=as_tensor((low[0], low[1] - 0.001, low[2])),
        edge_u=as_tensor((high[0] - low[0], 0.0, 0.0)),
        edge_v=as_tensor((0.0, 0.0, high[2] - low[2])),
        radiance=torch.tensor(EMISSION) * 1.6,
        name="ceiling light",
    )
    cameras = {
        "default": view((0.278, 0.273, -0.8), (0.278, 0.273, 0.0), 39.3, 0.01, 5.0),
        "close": view((0.12, 0.4, -0.28), (0.31, 0.12, 0.3), 42.0, 0.01, 5.0),
    }
    return made.scene("cornell_box", lights=[light], cameras=cameras, ambient=(0.12, 0.10, 0.085))
