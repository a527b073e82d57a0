"""How far from the origin anything may be."""

from __future__ import annotations

from torch import Tensor

from torchrender.errors import InputError

FARTHEST = 1e15
"""Coordinate of whatever has a place, at most: light counts squares of distances in float32."""
FARTHEST_EYE = 1e16
"""The same of cameras, which may see all of what is that large."""


def check_near(name: str, value: Tensor, error: type[InputError] = InputError, *, limit: float = FARTHEST) -> Tensor:
    """Return ``value`` if no coordinate of it is farther from the origin than the limit."""
    most = float(value.detach().abs().amax()) if value.numel() else 0.0
    if not most <= limit:
        raise error(f"{name} must lie within {limit:g} scene units of the origin, got {most:g}")
    return value
