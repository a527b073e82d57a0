"""Surface materials: a diffuse part, and a specular part with a degree and a gloss.

``specular`` says how much of the light is mirrored (0 diffuse, 1 mirror) and ``gloss`` how wide the mirror lobe is
(0 perfect mirror, 1 widest), the two numbers that the reflection passes work with; ``shininess`` is the Phong exponent
that direct light uses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import torch
from torch import Tensor

from torchrender.checks import as_vector, check_range
from torchrender.errors import InputError

DIELECTRIC_F0 = 0.04


def _grey(value: float) -> Tensor:
    return torch.full((3,), value)


@dataclass(frozen=True, eq=False, kw_only=True)
class Material:
    """One material; colours are linear RGB.

    Raises:
        InputError: a colour that is not three finite numbers, a texture that is not (H,W,3) or (H,W,4).
        OptionError: specular, gloss, shininess or alpha_cutoff outside its range.
    """

    name: str = "material"
    diffuse: Tensor = field(default_factory=lambda: _grey(0.8))  # (3,) reflectance
    diffuse_texture: Tensor | None = None  # (H,W,3|4) linear float32 that multiplies diffuse; row 0 is the top, v = 1
    specular: float = 0.0  # specular degree in [0,1]: share of mirrored light at normal incidence
    specular_color: Tensor = field(default_factory=lambda: _grey(1.0))  # (3,) tint of the mirrored light
    gloss: float = 0.0  # lobe width in [0,1]: 0 mirror, 1 widest
    shininess: float = 32.0  # Phong exponent of direct highlights
    emission: Tensor = field(default_factory=lambda: _grey(0.0))  # (3,) radiance
    alpha_cutoff: float | None = None  # texels with less alpha are holes; None: opaque

    def __post_init__(self) -> None:
        for name in ("diffuse", "specular_color", "emission"):
            object.__setattr__(self, name, as_vector(f"material {self.name!r}: {name}", getattr(self, name)))
        for name, high in (("specular", 1.0), ("gloss", 1.0), ("shininess", 1e6)):
            check_range(f"material {self.name!r}: {name}", getattr(self, name), 0.0, high)
        if self.alpha_cutoff is not None:
            check_range(f"material {self.name!r}: alpha_cutoff", self.alpha_cutoff, 0.0, 1.0)
        texture = self.diffuse_texture
        if texture is not None and (texture.dim() != 3 or texture.shape[2] not in (3, 4) or texture.numel() == 0):
            raise InputError(
                f"material {self.name!r}: diffuse_texture must have shape (H, W, 3) or (H, W, 4),"
                f" got {tuple(texture.shape)}"
            )

    @property
    def is_reflector(self) -> bool:
        """True if reflection passes should run for it: it mirrors clearly more than bare plastic does."""
        return self.specular > 2 * DIELECTRIC_F0


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
