"""A bound on what the textures of a scene take: the finest levels of the largest ones are left out, and named.

Files hold textures in a small part of what they take unpacked: a PNG of one colour in two hundred kilobytes what are
two gigabytes with all levels. Pictures filter textures to the size of a pixel; what is left out shows only from so near
that a texel covers several pixels.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool2d

from torchrender.scene.files.report import LoadReport, Note
from torchrender.scene.material import TEXTURES, Material
from torchrender.scene.model import Scene

WITH_LEVELS = 7 / 3
"""A texture, and all its levels once more, with which pictures are made."""
ROWS = 256
"""That are halved at a time: what that takes is little beside the texture."""


def within(scene: Scene, most_bytes: int) -> Scene:
    """The scene with textures that take ``most_bytes`` at most, all levels counted; what was done is in its report.

    The largest texture loses its finest level, each level a mean of two by two, until all fit together.
    """
    originals = _originals(scene)
    kept = dict(originals)
    while kept and sum(WITH_LEVELS * one.nbytes for one in kept.values()) > most_bytes:
        name, largest = max(kept.items(), key=lambda pair: pair[1].nbytes)
        if largest.shape[0] == largest.shape[1] == 1:
            break
        kept[name] = halved(largest)
    lost = {name: one for name, one in originals.items() if kept[name] is not one}
    if not lost:
        return scene
    said = Counter(f"texels of a texture of {_size(one)}: {_size(kept[name])} are kept" for name, one in lost.items())
    report = scene.report + LoadReport(not_used=tuple(Note(what, count) for what, count in said.items()))
    return scene.replace(materials=tuple(_with(material, kept) for material in scene.materials), report=report)


def bytes_of_levels(scene: Scene) -> int:
    """What pictures of a scene make of its textures, and keep as long as it."""
    return int(sum((WITH_LEVELS - 1.0) * one.nbytes for one in _originals(scene).values()))


def _originals(scene: Scene) -> dict[int, Tensor]:
    """Each texture once, whatever materials have it."""
    return {id(one): one for material in scene.materials for one in textures_of(material).values()}


def textures_of(material: Material) -> dict[str, Tensor]:
    """By the names of their fields."""
    return {name: found for name in TEXTURES if (found := getattr(material, name)) is not None}


def halved(texture: Tensor) -> Tensor:
    """(H,W,C) -> (H/2,W/2,C) rounded down, at least one: means of (about) two by two texels."""
    height, width, channels = texture.shape
    size = max(height // 2, 1), max(width // 2, 1)
    if height % 2 or width % 2:
        return adaptive_avg_pool2d(texture.permute(2, 0, 1)[None], size)[0].permute(1, 2, 0).contiguous()
    made = torch.zeros(*size, channels)
    for begin in range(0, size[0], ROWS):
        rows = texture[2 * begin : 2 * (begin + ROWS)]
        pairs = rows[0::2] + rows[1::2]
        torch.add(pairs[:, 0::2], pairs[:, 1::2], out=made[begin : begin + ROWS])
    return made.mul_(0.25)


def _with(material: Material, kept: dict[int, Tensor]) -> Material:
    changed: dict[str, Any] = {
        name: kept[id(one)] for name, one in textures_of(material).items() if kept[id(one)] is not one
    }
    return replace(material, **changed) if changed else material


def _size(texture: Tensor) -> str:
    return f"{texture.shape[1]} x {texture.shape[0]}"
