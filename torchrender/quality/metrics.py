"""How far pictures are from their references: FLIP, PSNR, relative squared error, and how complete they are.

All take B pictures and give B numbers. Masks choose the pixels that count; where none does, nothing is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_finite, check_range, check_tensor
from torchrender.errors import InputError, OptionError

PIXELS_PER_DEGREE = 67.0
"""Of visual angle: a 0.7 m wide 4K monitor seen from 0.7 m, the usual condition for FLIP."""

EQUAL_DB = 120.0
"""PSNR of equal pictures, and of all that are closer than this: reports stay finite."""


def flip_map(image: Tensor, reference: Tensor, *, pixels_per_degree: float = PIXELS_PER_DEGREE) -> Tensor:
    """Difference (B,H,W) in [0,1] that an observer sees when two pictures alternate (LDR-FLIP).

    Source: Andersson et al., *FLIP: A difference evaluator for alternating images*, 2020; computed by the authors' own
    package.

    Args:
        image, reference: (B,H,W,3) linear display values in [0,1], as :meth:`torchrender.image.Image.displayed` gives.
        pixels_per_degree: of visual angle.

    Raises:
        InputError: other shapes; values that are not finite or outside [0,1].
        OptionError: ``pixels_per_degree`` outside [1, 1000], or flip-evaluator is not installed.
    """
    _check_pair(image, reference, 3)
    check_range("pixels_per_degree", pixels_per_degree, 1.0, 1000.0)
    for name, value in (("image", image), ("reference", reference)):
        if value.numel() and not 0.0 <= float(value.min()) <= float(value.max()) <= 1.0:
            raise InputError(f"{name} must be in [0, 1], got {float(value.min()):g} to {float(value.max()):g}")
    evaluator = _evaluator()
    pairs = (image.detach().float().contiguous().numpy(), reference.detach().float().contiguous().numpy())
    found = np.zeros(image.shape[:3], np.float32)
    for number in range(len(image)):
        made, _, _ = evaluator.evaluate(
            pairs[1][number], pairs[0][number], "LDR", inputsRGB=False, applyMagma=False, computeMeanError=False,
            parameters={"ppd": float(pixels_per_degree)},
        )  # fmt: skip
        found[number] = np.asarray(made).reshape(found.shape[1:])
    return torch.from_numpy(found)


def flip(
    image: Tensor, reference: Tensor, *, mask: Tensor | None = None, pixels_per_degree: float = PIXELS_PER_DEGREE
) -> Tensor:
    """Mean (B,) float64 of :func:`flip_map` over the pixels in ``mask`` (B,H,W); 0 equal, 1 as different as can be."""
    return _mean(flip_map(image, reference, pixels_per_degree=pixels_per_degree), mask)


def psnr(image: Tensor, reference: Tensor, *, mask: Tensor | None = None, peak: float = 1.0) -> Tensor:
    """Peak signal-to-noise ratio (B,) float64 in dB, ``10 log10(peak^2 / mean squared error)``; 120 at most.

    Args:
        image, reference: (B,H,W,C) values up to ``peak``.
        mask: (B,H,W) bool: pixels that count; None: all.

    Raises:
        InputError: other shapes, values that are not finite. OptionError: ``peak`` not positive.
    """
    _check_pair(image, reference)
    check_range("peak", peak, 1e-30)
    error = _mean((image.double() - reference.double()).square().mean(dim=-1), mask) / peak**2
    return -10.0 * torch.log10(error.clamp_min(10.0 ** (-EQUAL_DB / 10.0)))


def relative_squared_error(
    image: Tensor, reference: Tensor, *, mask: Tensor | None = None, floor: float = 1e-2
) -> Tensor:
    """Mean (B,) float64 of ``(image - reference)^2 / (reference^2 + floor)``: errors in the dark count as in the light.

    Args:
        image, reference: (B,H,W,C), of any range: radiance, for instance.
        mask: (B,H,W) bool: pixels that count; None: all.
        floor: keeps black pixels from deciding alone.

    Raises:
        InputError: other shapes, values that are not finite. OptionError: ``floor`` not positive.
    """
    _check_pair(image, reference)
    check_range("floor", floor, 1e-30)
    truth = reference.double()
    return _mean(((image.double() - truth).square() / (truth.square() + floor)).mean(dim=-1), mask)


def mean_absolute_error(image: Tensor, reference: Tensor, *, mask: Tensor | None = None) -> Tensor:
    """Mean (B,C) float64 of ``|image - reference|`` per channel of (B,H,W,C) over the pixels in ``mask`` (B,H,W)."""
    _check_pair(image, reference)
    error = (image.double() - reference.double()).abs()
    return torch.stack([_mean(error[..., channel], mask) for channel in range(error.shape[-1])], dim=-1)


@dataclass(frozen=True, eq=False)
class Coverage:
    """Shares (B,) float64 of the pixels of B pictures."""

    finite: Tensor  # no channel is NaN or infinite
    complete: Tensor  # finite and valid: the picture has an answer there
    foreground: Tensor  # complete and a surface, not background


def coverage(image: Tensor, *, valid: Tensor | None = None, surface: Tensor | None = None) -> Coverage:
    """How complete pictures (B,H,W,C) are.

    Args:
        valid: (B,H,W) bool: pixels that somebody answered for; None: all.
        surface: (B,H,W) bool: pixels that show a surface; None: those with a channel above zero.

    Raises:
        InputError: other shapes, or no pixels at all.
    """
    check_tensor("image", image, ("B", "H", "W", "C"))
    if not image[:1].numel() and len(image):
        raise InputError(f"image must have pixels, got shape {tuple(image.shape)}")
    finite = torch.isfinite(image).all(dim=-1)
    complete = finite if valid is None else finite & _check_mask("valid", valid, image)
    shown = (image > 0).any(dim=-1) if surface is None else _check_mask("surface", surface, image)
    shares = (part.double().mean(dim=(1, 2)) for part in (finite, complete, complete & shown))
    return Coverage(*shares)


def _check_pair(image: Tensor, reference: Tensor, channels: int | str = "C") -> None:
    check_tensor("image", image, ("B", "H", "W", channels))
    check_tensor("reference", reference, tuple(image.shape))
    check_finite("image", image)
    check_finite("reference", reference)


def _check_mask(name: str, mask: Tensor, image: Tensor) -> Tensor:
    if check_tensor(name, mask, tuple(image.shape[:3])).dtype != torch.bool:
        raise InputError(f"{name} must be bool, got {mask.dtype}")
    return mask


def _mean(error: Tensor, mask: Tensor | None) -> Tensor:
    """Means (B,) over the pixels of (B,H,W) that count; 0 where there are none."""
    chosen = torch.ones_like(error, dtype=torch.bool) if mask is None else _check_mask("mask", mask, error)
    total = torch.where(chosen, error.double(), 0.0).sum(dim=(1, 2))
    return total / chosen.sum(dim=(1, 2)).clamp_min(1)


def _evaluator() -> Any:
    try:
        import flip_evaluator
    except ImportError as error:
        raise OptionError("FLIP needs the flip-evaluator package, which is not installed") from error
    return flip_evaluator
