"""Photos in working size."""

from __future__ import annotations

import pytest
import torch

from torchrender.errors import InputError, OptionError
from torchrender.photo.photograph import MAX_PIXELS, PhotoWarning, prepare_photo


def test_grey_becomes_rgb_and_values_stay() -> None:
    photo = prepare_photo(torch.full((4, 6), 0.25))
    assert photo.pixels.shape == (4, 6, 3) and float(photo.pixels.max()) == 0.25


def test_hdr_is_exposed_both_ways() -> None:
    ramp = torch.linspace(0, 1, 1000).reshape(20, 50, 1).expand(20, 50, 3)
    for scale in (5.0, 300.0):
        bright = prepare_photo(ramp * scale).pixels
        assert float(bright.max()) == pytest.approx(0.9 / 0.98, rel=0.01)
    lamp = torch.full((100, 100, 3), 0.01)
    lamp[0, 0] = 50.0
    assert float(prepare_photo(lamp).pixels[50, 50, 0]) == pytest.approx(0.9, abs=0.01)


def test_large_photos_keep_their_mean_and_their_coordinates() -> None:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(1500, 2000, 3, generator=generator)
    image[:, :1000] *= 0.2
    photo = prepare_photo(image)
    assert photo.pixels.shape[0] * photo.pixels.shape[1] <= MAX_PIXELS
    assert torch.allclose(photo.pixels.mean(dim=(0, 1)), image.mean(dim=(0, 1)), atol=2e-3)
    assert float(photo.region((0, 0, 990, 1500)).mean()) == pytest.approx(0.1, abs=0.01)
    assert float(photo.region((1010, 0, 2000, 1500)).mean()) == pytest.approx(0.5, abs=0.01)


def test_transparency_is_laid_on_white() -> None:
    image = torch.zeros(10, 10, 4)
    image[:5, :, 3] = 1.0
    with pytest.warns(PhotoWarning, match="transparent"):
        photo = prepare_photo(image)
    assert float(photo.pixels[0, 0, 0]) == 0.0 and float(photo.pixels[9, 0, 0]) == 1.0
    with pytest.warns(PhotoWarning, match="wholly transparent"):
        photo = prepare_photo(torch.cat([torch.full((5, 5, 3), 0.3), torch.zeros(5, 5, 1)], dim=2))
    assert float(photo.pixels.mean()) == pytest.approx(0.3)


def test_crop_keeps_the_shape_of_things_and_stretch_does_not() -> None:
    image = torch.zeros(100, 400, 3)
    image[:, 150:250] = 1.0
    photo = prepare_photo(image)
    assert float(photo.laid_over(40, 40, "crop").mean()) == pytest.approx(1.0)
    assert float(photo.laid_over(40, 40).mean()) == pytest.approx(0.25, abs=0.01)
    with pytest.raises(OptionError, match="place"):
        photo.laid_over(4, 4, "tile")


@pytest.mark.parametrize(
    ("image", "text"),
    [
        (torch.zeros(0, 4, 3), "shape"),
        (torch.zeros(4, 4, 5), "shape"),
        (torch.zeros(4, 4, 3, dtype=torch.uint8), "floating-point"),
        (torch.full((4, 4, 3), float("nan")), "finite"),
        ("photo.png", "floating-point"),
    ],
)
def test_what_is_no_photo(image, text) -> None:
    with pytest.raises(InputError, match=text):
        prepare_photo(image)


@pytest.mark.parametrize("box", [(0, 0, 0, 4), (0, 0, 9, 4), (-1, 0, 4, 4), (0, 0, 4), (0, 0, float("nan"), 4)])
def test_regions_outside(box) -> None:
    with pytest.raises(InputError, match="region"):
        prepare_photo(torch.zeros(8, 8, 3)).region(box)
