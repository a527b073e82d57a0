"""A bound on what the textures of a scene take: the finest levels of the largest ones are left out, and named.

Files hold textures in a small part of what they take unpacked: a PNG of one colour in two hundred kilobytes what are
two gigabytes with all levels. Pictures filter textures to the size of a pixel; what is left out shows only from so near
that a texel covers several pixels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from torch import Tensor

from torchrender.images.bounded import Bound, at_most, smaller
from torchrender.numerics.texels.coded import codes_of
from torchrender.numerics.texture import halved_texture
from torchrender.scene.files.report import LoadReport, Note
from torchrender.scene.material import TEXTURES, Material
from torchrender.scene.model import Scene

LEVELS = 4 / 3
"""Numbers of all levels, with which pictures are made, for each number of a texture."""
CODED_LEVELS = 1 + 2 / 3
"""Bytes of all levels of a texture that is kept as codes, for each code: coarser ones have two for each number."""
BYTES, CODED_BYTES = int((1 + LEVELS) * 12), int((1 + CODED_LEVELS) * 3)
"""Of a texel of three channels, levels counted."""


@contextmanager
def bounded(most_bytes: int | None) -> Iterator[Bound]:
    """Pictures that are read inside are no larger than what a scene may have; None: all that they are."""
    pixels = (None, None) if most_bytes is None else (max(1, most_bytes // BYTES), max(1, most_bytes // CODED_BYTES))
    with at_most(*pixels) as bound:
        yield bound


def within(scene: Scene, most_bytes: int | None, lost: Mapping[str, int] = MappingProxyType({})) -> Scene:
    """The scene with textures that take ``most_bytes`` at most, all levels counted; what was done is in its report.

    The largest texture loses its finest level, each level a mean of two by two, until all fit together.

    Args:
        most_bytes: None: all that they have.
        lost: what was left out while the scene was read.
    """
    originals = _originals(scene)
    kept = dict(originals)
    while kept and most_bytes is not None and _all_bytes(kept) > most_bytes:
        name, largest = max(kept.items(), key=lambda pair: _bytes(pair[1]))
        if largest.shape[0] == largest.shape[1] == 1:
            break
        kept[name] = halved_texture(largest)
    said = Counter(lost)
    said.update(smaller(one.shape, kept[name].shape) for name, one in originals.items() if kept[name] is not one)
    if not said:
        return scene
    report = scene.report + LoadReport(not_used=tuple(Note(what, count) for what, count in said.items()))
    return scene.replace(materials=tuple(_with(material, kept) for material in scene.materials), report=report)


def bytes_of_levels(scene: Scene) -> int:
    """What pictures of a scene make of its textures, and keep as long as it."""
    return int(sum(_level_bytes(one) for one in _originals(scene).values()))


def _all_bytes(textures: Mapping[int, Tensor]) -> float:
    return sum(_bytes(one) + _level_bytes(one) for one in textures.values())


def _bytes(texture: Tensor) -> int:
    codes = codes_of(texture)
    return texture.nbytes if codes is None else codes.nbytes


def _level_bytes(texture: Tensor) -> float:
    return (LEVELS if codes_of(texture) is None else CODED_LEVELS) * _bytes(texture)


def _originals(scene: Scene) -> dict[int, Tensor]:
    """Each texture once, whatever materials have it."""
    return {id(one): one for material in scene.materials for one in textures_of(material).values()}


def textures_of(material: Material) -> dict[str, Tensor]:
    """By the names of their fields."""
    return {name: found for name in TEXTURES if (found := getattr(material, name)) is not None}


def _with(material: Material, kept: dict[int, Tensor]) -> Material:
    changed: dict[str, Any] = {
        name: kept[id(one)] for name, one in textures_of(material).items() if kept[id(one)] is not one
    }
    return replace(material, **changed) if changed else material
