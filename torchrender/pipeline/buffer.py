"""Names of what passes hand on: each is typed, says whether it outlives a picture, and how it is blended in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Generic, TypeVar, cast

import torch
from torch import Tensor

from torchrender.buffers import GBuffer
from torchrender.errors import InputError
from torchrender.pipeline.options import RenderOptions
from torchrender.scene.model import Scene
from torchrender.scene.parts.kinds import color_versions

T = TypeVar("T")


class Order(IntEnum):
    """Where a layer goes: from what a surface sends to what lies before the eye. Numbers between are free."""

    EMISSION = 0
    DIRECT = 10
    REFLECTION = 20
    SCATTERING = 30
    TRANSPARENCY = 35
    ENHANCEMENT = 40


@dataclass(frozen=True, eq=False)
class Layer(Generic[T]):
    """How a buffer is blended into the picture: ``blend(scene, gbuffer, radiance so far, value) -> radiance``.

    Radiance is (B,H,W,3), linear; the first layer gets zeros.
    """

    order: int
    blend: Callable[[Scene, GBuffer, Tensor, T], Tensor]


@dataclass(frozen=True, eq=False)
class Lasting:
    """What outlives a picture: it is used again while what it was made from is the same.

    ``scene``: what of the scene, as it was given, shows in it; ``options``: what of the options. Both are tuples;
    their entries count as the same if they are the same object, or equal numbers, texts, tuples or options.
    """

    scene: Callable[[Scene], tuple[Any, ...]]
    options: Callable[[RenderOptions], tuple[Any, ...]] = lambda _: ()
    shared: bool = True  # any sequence of the scene may use it; else only the one that made it


@dataclass(frozen=True, eq=False)
class Buffer(Generic[T]):
    """The name of what a pass makes.

    A buffer is called what its pass is called; where several passes can make it, the last of them gives the name.
    """

    name: str
    kind: type[T]
    also: tuple[type, ...] = ()  # further types that serve in its place
    lasting: Lasting | None = None
    layer: Layer[T] | None = None

    def checked(self, value: object) -> T:
        """The value.

        Raises:
            InputError: it is of another type.
        """
        if not isinstance(value, (self.kind, *self.also)):
            raise InputError(f"{self.name} must be {self.kind.__name__}, got {type(value).__name__}")
        return cast("T", value)


def same(first: tuple[Any, ...], second: tuple[Any, ...]) -> bool:
    """Two origins of something lasting are the same."""
    return len(first) == len(second) and all(_alike(a, b) for a, b in zip(first, second, strict=True))


def _alike(first: Any, second: Any) -> bool:
    if first is second:
        return True
    if isinstance(first, Tensor) or isinstance(second, Tensor):
        return isinstance(first, Tensor) and isinstance(second, Tensor) and torch.equal(first, second)
    if isinstance(first, tuple) and isinstance(second, tuple):
        return same(first, second)
    return type(first) is type(second) and bool(first == second)


def triangles_of(scene: Scene) -> tuple[Any, ...]:
    """What rays and rasterised views depend on: the meshes, and the materials if some have holes or are panes."""
    holes = any(material.alpha_cutoff is not None or material.is_see_through for material in scene.materials)
    return (scene.meshes, scene.materials if holes else None)


def lights_of(scene: Scene) -> tuple[Any, ...]:
    """What shadow maps depend on."""
    return (*triangles_of(scene), scene.lights)


def look_of(scene: Scene) -> tuple[Any, ...]:
    """What the light that leaves surfaces depends on: everything but the cameras."""
    look = scene.materials, color_versions(scene.materials)  # colours may be written to in place
    return (*lights_of(scene), *look, scene.media, scene.environment, scene.ambient, scene.photo_light)
