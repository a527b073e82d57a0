"""Materials as entries of a GLB file, with their textures and samplers.

Metallic-roughness is written as it is. For Phong the specular degree S and the diffuse reflectance D are those of
``S = 0.04 (1-m) + m max(c)`` and ``D = c (1-m)`` for one base colour c and metalness m, which
:func:`metallic_roughness` solves; the roughness is the gloss. A material that mirrors less than bare plastic (S < 0.04)
has m = 0 and its share of 0.04 in KHR_materials_specular. Phong exponents that do not follow from the roughness are
lost. Such a material is also written in its own terms into the entry's ``extras``, from where it comes back as it was.

Textures become PNG files of 8 bits: what that takes from a material, :attr:`MaterialWriter.lost` tells.
"""

from __future__ import annotations

import io
import math
from typing import Any, NamedTuple

import torch
from PIL import Image
from torch import Tensor

from torchrender.numerics.color import srgb_from_linear
from torchrender.numerics.texels.coded import codes_of
from torchrender.numerics.texture import channels_of
from torchrender.scene.files.gltf.out.document import GlbDocument
from torchrender.scene.material import DIELECTRIC_F0, PLAIN, Material, Sampler

PHONG = "torchrender_phong"
"""Member of a material's extras."""
_OFF = 0.1
"""Of a step of 8 bits: a texture whose numbers are farther from all codes has more than these."""
_CLIPPED = 1e-4
"""By which a number may be above 1 for other reasons than light."""
_WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
_FILTERS = {"trilinear": (9729, 9987), "bilinear": (9729, 9729), "nearest": (9728, 9728)}


def metallic_roughness(material: Material) -> tuple[Tensor, float, float]:
    """Base colour (3,), metalness and roughness whose :func:`from_metallic_roughness` has the same diffuse
    reflectance, specular degree and gloss, as far as there are any.

    With D the strongest channel of the diffuse reflectance and x = 1 - m: ``0.04 x^2 - (S + D) x + D = 0``.
    """
    strongest = float(material.diffuse.max())
    metal = metalness(strongest, material.specular)
    if metal < 1.0:
        return material.diffuse / (1.0 - metal), metal, material.gloss
    return material.specular_color * material.specular, 1.0, material.gloss


def metalness(diffuse: float, specular: float) -> float:
    """Metalness in [0,1] of a surface with these diffuse and specular reflectances; 0 where S <= 0.04."""
    if specular <= DIELECTRIC_F0:
        return 0.0
    if diffuse <= 0.0:
        return 1.0
    both = specular + diffuse
    root = math.sqrt(max(both * both - 4.0 * DIELECTRIC_F0 * diffuse, 0.0))
    # The smaller root, in the form that does not cancel.
    return min(max(1.0 - 2.0 * diffuse / (both + root), 0.0), 1.0)


class MaterialWriter:
    """Materials of one document; those that use the same texture share it."""

    def __init__(self, document: GlbDocument) -> None:
        self._document = document
        self._images: dict[tuple[int, bool], _Written] = {}
        self._samplers: dict[tuple[int, ...], int] = {}
        self.lost: dict[str, dict[str, None]] = {}  # what the file is without, and the names of the materials

    def entry(self, material: Material) -> dict[str, Any]:
        """The JSON of a material; its textures become entries of the document."""
        base, metal, rough = (
            (material.diffuse, material.metallic, material.roughness)
            if material.metallic is not None
            else metallic_roughness(material)
        )
        texture = material.diffuse_texture
        if texture is not None and float(base.max()) > 1.0:
            # Factors end at one; the texture takes what is above.
            texture = torch.cat(
                [channels_of(texture, 0, 3) * base.clamp_min(1.0), channels_of(texture, 3, texture.shape[2])], dim=-1
            )
            base = base.clamp(max=1.0)
        sees_through = material.blend or material.alpha_cutoff is not None
        alpha = material.opacity if sees_through else 1.0
        pbr: dict[str, Any] = {
            "baseColorFactor": [*_plain(base.clamp(0.0, 1.0)), alpha],
            "metallicFactor": float(metal),
            "roughnessFactor": float(rough),
        }
        self._put(pbr, "baseColorTexture", material, "diffuse_texture", texture)
        self._put(pbr, "metallicRoughnessTexture", material, "metallic_roughness_texture", plain=True)
        out: dict[str, Any] = {
            "name": material.name,
            "pbrMetallicRoughness": pbr,
            "doubleSided": material.double_sided,
        }
        self._put(out, "normalTexture", material, "normal_texture", plain=True, scale=material.normal_scale)
        self._put(
            out, "occlusionTexture", material, "occlusion_texture", plain=True, strength=material.occlusion_strength
        )
        extensions = self._physical(material) if material.is_physical else self._phong(material, out)
        self._emission(material, out, extensions)
        if material.blend:
            out["alphaMode"] = "BLEND"
        if material.alpha_cutoff is not None:
            out |= {"alphaMode": "MASK", "alphaCutoff": float(material.alpha_cutoff)}
        if material.unlit:
            extensions["KHR_materials_unlit"] = {}
        if extensions:
            out["extensions"] = extensions
            self._document.extensions |= set(extensions)
        return out

    def _emission(self, material: Material, out: dict[str, Any], extensions: dict[str, Any]) -> None:
        strength = float(material.emission.max())
        if not strength > 0:
            return
        out["emissiveFactor"] = _plain(material.emission / max(strength, 1.0))
        if strength > 1.0:
            extensions["KHR_materials_emissive_strength"] = {"emissiveStrength": strength}
        self._put(out, "emissiveTexture", material, "emission_texture")

    def _phong(self, material: Material, out: dict[str, Any]) -> dict[str, Any]:
        if material.specular_texture is not None:
            self._lose("the specular textures of Phong", material)
        out["extras"] = {
            PHONG: {
                "specular": float(material.specular),
                "specular_color": _plain(material.specular_color),
                "gloss": float(material.gloss),
                "shininess": float(material.shininess),
            }
        }
        if material.diffuse_texture is None and float(metallic_roughness(material)[0].max()) > 1.0:  # factors end there
            out["extras"][PHONG]["diffuse"] = _plain(material.diffuse)
        if material.specular < DIELECTRIC_F0 * (1.0 - 1e-6):
            return {"KHR_materials_specular": {"specularFactor": material.specular / DIELECTRIC_F0}}
        return {}

    def _physical(self, material: Material) -> dict[str, Any]:
        """Extensions of a metallic-roughness material that differs from the plain one."""
        found: dict[str, Any] = {}
        if material.ior != 1.5:
            found["KHR_materials_ior"] = {"ior": float(material.ior)}
        specular: dict[str, Any] = {}
        if material.specular_weight != 1.0:
            specular["specularFactor"] = float(material.specular_weight)
        if not bool((material.specular_color == 1.0).all()):
            specular["specularColorFactor"] = _plain(material.specular_color)
        self._put(specular, "specularColorTexture", material, "specular_texture")
        if material.specular_texture is not None and material.specular_texture.shape[2] == 4:
            self._put(specular, "specularTexture", material, "specular_texture")
        coat: dict[str, Any] = {}
        if material.clearcoat > 0:
            coat = {
                "clearcoatFactor": float(material.clearcoat),
                "clearcoatRoughnessFactor": float(material.clearcoat_roughness),
            }
            for name in ("clearcoatTexture", "clearcoatRoughnessTexture"):
                self._put(coat, name, material, "clearcoat_texture", plain=True)
        sheen: dict[str, Any] = {}
        if bool((material.sheen_color > 0).any()):
            sheen = {
                "sheenColorFactor": _plain(material.sheen_color),
                "sheenRoughnessFactor": float(material.sheen_roughness),
            }
        passing: dict[str, Any] = {}
        if material.transmission > 0:
            passing = {"transmissionFactor": float(material.transmission)}
            self._put(passing, "transmissionTexture", material, "transmission_texture", plain=True)
        parts = {"specular": specular, "clearcoat": coat, "sheen": sheen, "transmission": passing}
        return found | {f"KHR_materials_{name}": part for name, part in parts.items() if part}

    # ---------------------------------------------------------------- textures

    def _put(
        self,
        holder: dict[str, Any],
        name: str,
        material: Material,
        field: str,
        texture: Tensor | None = None,
        *,
        plain: bool = False,
        **more: float,
    ) -> None:
        """The texture of a field under a name of the format; nothing where the material has none."""
        texture = getattr(material, field) if texture is None else texture
        if texture is None:
            return
        sampler = material.sampler(field)
        image = self._image(texture, plain=plain)
        what = field.replace("_", " ")
        if image.clipped:
            self._lose(f"what the {what}s have above 1", material)
        if image.rounded and texture is getattr(material, field):
            self._lose(f"more than 8 bits of the {what}s", material)
        info: dict[str, Any] = {"index": self._texture(image.number, sampler)}
        if sampler.uv_set:
            info["texCoord"] = sampler.uv_set
        if not torch.equal(sampler.transform, PLAIN.transform):
            info["extensions"] = {"KHR_texture_transform": downwards(sampler.transform)}
            self._document.extensions.add("KHR_texture_transform")
        holder[name] = info | {k: float(v) for k, v in more.items() if v != 1.0}

    def _lose(self, what: str, material: Material) -> None:
        self.lost.setdefault(what, {})[material.name] = None

    def _texture(self, image: int, sampler: Sampler) -> int:
        high, low = _FILTERS[sampler.filter]
        key = (high, low, _WRAPS[sampler.wrap_u], _WRAPS[sampler.wrap_v])
        if key not in self._samplers:
            entry = dict(zip(("magFilter", "minFilter", "wrapS", "wrapT"), key, strict=True))
            self._samplers[key] = self._document.add("samplers", entry)
        entry = {"source": image, "sampler": self._samplers[key]}
        known: list[dict[str, Any]] = self._document.json.setdefault("textures", [])
        return known.index(entry) if entry in known else self._document.add("textures", entry)

    def _image(self, texture: Tensor, *, plain: bool) -> _Written:
        key = (id(texture), plain)
        if key not in self._images:
            values = texture.float().detach()
            clipped, values = bool(values.amax() > 1.0 + _CLIPPED), values.clamp(0.0, 1.0)
            if values.shape[2] == 1:
                values = values.expand(-1, -1, 3)
            color = values[..., :3] if plain else srgb_from_linear(values[..., :3])
            shades = torch.cat([color, values[..., 3:]], dim=-1) * 255.0
            codes = (shades + 0.5).to(torch.uint8)
            rounded = codes_of(texture) is None and bool((shades - codes).abs().amax() > _OFF)
            file = io.BytesIO()
            Image.fromarray(codes.numpy()).save(file, format="PNG")
            entry = {"bufferView": self._document.view(file.getvalue()), "mimeType": "image/png"}
            number = self._document.add("images", entry)
            self._images[key] = _Written(number, texture, clipped=clipped, rounded=rounded)
        return self._images[key]


class _Written(NamedTuple):
    """A texture as an image of the document."""

    number: int
    texture: Tensor  # kept, so that its id stays its own
    clipped: bool  # it has numbers above 1
    rounded: bool  # it has more than 8 bits


def downwards(transform: Tensor) -> dict[str, Any]:
    """KHR_texture_transform, for v down, of a map (2,3) for v up; a shear, which it does not know, is left out."""
    (a, b, x), (c, d, y) = transform.double().tolist()
    angle = math.atan2(c, a)
    cosine, sine = math.cos(angle), math.sin(angle)
    scale = [math.hypot(a, c), cosine * d - sine * b]
    return {"offset": [x - sine * scale[1], 1.0 - cosine * scale[1] - y], "rotation": angle, "scale": scale}


def _plain(values: Tensor) -> list[float]:
    return [float(v) for v in values.detach()]
