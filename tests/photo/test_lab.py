"""Lab of linear light."""

from __future__ import annotations

import kornia
import pytest
import skimage.color
import torch

from torchrender.errors import InputError
from torchrender.numerics.color import srgb_from_linear
from torchrender.photo.lab import lab_from_linear, linear_from_lab

COLORS = torch.rand(500, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(2))


def test_it_is_what_libraries_make_of_the_encoded_picture() -> None:
    encoded = srgb_from_linear(COLORS)
    ours = lab_from_linear(COLORS)
    assert torch.allclose(ours, torch.from_numpy(skimage.color.rgb2lab(encoded.numpy())), atol=1e-6)
    theirs = kornia.color.rgb_to_lab(encoded.T.reshape(1, 3, 500, 1))[0, :, :, 0].T
    assert torch.allclose(ours, theirs, atol=1e-6)


def test_there_and_back() -> None:
    assert torch.allclose(linear_from_lab(lab_from_linear(COLORS)), COLORS, atol=1e-5)
    grey = lab_from_linear(torch.linspace(0, 1, 11, dtype=torch.float64)[:, None].expand(11, 3))
    assert float(grey[:, 1:].abs().max()) < 0.01 and float(grey[0, 0]) == pytest.approx(0, abs=1e-9)
    assert float(grey[-1, 0]) == pytest.approx(100, abs=1e-3)


def test_black_has_a_gradient() -> None:
    black = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    lab_from_linear(black).sum().backward()
    assert black.grad is not None and bool(torch.isfinite(black.grad).all())


@pytest.mark.parametrize("function", [lab_from_linear, linear_from_lab])
def test_wrong_shapes(function) -> None:
    with pytest.raises(InputError, match="must have shape"):
        function(torch.zeros(4, 2))
