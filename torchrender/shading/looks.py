"""Materials and textures as the compiled kernel reads them, kept while they stay as they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.weak import WeakIdKeyDictionary

from torchrender.checks import check_finite
from torchrender.kernels.shading.records import CHANNEL, LEVELS, MATERIAL, SLOT, Looks
from torchrender.numerics.texels.coded import codes_of, room_for, state_of, tables
from torchrender.numerics.texels.levels import CodedPyramid
from torchrender.numerics.texture import Pyramid, channels_of, pyramid_of
from torchrender.scene.material import FILTERS, PHYSICAL_TEXTURES, PLAIN, WRAPS, Material, Sampler
from torchrender.scene.material_table import MaterialTable
from torchrender.scene.parts.kinds import color_versions
from torchrender.shading.surface import METALLIC, PHONG

Array = np.ndarray[Any, Any]

_KINDS = (np.float32, np.uint8, np.uint16)
_KEPT: WeakIdKeyDictionary = WeakIdKeyDictionary()
PHONG_TEXTURES = ("diffuse_texture", "emission_texture", "specular_texture", "occlusion_texture", "normal_texture")
METALLIC_TEXTURES = (*PHONG_TEXTURES, *PHYSICAL_TEXTURES)
SKIPPED = {"metallic_roughness_texture": 1}
"""Leading channels that nobody reads."""


def looks_of(materials: Sequence[Material], table: MaterialTable) -> Looks:
    """The materials of a scene, built anew only where one, a colour or a texture has changed."""
    if not materials:
        return _built((), table)
    textures = tuple((id(m), *(state_of(t) for _, t in _textures(m, METALLIC_TEXTURES))) for m in materials)
    stamp = textures, color_versions(materials)
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
        material.check_numbers()
        kind = int(table.physical.kind[number])
        names = METALLIC_TEXTURES if kind == METALLIC else PHONG_TEXTURES if kind == PHONG else ("diffuse_texture",)
        first = len(atlas.rows)
        atlas.add(material, names)
        flags = int(material.normal_texture is not None and "normal_texture" in names)
        flags |= 2 * int(kind == PHONG and bool((table.highlight[number] > 0).any()))
        flags |= 4 * int(kind == METALLIC and bool((table.physical.sheen[number] > 0).any()))
        ranges[number] = first, len(atlas.rows), kind, flags
    groups, transforms = atlas.arrays()
    texels, codes, coarser = (_joined(parts, kind) for parts, kind in zip(atlas.parts, _KINDS, strict=True))
    return Looks(material_numbers(table), ranges, groups, transforms, texels, codes, coarser, tables().reshape(-1))


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
        block = check_finite(f"{name} of the materials", value.detach().reshape(len(out), -1).float())
        out[:, MATERIAL[name] : MATERIAL[name] + block.shape[1]] = block
    return out.numpy()


class _Atlas:
    """Texels of all groups of textures; those that are the same are stored once."""

    def __init__(self) -> None:
        self.rows: list[list[int]] = []
        self.transforms: list[list[float]] = []
        self.parts: tuple[list[Array], ...] = ([], [], [])  # by _KINDS
        self.known: dict[Any, tuple[list[int], int, int]] = {}

    def add(self, material: Material, names: Sequence[str]) -> None:
        """The groups of one material: textures of one size that lie alike are interleaved."""
        alike: dict[Any, list[tuple[str, Tensor]]] = {}
        for name, texture in _textures(material, names):
            how = (texture.shape[:2], codes_of(texture) is None, *_manner(material.sampler(name)))
            alike.setdefault(how, []).append((name, texture))
        for members in alike.values():
            self._group(members, material.sampler(members[0][0]))

    def _group(self, members: list[tuple[str, Tensor]], sampler: Sampler) -> None:
        slots, read = [], []
        for name, texture in members:
            names = [one for one in CHANNEL[name].split() if one != "-"]
            begin = SKIPPED.get(name, 0)
            end = min(begin + len(names), texture.shape[2])
            slots += [SLOT[one] for one in names[: end - begin]]
            read.append((texture, begin, end))
        key = tuple((name, id(texture), state_of(texture)) for name, texture in members)
        if key not in self.known:
            with torch.no_grad():
                pyramid = pyramid_of([channels_of(texture, begin, end) for texture, begin, end in read])
            levels = zip(self._put(pyramid), pyramid.width.tolist(), pyramid.height.tolist(), strict=True)
            self.known[key] = ([n for level in levels for n in level], pyramid.level_count, _coded(pyramid))
        told, count, coded = self.known[key]
        how = (WRAPS.index(sampler.wrap_u), WRAPS.index(sampler.wrap_v), FILTERS.index(sampler.filter))
        plain = int(torch.equal(sampler.transform, PLAIN.transform))
        head = [count, *how, sampler.uv_set, len(slots), plain, coded, *slots]
        self.rows.append(head + [-1] * (LEVELS - len(head)) + told)
        side, matrix = max(members[0][1].shape[:2]), sampler.transform
        scale = math.sqrt(max(abs(float(torch.linalg.det(matrix[:, :2].double()))), 1e-30))
        self.transforms.append([*matrix.reshape(-1).tolist(), math.log2(side * scale), 0.0])

    def _put(self, pyramid: Pyramid) -> list[int]:
        """Keep the texels; -> the first number of each level."""
        if not isinstance(pyramid, CodedPyramid):
            begin = sum(len(part) for part in self.parts[0])
            self.parts[0].append(pyramid.texels.reshape(-1).numpy())
            return [begin + first * pyramid.texels.shape[1] for first in pyramid.offset.tolist()]
        count, channels = pyramid.codes.shape
        finest, coarser = (sum(len(part) for part in parts) for parts in self.parts[1:])
        self.parts[1].append(pyramid.codes.reshape(-1))
        self.parts[2].append(pyramid.coarser.reshape(-1))
        return [finest, *(coarser + (first - count) * channels for first in pyramid.offset.tolist()[1:])]

    def arrays(self) -> tuple[Array, Array]:
        """Table and transforms."""
        width = max([len(row) for row in self.rows], default=LEVELS + 3)
        rows = np.array([row + [0] * (width - len(row)) for row in self.rows], np.int64).reshape(-1, width)
        transforms = np.array(self.transforms, np.float32).reshape(-1, 8)
        return rows, transforms


def _coded(pyramid: Pyramid) -> int:
    """0 for numbers, else 1 and twice the bits of the channels whose codes are sRGB."""
    if not isinstance(pyramid, CodedPyramid):
        return 0
    return 1 + sum(2 << k for k, linear in enumerate(pyramid.linear) if linear)


def _joined(parts: list[Array], kind: Any) -> Array:
    """All texels in a row; those of one group stay where they are."""
    if len(parts) == 1:
        return parts[0]  # is followed by more already
    whole = room_for((sum(len(part) for part in parts),), kind)
    return np.concatenate(parts, out=whole) if parts else whole


def _manner(sampler: Sampler) -> tuple[Any, ...]:
    """What makes two samplers the same."""
    return (
        sampler.uv_set,
        tuple(sampler.transform.reshape(-1).tolist()),
        sampler.wrap_u,
        sampler.wrap_v,
        sampler.filter,
    )
