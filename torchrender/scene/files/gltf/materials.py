"""glTF 2.0 materials as :class:`~torchrender.scene.material.Material`.

Specular-glossiness becomes metallic-roughness without loss: a dielectric of a very high index of refraction whose tint
is the specular colour. What a material here has no field for is named in the report of the load.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import torch
from torch import Tensor

from torchrender.errors import InputError, SceneFileError
from torchrender.numerics.texels.scaling import scaled_bilinearly
from torchrender.numerics.texture import channels_of
from torchrender.scene.files.gltf.container import GltfFile, object_of
from torchrender.scene.files.gltf.out.materials import PHONG
from torchrender.scene.files.gltf.textures import GltfTextures, SetsInUse
from torchrender.scene.material import Material, Sampler

MIRROR_IOR = 100.0
"""Index of refraction of a specular-glossiness material: its dielectric mirrors nearly all, its tint decides."""
_MIRROR_F0 = ((MIRROR_IOR - 1.0) / (MIRROR_IOR + 1.0)) ** 2
_PREFIX = "KHR_materials_"


class GltfMaterials:
    """Materials of one file."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._textures = GltfTextures(file)

    def begin(self, materials: Iterable[int]) -> None:
        """Decode the pictures of materials that will be read."""
        self._textures.begin(materials)

    def read(self, index: int) -> tuple[Material, tuple[int, ...]]:
        """Material ``index``, and the sets of texture coordinates in the file that its sets 0 and 1 stand for.

        Raises:
            SceneFileError: a value of wrong type or out of range, or a reference to nothing.
        """
        entry, key = self._file.item("materials", index), f"materials[{index}]"
        draft = _Draft(self._file, self._textures, entry, key)
        try:
            return draft.material(), tuple(draft.sets.numbers)
        except InputError as error:
            raise SceneFileError(self._file.path, str(error), key=key) from error


class _Draft:
    """One material in the making."""

    def __init__(self, file: GltfFile, textures: GltfTextures, entry: dict[str, Any], key: str) -> None:
        self._file, self._textures, self._entry, self._key = file, textures, entry, key
        self._extensions = object_of(entry.get("extensions"))
        self.sets = SetsInUse()
        self._samplers: dict[str, Sampler] = {}

    def material(self) -> Material:
        """All of it."""
        phong = object_of(object_of(self._entry.get("extras")).get(PHONG))
        gloss = self._extension("pbrSpecularGlossiness")
        base = object_of(self._entry.get("pbrMetallicRoughness"))
        surface = self._specular_glossiness(gloss) if gloss else self._metallic_roughness(base)
        color = (gloss, "diffuseFactor", "diffuseTexture") if gloss else (base, "baseColorFactor", "baseColorTexture")
        factor = self._file.numbers(color[0], color[1], [1.0, 1.0, 1.0, 1.0], self._key)
        texture = self._color("diffuse_texture", color[0].get(color[2]))
        values: dict[str, Any] = {
            "diffuse": _vector(factor[:3]),
            "diffuse_texture": texture,
            **surface,
            **self._alpha(float(factor[3])),
            **self._emission(),
            **self._relief(),
        }
        if phong:
            values |= self._phong(phong, values)
        else:
            values |= self._coat() | self._sheen() | self._transmission()
        return Material(
            name=str(self._entry.get("name", self._key)),
            unlit="KHR_materials_unlit" in self._extensions,
            double_sided=self._entry.get("doubleSided") is True,
            samplers={name: s for name, s in self._samplers.items() if values.get(name) is not None},
            **values,
        )

    # -------------------------------------------------------------------- parts

    def _metallic_roughness(self, pbr: dict[str, Any]) -> dict[str, Any]:
        specular = self._extension("specular")
        values: dict[str, Any] = {
            "metallic": self._share(pbr, "metallicFactor", 1.0),
            "roughness": self._share(pbr, "roughnessFactor", 1.0),
            "metallic_roughness_texture": self._plain(
                "metallic_roughness_texture", pbr.get("metallicRoughnessTexture")
            ),
            "specular_weight": self._share(specular, "specularFactor", 1.0),
            "specular_color": self._colors(specular, "specularColorFactor", 1.0),
            "specular_texture": self._specular_texture(specular),
        }
        ior = self._extension("ior")
        if "ior" in ior:
            value = self._file.number(ior, "ior", 1.5, self._key)
            # Zero stands for a surface that mirrors everything, where specular-glossiness was turned into this.
            values["ior"] = MIRROR_IOR if value == 0 else self._within("ior", value, 1.0, MIRROR_IOR)
        return values

    def _phong(self, phong: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
        """A material that was written by this package and was none of metallic-roughness."""
        plain = {"metallic": None, "roughness": 1.0, "specular_weight": 1.0, "metallic_roughness_texture": None}
        diffuse = values["diffuse"] * (1.0 - values["metallic"])
        return plain | {
            "diffuse": self._colors(phong, "diffuse", 1.0) if "diffuse" in phong else diffuse,
            "specular": self._share(phong, "specular", 0.0),
            "specular_color": self._colors(phong, "specular_color", 1.0),
            "gloss": self._share(phong, "gloss", 0.0),
            "shininess": self._within("shininess", self._file.number(phong, "shininess", 32.0, self._key), 0.0, 1e6),
        }

    def _specular_texture(self, specular: dict[str, Any]) -> Tensor | None:
        """Tint in the first three channels, weight in the fourth: two textures of the file in one."""
        tint = self._color("specular_texture", specular.get("specularColorTexture"))
        colors_by = self._samplers.get("specular_texture")
        weight = self._plain("specular_texture", specular.get("specularTexture"))
        if weight is None or weight.shape[2] < 4:
            self._keep("specular_texture", colors_by)
            return None if tint is None else channels_of(tint, 0, 3)
        if tint is None:
            alpha = channels_of(weight, 3, weight.shape[2])
            return torch.cat([torch.ones(*weight.shape[:2], 3), alpha], dim=-1)
        self._keep_one("specular_texture", colors_by, "specularTexture")
        return torch.cat(same_size(channels_of(tint, 0, 3), channels_of(weight, 3, weight.shape[2])), dim=-1)

    def _specular_glossiness(self, gloss: dict[str, Any]) -> dict[str, Any]:
        factor = self._share(gloss, "glossinessFactor", 1.0)
        info = gloss.get("specularGlossinessTexture")
        tint, codes = self._color("specular_texture", info), self._plain("metallic_roughness_texture", info)
        values: dict[str, Any] = {
            "metallic": 0.0,
            "ior": MIRROR_IOR,
            "specular_color": self._colors(gloss, "specularFactor", 1.0) / _MIRROR_F0,
            "specular_texture": None if tint is None else channels_of(tint, 0, 3),
            "roughness": 1.0 - factor,
        }
        if codes is not None and codes.shape[2] == 4:
            rough = 1.0 - factor * channels_of(codes, 3, 4)
            values["roughness"] = 1.0
            values["metallic_roughness_texture"] = torch.cat(
                [torch.ones_like(rough), rough, torch.ones_like(rough)], -1
            )
        return values

    def _alpha(self, factor: float) -> dict[str, Any]:
        mode = self._entry.get("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            raise SceneFileError(self._file.path, f"unknown alphaMode {mode!r}", key=self._key)
        if mode == "OPAQUE":
            return {}
        opacity = self._within("alpha of the base color", factor, 0.0, 1.0)
        if mode == "BLEND":
            return {"blend": True, "opacity": opacity}
        cutoff = self._file.number(self._entry, "alphaCutoff", 0.5, self._key)
        # A cutoff above one hides everything, which a material expresses by opacity 0.
        if cutoff > 1.0:
            return {"alpha_cutoff": 1.0, "opacity": 0.0}
        return {"alpha_cutoff": self._within("alphaCutoff", cutoff, 0.0, 1.0), "opacity": opacity}

    def _emission(self) -> dict[str, Any]:
        factor = self._colors(self._entry, "emissiveFactor", 0.0)
        strength = self._file.number(self._extension("emissive_strength"), "emissiveStrength", 1.0, self._key)
        info = self._entry.get("emissiveTexture")
        if not bool((factor > 0).any()):
            return {}
        return {
            "emission": factor * self._within("emissiveStrength", strength, 0.0, math.inf),
            "emission_texture": self._color("emission_texture", info),
        }

    def _relief(self) -> dict[str, Any]:
        normal, occlusion = (object_of(self._entry.get(n)) for n in ("normalTexture", "occlusionTexture"))
        scale = self._file.number(normal, "scale", 1.0, self._key)
        return {
            "normal_texture": self._plain("normal_texture", normal or None),
            "normal_scale": self._within("scale of a normal texture", scale, -100.0, 100.0),
            "occlusion_texture": self._plain("occlusion_texture", occlusion or None),
            "occlusion_strength": self._share(occlusion, "strength", 1.0),
        }

    def _coat(self) -> dict[str, Any]:
        """Clear coat; strength and roughness come as two pictures and become two channels of one."""
        coat = self._extension("clearcoat")
        strength = self._plain("clearcoat_texture", coat.get("clearcoatTexture"))
        sampler = self._samplers.get("clearcoat_texture")
        rough = self._plain("clearcoat_texture", coat.get("clearcoatRoughnessTexture"))
        if strength is not None:
            self._keep_one("clearcoat_texture", sampler, "clearcoatRoughnessTexture" if rough is not None else None)
        texture = None
        if strength is not None or rough is not None:
            one = torch.ones(1, 1, 3)
            first, second = same_size(one if strength is None else strength, one if rough is None else rough)
            planes = channels_of(first, 0, 1), channels_of(second, 1, 2), torch.ones(*first.shape[:2], 1)
            texture = torch.cat(planes, dim=-1)
        if "clearcoatNormalTexture" in coat:
            self._file.notes.not_used("clearcoatNormalTexture")
        return {
            "clearcoat": self._share(coat, "clearcoatFactor", 0.0),
            "clearcoat_roughness": self._share(coat, "clearcoatRoughnessFactor", 0.0),
            "clearcoat_texture": texture,
        }

    def _sheen(self) -> dict[str, Any]:
        sheen = self._extension("sheen")
        for name in ("sheenColorTexture", "sheenRoughnessTexture"):
            if name in sheen:
                self._file.notes.not_used(name)
        return {
            "sheen_color": self._colors(sheen, "sheenColorFactor", 0.0),
            "sheen_roughness": self._share(sheen, "sheenRoughnessFactor", 0.0),
        }

    def _transmission(self) -> dict[str, Any]:
        entry = self._extension("transmission")
        return {
            "transmission": self._share(entry, "transmissionFactor", 0.0),
            "transmission_texture": self._plain("transmission_texture", entry.get("transmissionTexture")),
        }

    # ----------------------------------------------------------------- helpers

    def _extension(self, name: str) -> dict[str, Any]:
        return object_of(self._extensions.get(_PREFIX + name))

    def _share(self, holder: Mapping[str, Any], name: str, default: float) -> float:
        return self._within(name, self._file.number(dict(holder), name, default, self._key), 0.0, 1.0)

    def _colors(self, holder: Mapping[str, Any], name: str, default: float) -> Tensor:
        given = _vector(self._file.numbers(dict(holder), name, [default] * 3, self._key))
        self._note(name, bool((given < 0).any()), "below 0: set to it")
        return given.clamp_min(0.0)

    def _within(self, name: str, value: float, low: float, high: float) -> float:
        """The number, or the end of its range that is nearest; said."""
        self._note(name, not low <= value <= high, f"outside [{low:g}, {high:g}]: set to its nearest end")
        return min(max(value, low), high)

    def _note(self, name: str, wrong: bool, how: str) -> None:
        if wrong:
            self._file.notes.repaired(f"{name} {how}")

    def _color(self, name: str, info: Any) -> Tensor | None:
        found = self._textures.color(info, self._key)
        return self._placed(name, info, found)

    def _plain(self, name: str, info: Any) -> Tensor | None:
        found = self._textures.plain(info, self._key)
        return self._placed(name, info, found)

    def _placed(self, name: str, info: Any, found: Tensor | None) -> Tensor | None:
        if found is not None:
            self._samplers[name] = self._textures.sampler(info, self.sets, self._key)
        return found

    def _keep(self, name: str, sampler: Sampler | None) -> None:
        if sampler is not None:
            self._samplers[name] = sampler

    def _keep_one(self, name: str, first: Sampler | None, second: str | None) -> None:
        """Two pictures share one sampler from here on: said where theirs differ."""
        other = self._samplers.get(name)
        if second is not None and first is not None and other is not None and not _alike(first, other):
            self._file.notes.not_used(f"the sampler of {second}, which differs from that of its partner")
        self._keep(name, first)


def same_size(first: Tensor, second: Tensor) -> tuple[Tensor, Tensor]:
    """Both pictures (H,W,C) at the larger of their sizes."""
    size = [max(a, b) for a, b in zip(first.shape[:2], second.shape[:2], strict=True)]
    return resized(first, size), resized(second, size)


def resized(picture: Tensor, size: list[int]) -> Tensor:
    """A picture (H,W,C) at another size, bilinear."""
    if list(picture.shape[:2]) == size:
        return picture
    planes = picture.permute(2, 0, 1)[None]
    scaled = scaled_bilinearly(planes, size)
    return scaled[0].permute(1, 2, 0).contiguous()


def _alike(first: Sampler, second: Sampler) -> bool:
    same = all(getattr(first, n) == getattr(second, n) for n in ("uv_set", "wrap_u", "wrap_v", "filter"))
    return same and torch.equal(first.transform, second.transform)


def _vector(values: Any) -> Tensor:
    return torch.as_tensor(values).float()
