"""The part of a scene that a study looks at, by one rule for all scenes.

The built-in scenes stand on backdrops far wider than their subject: framed as a whole, a meadow's blades would share a
few dozen pixels. The published scenes had no such backdrop.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.scene.model import Scene

TAIL = 0.05


def subject_box(scene: Scene, tail: float = TAIL) -> Tensor:
    """(2,3) float64 box of the triangles' centres along each axis, without the outermost ``tail`` at either end."""
    geometry = scene.geometry
    centres = geometry.vertices[geometry.faces.long()].mean(dim=1)
    return torch.quantile(centres, torch.tensor([tail, 1.0 - tail], dtype=torch.float64), dim=0)


def own_direction(scene: Scene) -> Tensor:
    """(3,) float64 unit direction from the subject towards the scene's first camera."""
    return -scene.camera(width=8, height=8).forward[0].double()
