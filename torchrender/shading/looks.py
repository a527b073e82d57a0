"""Materials and textures as the compiled kernel reads them, kept while they stay as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.kernels.shading.records import CHANNEL, LEVELS, MATERIAL, SLOT, Looks
from torchrender.numerics.texture import PADDING, pyramid_of
from torchrender.scene.material import FILTERS, PLAIN, WRAPS, Material, Sampler
from torchrender.scene.material_table import MaterialTable
from torchrender.shading.surface import METALLIC, PHONG

_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
PHONG_TEXTURES = ("diffuse_texture", "emission_texture", "specular_texture", "occlusion_texture", "normal_texture")
METALLIC_TEXTURES = (*PHONG_TEXTURES, "metallic_roughness_texture", "clearcoat_texture")
SKIPPED = {"metallic_roughness_texture": 1}
"""Leading channels that nobody reads."""


def looks_of(materials: Sequence[Material], table: MaterialTable) -> Looks:
    """The materials of a scene, built anew only where one or a texture has changed."""
    if not materials:
        return _built((), table)
    stamp = tuple((id(m), *(t._version for _, t in _textures(m, METALLIC_TEXTURES))) for m in materials)
    known = _KEPT.get(materials[0])
    if known is None or known[0] != stamp:
        known = (stamp, tuple(materials)[1:], _built(materials, table))  # ids hold while the materials live
        _KEPT[materials[0]] = known
    looks: Looks = known[2]
    return looks


def _textures(material: Material, names: Sequence[str]) -> list[tuple[str, Tensor]]:
    return [(name, getattr(material, name)) for name in names if getattr(material, name) is not None]


def _built(materials: Sequence[Material], table: MaterialTable) -> Looks:
    atlas = _Atlas()
    ranges = np.zeros((max(len(materials), 1), 4), np.int32)
    for number, material in enumerate(materials):
        kind = int(table.physical.kind[number])
        names = METALLIC_TEXTURES if kind == METALLIC else PHONG_TEXTURES if kind == PHONG else ("diffuse_texture",)
        first = len(atlas.rows)
        atlas.add(material, names)
        flags = int(material.normal_texture is not None and "normal_texture" in names)
        flags |= 2 * int(kind == PHONG and bool((table.highlight[number] > 0).any()))
        flags |= 4 * int(kind == METALLIC and bool((table.physical.sheen[number] > 0).any()))
        ranges[number] = first, len(atlas.rows), kind, flags
    groups, transforms, texels = atlas.arrays()
    return Looks(material_numbers(table), ranges, groups, transforms, texels)


def material_numbers(table: MaterialTable) -> np.ndarray[Any, Any]:
    """(M+1,32) float32, see :data:`MATERIAL`."""
    p = table.physical
    out = torch.zeros(len(table.diffuse), 32)
    phong = p.kind == PHONG
    columns = {
        "diffuse": table.diffuse, "emission": table.emission,
        "tint": torch.where(phong[:, None], table.tint, p.tint),
        "degree": torch.where(phong, table.specular, 0.0), "shininess": table.shininess,
        "lobe": (table.shininess + 2.0) / (2.0 * math.pi), "metallic": p.metallic, "roughness": p.roughness,
        "dielectric": p.dielectric, "weight": p.weight, "slowed": p.slowed, "excess": p.excess,
        "coat": p.clearcoat[:, 0], "coat_roughness": p.clearcoat[:, 1],
        "sheen": p.sheen, "sheen_roughness": p.sheen_roughness, "transmission": p.transmission,
        "normal_scale": p.normal_scale, "occlusion": p.occlusion_strength,
    }  # fmt: skip
    for name, value in columns.items():
        block = value.detach().reshape(len(out), -1).float()
        out[:, MATERIAL[name] : MATERIAL[name] + block.shape[1]] = block
    return out.numpy()


class _Atlas:
    """Texels of all groups of textures; those that are the same are stored once."""

    def __init__(self) -> None:
        self.rows: list[list[int]] = []
        self.transforms: list[list[float]] = []
        self.parts: list[Tensor] = []
        self.size = 0
        self.known: dict[Any, tuple[list[int], int]] = {}

    def add(self, material: Material, names: Sequence[str]) -> None:
        """The groups of one material: textures of one size that lie alike are interleaved."""
        alike: dict[Any, list[tuple[str, Tensor]]] = {}
        for name, texture in _textures(material, names):
            alike.setdefault((texture.shape[:2], *_manner(material.sampler(name))), []).append((name, texture))
        for members in alike.values():
            self._group(members, material.sampler(members[0][0]))

    def _group(self, members: list[tuple[str, Tensor]], sampler: Sampler) -> None:
        slots, parts = [], []
        for name, texture in members:
            names = [one for one in CHANNEL[name].split() if one != "-"]
            begin = SKIPPED.get(name, 0)
            part = texture.detach()[..., begin : begin + len(names)]
            slots += [SLOT[one] for one in names[: part.shape[2]]]
            parts.append(part)
        key = tuple((name, id(texture), texture._version) for name, texture in members)
        if key not in self.known:
            pyramid = pyramid_of(parts)
            levels = zip(pyramid.offset.tolist(), pyramid.width.tolist(), pyramid.height.tolist())
            told = [n for o, w, h in levels for n in (self.size + o * len(slots), w, h)]
            self.known[key] = (told, pyramid.level_count)
            self.parts.append(pyramid.texels.reshape(-1))
            self.size += pyramid.texels.numel()
        told, count = self.known[key]
        how = (WRAPS.index(sampler.wrap_u), WRAPS.index(sampler.wrap_v), FILTERS.index(sampler.filter))
        plain = int(torch.equal(sampler.transform, PLAIN.transform))
        head = [count, *how, sampler.uv_set, len(slots), plain, 0, *slots]
        self.rows.append(head + [-1] * (LEVELS - len(head)) + told)
        side, matrix = max(members[0][1].shape[:2]), sampler.transform
        scale = math.sqrt(max(abs(float(torch.linalg.det(matrix[:, :2].double()))), 1e-30))
        self.transforms.append([*matrix.reshape(-1).tolist(), math.log2(side * scale), 0.0])

    def arrays(self) -> tuple[np.ndarray[Any, Any], ...]:
        """Table, transforms and texels."""
        width = max([len(row) for row in self.rows], default=LEVELS + 3)
        rows = np.array([row + [0] * (width - len(row)) for row in self.rows], np.int64).reshape(-1, width)
        transforms = np.array(self.transforms, np.float32).reshape(-1, 8)
        texels = _joined(self.parts)
        return rows, transforms, texels


def _joined(parts: list[Tensor]) -> np.ndarray[Any, Any]:
    """All texels in a row; those of one group stay where they are."""
    if len(parts) == 1:
        return parts[0].numpy()  # is followed by more already
    whole = torch.cat([*parts, torch.zeros(PADDING)]).numpy()
    return whole[: len(whole) - PADDING]


def _manner(sampler: Sampler) -> tuple[Any, ...]:
    """What makes two samplers the same."""
    return (
        sampler.uv_set,
        tuple(sampler.transform.reshape(-1).tolist()),
        sampler.wrap_u,
        sampler.wrap_v,
        sampler.filter,
    )
