"""From linear radiance to linear display values in [0, 1]: exposure and tone-mapping operators.

The sRGB transfer curve is applied later, where a picture is written.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchrender.checks import check_choice, check_range
from torchrender.errors import InputError
from torchrender.numerics.color import luminance

OPERATORS = ("none", "reinhard", "aces")

# S. Hill's fit of the ACES reference rendering and sRGB output transform (BakingLab, ACES.hlsl, MIT licence):
# sRGB to the rendering space, a rational curve per channel, and back.
_ACES_IN = ((0.59719, 0.35458, 0.04823), (0.07600, 0.90834, 0.01566), (0.02840, 0.13383, 0.83777))
_ACES_OUT = ((1.60475, -0.53108, -0.07367), (-0.10208, 1.10813, -0.00605), (-0.00327, -0.07276, 1.07602))


def auto_exposure(radiance: Tensor, *, key: float = 0.18, mask: Tensor | None = None) -> float:
    """Exposure in EV (powers of two) that brings the log-average luminance of ``radiance`` (...,3) to ``key``.

    Only pixels in ``mask`` (...) with some light count; 0 if there are none. Reinhard et al., *Photographic tone
    reproduction for digital images*, 2002, equation 1, without its offset for black pixels.
    """
    check_range("key", key, 1e-6)
    light = luminance(radiance.detach().double())
    usable = (light > 0) & torch.isfinite(light)
    if mask is not None:
        usable &= mask
    if not bool(usable.any()):
        return 0.0
    return math.log2(key) - float(torch.log2(light[usable]).mean())


def tone_map(radiance: Tensor, operator: str = "none", *, exposure: float = 0.0, white: float = 4.0) -> Tensor:
    """Display values in [0, 1], linear, of radiance (...,3) scaled by ``2^exposure``.

    - ``"none"`` clips.
    - ``"reinhard"`` is the extended operator on luminance, ``L (1 + L/white^2) / (1 + L)``, which keeps the hue;
      luminance ``white`` becomes 1 (Reinhard et al. 2002, equation 4).
    - ``"aces"`` is S. Hill's fit of the ACES sRGB output transform.

    NaN and negative values count as black.

    Raises:
        InputError: the last dimension is not 3.
        OptionError: an operator that does not exist, an exposure outside [-64, 64], ``white`` not positive.
    """
    if radiance.shape[-1:] != (3,):
        raise InputError(f"radiance must have shape (..., 3), got {tuple(radiance.shape)}")
    check_choice("operator", operator, OPERATORS)
    check_range("exposure", exposure, -64.0, 64.0)
    check_range("white", white, 1e-6)
    # The upper limit keeps squares finite in float32; all operators have long reached 1 there.
    color = (radiance.nan_to_num(0.0) * 2.0**exposure).clamp(0.0, 1e15)
    if operator == "reinhard":
        light = luminance(color)[..., None]
        color = color * ((1.0 + light / white**2) / (1.0 + light))
    elif operator == "aces":
        color = color @ torch.tensor(_ACES_IN, dtype=color.dtype).T
        curve = (color * (color + 0.0245786) - 0.000090537) / (color * (0.983729 * color + 0.4329510) + 0.238081)
        color = curve @ torch.tensor(_ACES_OUT, dtype=color.dtype).T
    return color.clamp(0.0, 1.0)
