"""The colour that most pixels have."""

from __future__ import annotations

import pytest
import torch

from torchrender.errors import InputError, OptionError
from torchrender.photo.dominant import dominant_pixels, palette


def two_colors(count: int = 1000, share: float = 0.7) -> torch.Tensor:
    """A grey-green majority and a red minority, mixed, with a little noise."""
    generator = torch.Generator().manual_seed(3)
    first = torch.rand(count, generator=generator) < share
    lab = torch.where(first[:, None], torch.tensor([60.0, -10.0, 10.0]), torch.tensor([40.0, 50.0, 30.0]))
    return lab + 0.5 * torch.randn(count, 3, generator=generator)


def test_the_majority_colour_is_kept_and_with_one_seed_it_is_not() -> None:
    lab, truth = two_colors(), torch.tensor([60.0, -10.0, 10.0])
    assert float((lab[dominant_pixels(lab, 2)].mean(dim=0) - truth).norm()) < 1.0
    assert float((lab[dominant_pixels(lab, 4)].mean(dim=0) - truth).norm()) < 1.0
    assert float((lab[dominant_pixels(lab, 1)].mean(dim=0) - truth).norm()) > 10.0


def test_lists_that_cannot_be_clustered() -> None:
    assert bool(dominant_pixels(torch.full((100, 3), 50.0)).all())
    assert bool(dominant_pixels(torch.rand(3, 3), 4).all())
    assert dominant_pixels(torch.zeros(0, 3)).shape == (0,)


def test_palette() -> None:
    lab = two_colors().double()
    centres, label = palette(lab, 2)
    assert float((centres[0] - torch.tensor([60.0, -10.0, 10.0])).norm()) < 1.0
    assert 0.6 < float((label == 0).double().mean()) < 0.8
    assert len(palette(torch.full((50, 3), 7.0).double(), 5)[0]) == 1
    again = palette(lab, 2)
    assert bool((again[1] == label).all())


def test_wrong_use() -> None:
    with pytest.raises(OptionError, match="seeds"):
        dominant_pixels(torch.zeros(4, 3), 9)
    with pytest.raises(InputError, match="lab"):
        dominant_pixels(torch.zeros(4, 2))
