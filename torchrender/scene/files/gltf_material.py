"""glTF 2.0 materials and textures as :class:`~torchrender.scene.material.Material`.

What has no counterpart is reduced, not dropped: roughness, metalness and emission textures count with their mean.
Normal, occlusion, clear-coat and transmission textures, sampler wrap modes and ``doubleSided`` are not used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchrender.errors import ImageFileError, InputError, SceneFileError
from torchrender.images.files import read_image_bytes
from torchrender.numerics.color import srgb_from_linear
from torchrender.scene.files.gltf_file import Array, GltfFile
from torchrender.scene.files.texture_file import as_texture, warn_missing_texture
from torchrender.scene.material import Material, from_metallic_roughness

_BLEND_CUTOFF = 0.5


@dataclass(frozen=True)
class TextureUse:
    """Which texture coordinates a material reads, and the transform ``T R S`` on them (KHR_texture_transform)."""

    set_index: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)


class GltfMaterials:
    """Materials of one file; materials that use the same image share one tensor."""

    def __init__(self, file: GltfFile) -> None:
        self._file = file
        self._images: dict[int, Tensor | None] = {}

    def read(self, index: int) -> tuple[Material, TextureUse]:
        """Material ``index`` and how it reads its colour texture.

        Raises:
            SceneFileError: a value of wrong type or out of range, or a reference to nothing.
        """
        entry, key = self._file.item("materials", index), f"materials[{index}]"
        extensions = _object(entry.get("extensions"))
        gloss = extensions.get("KHR_materials_pbrSpecularGlossiness")
        try:
            if isinstance(gloss, dict):
                return self._specular_glossiness(entry, gloss, key)
            return self._metallic_roughness(entry, _object(entry.get("pbrMetallicRoughness")), key)
        except InputError as error:
            raise SceneFileError(self._file.path, str(error), key=key) from error

    def _metallic_roughness(self, entry: dict[str, Any], pbr: dict[str, Any], key: str) -> tuple[Material, TextureUse]:
        file = self._file
        base = file.numbers(pbr, "baseColorFactor", [1.0, 1.0, 1.0, 1.0], key)
        metallic = file.number(pbr, "metallicFactor", 1.0, key)
        roughness = file.number(pbr, "roughnessFactor", 1.0, key)
        surface = self._texture(pbr.get("metallicRoughnessTexture"), key)
        if surface is not None and surface.shape[2] >= 3:
            # The picture was decoded as a colour, these are plain numbers.
            mean = srgb_from_linear(surface[..., :3]).mean(dim=(0, 1))
            roughness, metallic = roughness * float(mean[1]), metallic * float(mean[2])
        texture, cutoff = self._alpha(entry, self._texture(pbr.get("baseColorTexture"), key), float(base[3]), key)
        material = from_metallic_roughness(
            name=str(entry.get("name", key)),
            base_color=torch.from_numpy(base[:3]).float(),
            metallic=min(max(metallic, 0.0), 1.0),
            roughness=min(max(roughness, 0.0), 1.0),
            texture=texture,
            emission=self._emission(entry, key),
            alpha_cutoff=cutoff,
        )
        return material, self._use(pbr.get("baseColorTexture"), key)

    def _specular_glossiness(
        self, entry: dict[str, Any], gloss: dict[str, Any], key: str
    ) -> tuple[Material, TextureUse]:
        file = self._file
        base = file.numbers(gloss, "diffuseFactor", [1.0, 1.0, 1.0, 1.0], key)
        specular = torch.from_numpy(file.numbers(gloss, "specularFactor", [1.0, 1.0, 1.0], key)).float()
        roughness = min(max(1.0 - file.number(gloss, "glossinessFactor", 1.0, key), 0.0), 1.0)
        shared = self._texture(gloss.get("specularGlossinessTexture"), key)
        if shared is not None and shared.shape[2] >= 3:
            specular = specular * shared[..., :3].mean(dim=(0, 1))
            if shared.shape[2] == 4:
                roughness = 1.0 - (1.0 - roughness) * float(shared[..., 3].mean())
        texture, cutoff = self._alpha(entry, self._texture(gloss.get("diffuseTexture"), key), float(base[3]), key)
        strongest = float(specular.max())
        lobe = max(roughness, 0.02) ** 2
        material = Material(
            name=str(entry.get("name", key)),
            diffuse=torch.from_numpy(base[:3]).float(),
            diffuse_texture=texture,
            specular=min(max(strongest, 0.0), 1.0),
            specular_color=specular / strongest if strongest > 0 else torch.ones(3),
            gloss=roughness,
            shininess=min(max(2.0 / lobe**2 - 2.0, 1.0), 1e6),
            emission=self._emission(entry, key),
            alpha_cutoff=cutoff,
        )
        return material, self._use(gloss.get("diffuseTexture"), key)

    def _emission(self, entry: dict[str, Any], key: str) -> Tensor:
        factor = torch.from_numpy(self._file.numbers(entry, "emissiveFactor", [0.0, 0.0, 0.0], key)).float()
        strength = _object(_object(entry.get("extensions")).get("KHR_materials_emissive_strength"))
        factor = factor * self._file.number(strength, "emissiveStrength", 1.0, key)
        texture = self._texture(entry.get("emissiveTexture"), key) if bool((factor > 0).any()) else None
        return factor if texture is None else factor * texture[..., :3].mean(dim=(0, 1))

    def _alpha(
        self, entry: dict[str, Any], texture: Tensor | None, factor: float, key: str
    ) -> tuple[Tensor | None, float | None]:
        """The texture and the cutoff below which its alpha is a hole; the colour's own alpha enters the texture."""
        mode = entry.get("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            raise SceneFileError(self._file.path, f"unknown alphaMode {mode!r}", key=key)
        if mode == "OPAQUE":
            return texture, None
        cutoff = self._file.number(entry, "alphaCutoff", 0.5, key) if mode == "MASK" else _BLEND_CUTOFF
        # A cutoff above one hides everything, which a material expresses by alpha 0.
        factor, cutoff = (factor, cutoff) if cutoff <= 1.0 else (0.0, 1.0)
        if factor != 1.0:
            texture = torch.ones(1, 1, 4) if texture is None else texture
            alpha = texture[..., 3:] if texture.shape[2] == 4 else torch.ones_like(texture[..., :1])
            texture = torch.cat([texture[..., :3], alpha * factor], dim=-1)
        return texture, max(cutoff, 0.0)

    # ---------------------------------------------------------------- textures

    def _use(self, info: Any, key: str) -> TextureUse:
        if not isinstance(info, dict):
            return TextureUse()
        file = self._file
        transform = _object(_object(info.get("extensions")).get("KHR_texture_transform"))
        chosen = transform.get("texCoord", info.get("texCoord", 0))
        offset = file.numbers(transform, "offset", [0.0, 0.0], key)
        scale = file.numbers(transform, "scale", [1.0, 1.0], key)
        return TextureUse(
            set_index=chosen if isinstance(chosen, int) else 0,
            offset=(float(offset[0]), float(offset[1])),
            rotation=file.number(transform, "rotation", 0.0, key),
            scale=(float(scale[0]), float(scale[1])),
        )

    def _texture(self, info: Any, key: str) -> Tensor | None:
        """(H,W,3|4) linear float32, or None with a warning where the picture cannot be read."""
        if not isinstance(info, dict):
            return None
        source = self._file.item("textures", info.get("index")).get("source")
        if source is None:
            self._warn(key, f"texture {info.get('index')} has no PNG or JPEG image")
            return None
        if source not in self._images:
            self._images[source] = self._image(source, key)
        return self._images[source]

    def _image(self, index: int, key: str) -> Tensor | None:
        entry = self._file.item("images", index)
        name = str(entry.get("uri", entry.get("name", f"image {index}")))[:80]
        try:
            if "bufferView" in entry:
                buffer, start, size, _ = self._file.view(entry["bufferView"])
                data = buffer[start : start + size]
            else:
                data = self._file.resource(entry.get("uri"), f"images[{index}]")
            return as_texture(read_image_bytes(data, f"images[{index}]"))
        except ImageFileError as error:
            self._warn(key, f"texture {name!r}: {error.reason}")
        except SceneFileError as error:
            self._warn(key, f"texture {name!r}: {error.reason}")
        return None

    def _warn(self, key: str, reason: str) -> None:
        warn_missing_texture(self._file.path, key, reason)


def transform_uv(uv: Array, use: TextureUse) -> Array:
    """Texture coordinates (N,2), glTF orientation (v down), after KHR_texture_transform."""
    scaled = torch.from_numpy(uv.astype("float64")) * torch.tensor(use.scale, dtype=torch.float64)
    angle = torch.tensor(use.rotation, dtype=torch.float64)
    cosine, sine = torch.cos(angle), torch.sin(angle)
    u, v = scaled.unbind(-1)
    turned = torch.stack([cosine * u + sine * v, cosine * v - sine * u], dim=-1)
    moved: Array = (turned + torch.tensor(use.offset, dtype=torch.float64)).numpy()
    return moved


def _object(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}
