"""Surface materials: Phong's, or metallic-roughness with a GGX lobe, with textures for what varies over the surface.

A material with ``metallic`` set is a metallic-roughness one (glTF 2.0); without it a Phong one, as the older
specifications name it: ``specular`` says how much of the light is mirrored (0 diffuse, 1 mirror), ``gloss`` how wide
the mirror lobe is (0 perfect mirror, 1 widest), and ``shininess`` is the exponent that direct light uses.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import torch
from torch import Tensor
from torch.utils.weak import WeakTensorKeyDictionary

from torchrender.brief import brief
from torchrender.checks import (
    as_vector,
    check_choice,
    check_finite,
    check_flag,
    check_name,
    check_not_negative,
    check_picture,
    check_range,
)
from torchrender.errors import InputError, OptionError
from torchrender.numerics.texels.coded import codes_of, state_of

DIELECTRIC_F0 = 0.04

_CHECKED: WeakTensorKeyDictionary = WeakTensorKeyDictionary()
"""Versions of textures, float32, whose numbers are known to be right: materials are made anew with what they have."""

WRAPS = ("repeat", "mirror", "clamp")
FILTERS = ("trilinear", "bilinear", "nearest")

TEXTURES: Mapping[str, tuple[int, ...]] = {
    "diffuse_texture": (3, 4),
    "emission_texture": (3, 4),
    "metallic_roughness_texture": (3, 4),
    "specular_texture": (3, 4),
    "normal_texture": (3, 4),
    "occlusion_texture": (1, 3, 4),
    "clearcoat_texture": (3, 4),
    "transmission_texture": (1, 3, 4),
}
"""Fields of :class:`Material` that hold a picture, and how many channels it may have."""

UNIT = (
    *("specular", "gloss", "opacity", "occlusion_strength", "roughness", "specular_weight", "transmission"),
    *("clearcoat", "clearcoat_roughness", "sheen_roughness"),
)
"""Numbers of a material that lie in [0, 1]."""

PHYSICAL: Mapping[str, float] = {
    "roughness": 1.0,
    "ior": 1.5,
    "specular_weight": 1.0,
    "clearcoat": 0.0,
    "clearcoat_roughness": 0.0,
    "sheen_color": 0.0,
    "sheen_roughness": 0.0,
    "transmission": 0.0,
}
"""Numbers that only a metallic-roughness material has, with their defaults."""

PHONG: Mapping[str, tuple[float, str]] = {
    "specular": (0.0, "specular_weight or ior"),
    "gloss": (0.0, "roughness"),
    "shininess": (32.0, "roughness"),
}
"""Numbers that only a Phong material has, with their defaults and what stands for them in metallic-roughness."""

FIXED = (
    *(name for name in PHYSICAL if name != "sheen_color"),
    *("metallic", "opacity", "alpha_cutoff", "specular", "gloss", "shininess", "normal_scale", "occlusion_strength"),
)
"""Numbers that decide how a material is drawn, and that pictures give no gradient to."""

PHYSICAL_TEXTURES = ("metallic_roughness_texture", "clearcoat_texture", "transmission_texture")


def _identity() -> Tensor:
    return torch.tensor([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, eq=False, kw_only=True)
class Sampler:
    """The way from a surface's texture coordinates to a texel.

    Raises:
        InputError: a transform that is not six finite numbers (2,3), a negative set.
        OptionError: an unknown wrap or filter.
    """

    uv_set: int = 0  # 0: Mesh.uv, 1: Mesh.uv1
    transform: Tensor = field(default_factory=_identity)  # (2,3) texture uv = transform @ (u, v, 1), v up
    wrap_u: str = "repeat"  # one of WRAPS: what lies left and right of [0, 1]
    wrap_v: str = "repeat"
    filter: str = "trilinear"  # one of FILTERS: between texels, and between levels where the picture is coarser

    def __post_init__(self) -> None:
        if self.uv_set not in (0, 1):
            raise InputError(f"uv_set must be 0 or 1, got {self.uv_set!r}")
        transform = torch.as_tensor(self.transform, dtype=torch.float32)
        if transform.shape != (2, 3):
            raise InputError(f"transform must have shape (2, 3), got {tuple(transform.shape)}")
        check_finite("transform", transform)
        object.__setattr__(self, "transform", transform)
        check_choice("wrap_u", self.wrap_u, WRAPS)
        check_choice("wrap_v", self.wrap_v, WRAPS)
        check_choice("filter", self.filter, FILTERS)


PLAIN = Sampler()
"""The first set as it is, repeated, trilinear."""


def _grey(value: float) -> Tensor:
    return torch.full((3,), value)


@dataclass(frozen=True, eq=False, kw_only=True)
class Material:
    """One material; colours are linear RGB. A texture multiplies the number of its name.

    A material is of the colour of its texture where only that is given: ``diffuse`` is then 1.
    Textures of files with 8 bits a channel keep these codes, and make their numbers when somebody asks for them.

    Raises:
        InputError: a colour that is not three finite numbers of zero or more, a texture of a wrong shape or with values
            that are not finite or negative, a sampler for a texture that does not exist.
        OptionError: a number outside its range, one of metallic-roughness on a Phong material, or the reverse; a flag
            that is neither True nor False.
    """

    name: str = "material"
    diffuse: Tensor = None  # type: ignore[assignment]  # (3,) reflectance, or base colour; 0.8, with a texture 1
    diffuse_texture: Tensor | None = None  # (H,W,3|4) linear float32 that multiplies diffuse; row 0 is the top, v = 1
    emission: Tensor = field(default_factory=lambda: _grey(0.0))  # (3,) radiance
    emission_texture: Tensor | None = None  # (H,W,3|4) linear
    normal_texture: Tensor | None = None  # (H,W,3|4) tangent-space normal as (n + 1) / 2, y up as in glTF
    normal_scale: float = 1.0  # multiplies x and y of the normal texture
    occlusion_texture: Tensor | None = None  # (H,W,1|3|4) share of ambient light in the first channel
    occlusion_strength: float = 1.0  # 0: the occlusion texture does nothing
    unlit: bool = False  # shows diffuse and its texture as they are, whatever the light
    double_sided: bool = True  # False: pictures show the front only; mirrors, shadows and depth images have both

    # holes and transparency
    opacity: float = 1.0  # multiplies the alpha of diffuse_texture and of vertex colours, for blend or alpha_cutoff
    alpha_cutoff: float | None = None  # less alpha is a hole; None: no holes
    blend: bool = False  # what lies behind shows through by 1 - alpha; excludes alpha_cutoff

    # Phong
    specular: float = 0.0  # specular degree in [0,1]: share of mirrored light at normal incidence
    specular_color: Tensor = field(default_factory=lambda: _grey(1.0))  # (3,) tint of mirrored light, of both models
    specular_texture: Tensor | None = None  # (H,W,3|4): tint; alpha: degree, or weight with metallic
    gloss: float = 0.0  # lobe width in [0,1]: 0 mirror, 1 widest
    shininess: float = 32.0  # Phong exponent of direct highlights

    # metallic-roughness
    metallic: float | None = None  # 0 dielectric, 1 metal; None: a Phong material
    roughness: float = 1.0  # square root of the GGX alpha
    metallic_roughness_texture: Tensor | None = None  # (H,W,3|4) roughness in the second, metallic in the third channel
    ior: float = 1.5  # index of refraction of the dielectric part
    specular_weight: float = 1.0  # multiplies what the dielectric part mirrors
    clearcoat: float = 0.0  # strength of a clear layer on top
    clearcoat_roughness: float = 0.0
    clearcoat_texture: Tensor | None = None  # (H,W,3|4) strength in the first, roughness in the second channel
    sheen_color: Tensor = field(default_factory=lambda: _grey(0.0))  # (3,)
    sheen_roughness: float = 0.0
    transmission: float = 0.0  # share of the light that passes a thin wall instead of being reflected diffusely
    transmission_texture: Tensor | None = None  # (H,W,1|3|4) share in the first channel

    samplers: Mapping[str, Sampler] = field(default_factory=dict)  # by texture field; those left out are PLAIN

    __repr__ = brief

    def __post_init__(self) -> None:
        check_name("name of a material", self.name)
        if self.diffuse is None:
            object.__setattr__(self, "diffuse", _grey(0.8 if self.diffuse_texture is None else 1.0))
        for name in ("diffuse", "specular_color", "emission", "sheen_color"):
            told = f"material {self.name!r}: {name}"
            object.__setattr__(self, name, check_not_negative(told, as_vector(told, getattr(self, name))))
        for name in ("unlit", "double_sided", "blend"):
            check_flag(f"material {self.name!r}: {name}", getattr(self, name))
        for name in UNIT:
            self._check(name, 0.0, 1.0)
        self._check("shininess", 0.0, 1e6)
        self._check("ior", 1.0, 100.0)
        self._check("normal_scale", -100.0, 100.0)
        for name in ("alpha_cutoff", "metallic"):
            if getattr(self, name) is not None:
                self._check(name, 0.0, 1.0)
        for name, channels in TEXTURES.items():
            self._check_texture(name, channels)
        self._check_model()

    def _check(self, name: str, low: float, high: float) -> None:
        check_range(f"material {self.name!r}: {name}", getattr(self, name), low, high)

    def _check_texture(self, name: str, channels: tuple[int, ...]) -> None:
        texture = getattr(self, name)
        if texture is None:
            return
        told = f"material {self.name!r}: {name}"
        texture = check_picture(told, texture, channels)
        if _is_checked(texture):
            return
        checked = check_not_negative(told, check_finite(told, texture.float()))
        _CHECKED[checked] = state_of(checked)
        object.__setattr__(self, name, checked)

    def check_numbers(self) -> None:
        """Look again at textures that were changed in place, which may be below zero while something is fitted.

        Raises:
            InputError: one holds what is not finite; names it.
        """
        for name in TEXTURES:
            texture = getattr(self, name)
            if texture is not None and not _is_checked(texture):
                check_finite(f"material {self.name!r}: {name}", texture.detach())
                _CHECKED[texture] = state_of(texture)

    def _check_model(self) -> None:
        if self.blend and self.alpha_cutoff is not None:
            raise OptionError(f"material {self.name!r}: blend and alpha_cutoff exclude each other")
        for name in self.samplers:
            if name not in TEXTURES or getattr(self, name) is None:
                raise InputError(f"material {self.name!r}: samplers name {name!r}, which is no texture of it")
        if self.metallic is not None:
            for name, (usual, instead) in PHONG.items():
                if not _equals(getattr(self, name), usual):
                    told = f"{name} is of Phong materials, this one is of metallic-roughness: give {instead}"
                    raise OptionError(f"material {self.name!r}: {told}")
            return
        given = [name for name, default in PHYSICAL.items() if not _equals(getattr(self, name), default)]
        given += [name for name in PHYSICAL_TEXTURES if getattr(self, name) is not None]
        if given:
            raise OptionError(f"material {self.name!r}: {given[0]} needs metallic, which this Phong material has not")

    def sampler(self, texture: str) -> Sampler:
        """How the texture of that field lies on the surface."""
        return self.samplers.get(texture, PLAIN)

    @property
    def is_physical(self) -> bool:
        """True for metallic-roughness, False for Phong."""
        return self.metallic is not None

    @property
    def is_see_through(self) -> bool:
        """True if what lies behind may show: blended by alpha, or a thin wall that lets light pass."""
        return self.blend or (self.transmission > 0.0 and not self.unlit)

    @property
    def f0(self) -> float:
        """Reflectance of the dielectric part at normal incidence, 0.04 for an index of refraction of 1.5."""
        return self.specular_weight * ((self.ior - 1.0) / (self.ior + 1.0)) ** 2

    @property
    def mirror_color(self) -> Tensor:
        """(3,) share of mirrored light at normal incidence, textures left out."""
        if self.metallic is None:
            return self.specular * self.specular_color
        dielectric = self.f0 * self.specular_color
        return torch.lerp(dielectric, self.diffuse, self.metallic)

    @property
    def lobe(self) -> float:
        """Width of the mirror lobe in [0,1]: gloss of Phong, else roughness."""
        return self.gloss if self.metallic is None else self.roughness

    @property
    def is_reflector(self) -> bool:
        """True if reflection passes should run for it: it mirrors clearly more than bare plastic does."""
        return not self.unlit and float(self.mirror_color.detach().max()) > 2 * DIELECTRIC_F0


def _is_checked(texture: Tensor) -> bool:
    """Codes are shares of one."""
    return codes_of(texture) is not None or bool(_CHECKED.get(texture) == state_of(texture))


def _equals(value: Tensor | float, default: float) -> bool:
    return bool((value == default).all()) if isinstance(value, Tensor) else value == default


def from_metallic_roughness(
    *,
    name: str = "material",
    base_color: Tensor,
    metallic: float,
    roughness: float,
    texture: Tensor | None = None,
    emission: Tensor | None = None,
    alpha_cutoff: float | None = None,
) -> Material:
    """Map glTF 2.0 metallic-roughness to diffuse, specular degree, gloss and Phong exponent.

    The specular degree is the normal reflectance ``0.04 (1 - m) + m``; the gloss is the roughness; the exponent is a
    quarter of ``2/alpha^2 - 2`` with ``alpha = roughness^2``: the Blinn-Phong lobe that is as wide as the GGX one has
    the whole, the Phong lobe about the mirrored direction a quarter.
    """
    alpha = max(roughness, 0.02) ** 2
    tint = base_color.float()[:3]
    return Material(
        name=name,
        diffuse=tint * (1.0 - metallic),
        diffuse_texture=texture,
        specular=DIELECTRIC_F0 * (1.0 - metallic) + metallic * float(tint.clamp(0, 1).max()),
        specular_color=torch.lerp(torch.ones(3), tint / tint.max().clamp_min(1e-6), metallic),
        gloss=min(max(roughness, 0.0), 1.0),
        shininess=min(max((2.0 / alpha**2 - 2.0) / 4.0, 1.0), 1e6) if math.isfinite(alpha) else 1.0,
        emission=torch.zeros(3) if emission is None else emission,
        alpha_cutoff=alpha_cutoff,
    )
