"""The numbers of all materials of a scene side by side, so that a pixel's are one look-up by its material's index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.brief import brief
from torchrender.numerics.ggx import refraction
from torchrender.scene.material import Material

KINDS = ("phong", "metallic-roughness", "unlit")
"""How the light of a material is computed, in the order of :attr:`PhysicalTable.kind`."""


@dataclass(frozen=True, eq=False)
class PhysicalTable:
    """Numbers that textures multiply, M + 1 rows; neutral for Phong materials."""

    kind: Tensor  # (M+1,) int64 place in KINDS
    metallic: Tensor  # (M+1,)
    roughness: Tensor  # (M+1,)
    dielectric: Tensor  # (M+1,) reflectance at normal incidence that the index of refraction gives
    weight: Tensor  # (M+1,) of what the dielectric part mirrors
    slowed: Tensor  # (M+1,) squared index of refraction less one
    excess: Tensor  # (M+1,2) of :class:`torchrender.numerics.ggx.Refraction`
    tint: Tensor  # (M+1,3) of what the dielectric part mirrors, or of a Phong material's mirrored light
    clearcoat: Tensor  # (M+1,2) strength and roughness
    sheen: Tensor  # (M+1,3)
    sheen_roughness: Tensor  # (M+1,)
    transmission: Tensor  # (M+1,)
    opacity: Tensor  # (M+1,)
    normal_scale: Tensor  # (M+1,)
    occlusion_strength: Tensor  # (M+1,)

    @classmethod
    def of(cls, materials: Sequence[Material]) -> PhysicalTable:
        """The table of these materials, in their order."""

        def numbers(name: str, empty: float = 0.0) -> Tensor:
            return torch.tensor([*(float(getattr(m, name)) for m in materials), empty])

        def colors(name: str) -> Tensor:
            return torch.stack([*(getattr(m, name) for m in materials), torch.zeros(3)])

        bent = [*(refraction(float(m.ior)) for m in materials), refraction(1.5)]
        kinds = [2 if m.unlit else int(m.is_physical) for m in materials]
        return cls(
            kind=torch.tensor([*kinds, 0]),
            metallic=torch.tensor([*(m.metallic or 0.0 for m in materials), 0.0]),
            roughness=numbers("roughness"),
            dielectric=torch.tensor([one.reflectance for one in bent]),
            weight=numbers("specular_weight") * torch.tensor([one.share for one in bent]),
            slowed=torch.tensor([one.slowed for one in bent]),
            excess=torch.tensor([one.excess for one in bent]),
            tint=colors("specular_color"),
            clearcoat=torch.stack([numbers("clearcoat"), numbers("clearcoat_roughness")], dim=1),
            sheen=colors("sheen_color"),
            sheen_roughness=numbers("sheen_roughness"),
            transmission=numbers("transmission"),
            opacity=numbers("opacity", 1.0),
            normal_scale=numbers("normal_scale", 1.0),
            occlusion_strength=numbers("occlusion_strength", 1.0),
        )


@dataclass(frozen=True, eq=False)
class MaterialTable:
    """M materials; one more row, the last, is what index -1 (an empty pixel) finds: black, and no reflector.

    Differentiable in the materials' colours.
    """

    diffuse: Tensor  # (M+1,3) reflectance
    specular: Tensor  # (M+1,) degree
    tint: Tensor  # (M+1,3) of mirrored light
    shininess: Tensor  # (M+1,) Phong exponent
    emission: Tensor  # (M+1,3) radiance
    gloss: Tensor  # (M+1,) float64 lobe width
    is_reflector: Tensor  # (M+1,) bool: reflection passes run for it
    mirrored: Tensor  # (M+1,) specular degree of reflectors, 0 for all others
    physical: PhysicalTable  # what metallic-roughness materials have beside it
    has_physical: bool  # some material is a metallic-roughness one

    __repr__ = brief

    @classmethod
    def of(cls, materials: Sequence[Material]) -> MaterialTable:
        """The table of these materials, in their order."""
        black = torch.zeros(3)
        degree, tint = zip(*(_mirrored(m) for m in materials)) if materials else ((), ())
        return cls(
            diffuse=torch.stack([*(m.diffuse for m in materials), black]),
            specular=torch.stack([*degree, torch.zeros(())]),
            tint=torch.stack([*tint, black]),
            shininess=torch.tensor([*(m.shininess for m in materials), 0.0]),
            emission=torch.stack([*(m.emission for m in materials), black]),
            gloss=torch.tensor([*(m.lobe for m in materials), 0.0], dtype=torch.float64),
            is_reflector=torch.tensor([*(m.is_reflector for m in materials), False]),
            mirrored=torch.tensor([*(float(d) if m.is_reflector else 0.0 for m, d in zip(materials, degree)), 0.0]),
            physical=PhysicalTable.of(materials),
            has_physical=any(m.is_physical for m in materials),
        )

    @property
    def highlight(self) -> Tensor:
        """(M+1,3) colour of direct highlights: degree times tint."""
        return self.specular[:, None] * self.tint


def _mirrored(material: Material) -> tuple[Tensor, Tensor]:
    """Degree () and tint (3,) of the mirrored light."""
    if not material.is_physical:
        return torch.tensor(material.specular), material.specular_color
    color = material.mirror_color
    degree = color.detach().max()
    return degree, color / degree.clamp_min(1e-6)


def wants_gradient(materials: Sequence[Material]) -> bool:
    """Whether a colour of these materials is a variable of a derivative."""
    if not torch.is_grad_enabled():
        return False
    return any(c.requires_grad for m in materials for c in (m.diffuse, m.specular_color, m.emission, m.sheen_color))
