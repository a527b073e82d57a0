"""Whether a picture's derivatives are asked for: the compiled kernel gives none."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.scene.model import Scene


def wants_gradient(scene: Scene, *others: Tensor | None) -> bool:
    """A material, texture, light or environment of the scene, or another input, is a variable of a derivative."""
    if not torch.is_grad_enabled():
        return False
    parts = (*scene.materials, *scene.lights, scene.environment)
    values = (value for part in parts if part is not None for value in vars(part).values())
    return any(isinstance(v, Tensor) and v.requires_grad for v in (*values, scene.ambient, *others))
