"""Error measures: closed forms, bounds and laws; and pictures that cannot be compared."""

from __future__ import annotations

import sys

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.numerics.color import linear_from_srgb
from torchrender.quality.metrics import (
    EQUAL_DB,
    coverage,
    flip,
    flip_map,
    mean_absolute_error,
    psnr,
    relative_squared_error,
)

MEASURES = (flip, psnr, relative_squared_error, mean_absolute_error)


def picture(count: int = 2, height: int = 9, width: int = 13, seed: int = 0) -> torch.Tensor:
    return torch.rand(count, height, width, 3, generator=torch.Generator().manual_seed(seed))


def marked(shape: tuple[int, ...], *places: tuple[int, int, int]) -> torch.Tensor:
    mask = torch.zeros(shape, dtype=torch.bool)
    for place in places:
        mask[place] = True
    return mask


def test_equal_pictures_have_no_error() -> None:
    image = picture()
    assert flip(image, image).tolist() == [0.0, 0.0]
    assert psnr(image, image).tolist() == [EQUAL_DB, EQUAL_DB]
    assert relative_squared_error(image, image).tolist() == [0.0, 0.0]
    assert mean_absolute_error(image, image).tolist() == [[0.0] * 3] * 2


def test_psnr_of_a_known_error() -> None:
    reference = torch.zeros(2, 4, 5, 3)
    image = torch.stack([torch.full((4, 5, 3), 0.1), torch.full((4, 5, 3), 0.01)])
    assert psnr(image, reference).tolist() == pytest.approx([20.0, 40.0])
    assert psnr(10 * image, 10 * reference, peak=10.0).tolist() == pytest.approx([20.0, 40.0])
    assert psnr(image[..., :1], reference[..., :1]).tolist() == pytest.approx([20.0, 40.0])


def test_relative_error_of_a_known_error() -> None:
    reference, image = torch.full((1, 3, 3, 3), 2.0), torch.full((1, 3, 3, 3), 2.2)
    assert float(relative_squared_error(image, reference)) == pytest.approx(0.04 / 4.01)
    # The same share of error counts the same at any brightness, as long as the floor is small beside it.
    bright = relative_squared_error(1e3 * image, 1e3 * reference)
    assert float(bright) == pytest.approx(0.01, rel=1e-5)
    assert float(relative_squared_error(image, 0 * reference, floor=1.0)) == pytest.approx(2.2**2)


def test_mean_absolute_error_by_channel() -> None:
    image = torch.zeros(1, 2, 2, 3)
    image[0, 0, 0] = torch.tensor([1.0, 0.0, -0.5])
    mask = marked((1, 2, 2), (0, 0, 0), (0, 0, 1))
    assert mean_absolute_error(image, torch.zeros_like(image), mask=mask).tolist() == [[0.5, 0.0, 0.25]]


def test_masks_choose_what_counts() -> None:
    reference = picture(1)
    image = reference.clone()
    image[0, 2, 3] = 1.0 - image[0, 2, 3]
    at, elsewhere = marked((1, 9, 13), (0, 2, 3)), ~marked((1, 9, 13), (0, 2, 3))
    for measure in (psnr, relative_squared_error, mean_absolute_error):
        assert torch.equal(measure(image, reference, mask=elsewhere), measure(reference, reference))
    error = float((image - reference)[0, 2, 3].double().square().mean())
    assert float(psnr(image, reference, mask=at)) == pytest.approx(-10 * torch.tensor(error).log10().item(), abs=1e-4)
    assert float(flip(image, reference, mask=at)) == float(flip_map(image, reference)[0, 2, 3])
    assert float(psnr(image, reference, mask=at & elsewhere)) == EQUAL_DB
    assert float(relative_squared_error(image, reference, mask=at & elsewhere)) == 0.0


def test_black_against_white_is_as_different_as_can_be() -> None:
    black, white = torch.zeros(1, 16, 16, 3), torch.ones(1, 16, 16, 3)
    assert 0.9 < float(flip(white, black)) <= 1.0
    assert torch.allclose(flip(white, black), flip(black, white), atol=1e-5)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 99), st.integers(0, 99), st.sampled_from([(1, 1), (1, 7), (5, 4)]))
def test_flip_is_a_number_between_zero_and_one_per_pixel(first: int, second: int, size: tuple[int, int]) -> None:
    a, b = (picture(2, *size, seed=s) for s in (first, second))
    found = flip_map(a, b)
    assert found.shape == (2, *size) and bool(((found >= 0) & (found <= 1)).all())
    assert torch.allclose(found, flip_map(b, a), atol=1e-5)
    assert torch.equal(found[1:], flip_map(a[1:], b[1:]))
    assert torch.allclose(flip(a, b), found.double().mean(dim=(1, 2)))


def test_flip_takes_linear_display_values() -> None:
    evaluator = pytest.importorskip("flip_evaluator")
    encoded = picture(2, 24, 20)
    wanted, _, _ = evaluator.evaluate(encoded[1].numpy(), encoded[0].numpy(), "LDR", applyMagma=False)
    found = flip_map(linear_from_srgb(encoded[:1]), linear_from_srgb(encoded[1:]))
    assert torch.allclose(found[0], torch.from_numpy(wanted).reshape(24, 20), atol=2e-3)


def test_flip_grows_with_the_error_and_falls_with_the_distance() -> None:
    reference = picture(1, 32, 32)
    noisy = [(reference + s * (picture(1, 32, 32, seed=1) - 0.5)).clamp(0, 1) for s in (0.05, 0.2, 0.8)]
    errors = [float(flip(n, reference)) for n in noisy]
    assert errors[0] < errors[1] < errors[2]
    near, far = (float(flip(noisy[1], reference, pixels_per_degree=p)) for p in (20.0, 200.0))
    assert far < near


def test_coverage() -> None:
    image = torch.zeros(2, 2, 5, 3)
    image[0, 0] = 0.5
    image[0, 1, 0, 2] = torch.nan
    image[0, 0, 1, 0] = torch.inf
    found = coverage(image)
    assert found.finite.tolist() == [0.8, 1.0]
    assert found.complete.tolist() == [0.8, 1.0]
    assert found.foreground.tolist() == [0.4, 0.0]
    valid = torch.ones(2, 2, 5, dtype=torch.bool)
    valid[:, 0, 0] = False
    surface = ~marked((2, 2, 5), (1, 1, 1))
    found = coverage(image, valid=valid, surface=surface)
    assert found.complete.tolist() == pytest.approx([0.7, 0.9])
    assert found.foreground.tolist() == pytest.approx([0.7, 0.8])


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_pictures_with_holes_in_their_numbers_are_refused(measure, value: float) -> None:
    bad = picture()
    bad[1, 2, 3, 0] = value
    with pytest.raises(InputError, match=r"image must be finite: 1 of 702"):
        measure(bad, picture())
    with pytest.raises(InputError, match="reference must be finite"):
        measure(picture(), bad)


def test_other_bad_input_is_named() -> None:
    image = picture()
    for measure in MEASURES:
        with pytest.raises(InputError, match="reference must have shape"):
            measure(image, image[:1])
        with pytest.raises(InputError, match="image must have shape"):
            measure(image[0], image[0])
        with pytest.raises(InputError, match="mask must have shape"):
            measure(image, image, mask=torch.ones(2, 9, 12, dtype=torch.bool))
        with pytest.raises(InputError, match="mask must be bool"):
            measure(image, image, mask=torch.ones(2, 9, 13))
    with pytest.raises(InputError, match=r"image must be in \[0, 1\], got"):
        flip(2 * image, image)
    with pytest.raises(OptionError, match="pixels_per_degree"):
        flip(image, image, pixels_per_degree=0.0)
    with pytest.raises(OptionError, match="peak"):
        psnr(image, image, peak=0.0)
    with pytest.raises(OptionError, match="floor"):
        relative_squared_error(image, image, floor=float("nan"))
    with pytest.raises(InputError, match="pixels"):
        coverage(torch.zeros(1, 0, 4, 3))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    with pytest.raises(OptionError, match="flip-evaluator"):
        flip(picture(), picture())


def test_no_pictures_no_numbers() -> None:
    none = torch.zeros(0, 4, 4, 3)
    assert all(len(measure(none, none)) == 0 for measure in MEASURES)
    assert len(coverage(none).finite) == 0
