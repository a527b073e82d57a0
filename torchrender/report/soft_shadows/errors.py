"""Errors of light visibility against a reference, on the scale 0 to 255.

``E_vis = 255/N sum |A_k - T_k|`` counts every wrong light sample; in ``E_int = 255/N |sum (A_k - T_k)|`` samples
that are wrongly lit and wrongly dark cancel, as they do in the picture.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchrender.checks import check_tensor
from torchrender.effects.shadows.soft_shadow import LightVisibility, count_bits


def error_images(found: LightVisibility, reference: LightVisibility) -> tuple[Tensor, Tensor]:
    """``E_vis`` and signed ``E_int`` (too bright: positive), each (B,L,H,W) float32 in [-255, 255].

    Raises:
        InputError: visibilities of different pictures or lights.
    """
    check_tensor("reference.bits", reference.bits, tuple(found.bits.shape))
    scale = 255.0 / torch.tensor(found.sample_count, dtype=torch.float32)[:, None, None]
    return count_bits(found.bits ^ reference.bits) * scale, (found.lit - reference.lit) * scale


def mean_errors(found: LightVisibility, reference: LightVisibility, covered: Tensor) -> dict[str, float]:
    """Means and maxima over the pixels ``covered`` (B,H,W), their share, and the mean signed error."""
    vis, signed = (image.movedim(1, -1)[covered] for image in error_images(found, reference))
    if not vis.numel():
        return dict.fromkeys(("int", "int_max", "vis", "vis_max", "signed", "coverage"), 0.0)
    return {
        "int": float(signed.abs().mean()),
        "int_max": float(signed.abs().max()),
        "vis": float(vis.mean()),
        "vis_max": float(vis.max()),
        "signed": float(signed.mean()),
        "coverage": float(covered.float().mean()),
    }


def signed_picture(found: LightVisibility, reference: LightVisibility, covered: Tensor) -> Tensor:
    """(H,3W,3): reference, approximation and error of the first picture and light; green too bright, red too dark."""
    _, signed = error_images(found, reference)
    error = (signed[0, 0] / 64.0).clamp(-1.0, 1.0)
    grey = torch.where(covered[0], 1.0, 0.5)[..., None].expand(*covered.shape[1:], 3)
    pictures = [v.visibility[0, 0][..., None].square() * grey for v in (reference, found)]
    pictures.append(torch.stack([(-error).clamp_min(0), error.clamp_min(0), torch.zeros_like(error)], dim=-1))
    return torch.cat(pictures, dim=1)
