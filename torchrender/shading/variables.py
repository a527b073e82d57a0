"""Whether a picture's derivatives are asked for: the compiled kernel gives none."""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.scene.model import Scene


def wants_gradient(scene: Scene, *others: Tensor | None) -> bool:
    """A material, texture, light or environment of the scene, or another input, is a variable of a derivative."""
    if not torch.is_grad_enabled():
        return False
    return any(value.requires_grad for value in _tensors(scene)) or any(
        value is not None and value.requires_grad for value in others
    )


def _tensors(scene: Scene) -> tuple[Tensor, ...]:
    """Of the materials, lights and surroundings of a scene, which stay the same objects: looked for once."""
    known: tuple[Tensor, ...] | None = scene.__dict__.get("_tensors")
    if known is None:
        parts = (*scene.materials, *scene.lights, scene.environment)
        values = (value for part in parts if part is not None for value in vars(part).values())
        known = tuple(value for value in (*values, scene.ambient) if isinstance(value, Tensor))
        scene.__dict__["_tensors"] = known
    return known
