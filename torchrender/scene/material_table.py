"""The numbers of all materials of a scene side by side, so that a pixel's are one look-up by its material's index."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from torchrender.scene.material import Material


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
    return any(c.requires_grad for m in materials for c in (m.diffuse, m.specular_color, m.emission))
