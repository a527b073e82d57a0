"""Laws of tone mapping: monotone, bounded, grey stays grey, exposure composes."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError, OptionError
from torchrender.numerics.color import luminance
from torchrender.numerics.tonemap import OPERATORS, auto_exposure, tone_map


@pytest.mark.parametrize("operator", OPERATORS)
def test_grey_ramp_is_monotone_bounded_and_grey(operator: str) -> None:
    ramp = torch.cat([torch.zeros(1), torch.logspace(-5, 6, 500)])
    value = tone_map(ramp[:, None].expand(-1, 3), operator)
    assert bool((value[1:] >= value[:-1] - 1e-6).all())
    assert float(value.min()) >= 0.0 and float(value.max()) == pytest.approx(1.0, abs=5e-3)
    assert float((value - value.mean(1, keepdim=True)).abs().max()) < 2e-3
    assert float(value[0].max()) < 1e-3


@pytest.mark.parametrize("operator", OPERATORS)
def test_exposure_is_a_factor_of_two_to_the_ev(operator: str) -> None:
    picture = torch.rand(5, 7, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(tone_map(picture, operator, exposure=1.5), tone_map(picture * 2**1.5, operator))


def test_none_leaves_what_fits_unchanged() -> None:
    picture = torch.rand(4, 3, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(tone_map(picture), picture)


def test_reinhard_keeps_hue_and_maps_white_to_one() -> None:
    color = torch.tensor([0.2, 0.1, 0.05])
    value = tone_map(color, "reinhard")
    torch.testing.assert_close(value / value[0], color / color[0])
    light = float(luminance(color))
    assert float(luminance(value)) == pytest.approx(light * (1 + light / 16) / (1 + light), rel=1e-5)
    torch.testing.assert_close(tone_map(torch.full((3,), 4.0), "reinhard"), torch.ones(3))


def test_aces_at_known_points() -> None:
    # The rational curve at 0.18 by hand; for greys both matrices are close to the identity (rows sum to one).
    x = 0.18
    expected = (x * (x + 0.0245786) - 0.000090537) / (x * (0.983729 * x + 0.4329510) + 0.238081)
    assert float(tone_map(torch.full((3,), x), "aces")[1]) == pytest.approx(expected, abs=2e-3)


def test_extreme_values_never_give_nan() -> None:
    values = torch.tensor([0.0, -1.0, 1e-38, 1e38, math.inf, -math.inf, math.nan])
    picture = torch.stack(torch.meshgrid(values, values, values, indexing="ij"), -1)
    for operator in OPERATORS:
        for exposure in (-64.0, 0.0, 64.0):
            value = tone_map(picture, operator, exposure=exposure)
            assert bool(((value >= 0) & (value <= 1)).all())


def test_auto_exposure_brings_the_log_mean_to_the_key() -> None:
    picture = torch.exp(torch.randn(40, 50, 3, generator=torch.Generator().manual_seed(2)))
    exposed = luminance(picture.double() * 2 ** auto_exposure(picture))
    assert float(exposed.log().mean().exp()) == pytest.approx(0.18, rel=1e-6)
    assert auto_exposure(picture * 8) == pytest.approx(auto_exposure(picture) - 3)


def test_auto_exposure_ignores_black_and_masked_pixels() -> None:
    picture = torch.zeros(4, 4, 3)
    assert auto_exposure(picture) == 0.0
    picture[0] = 0.18
    assert auto_exposure(picture) == pytest.approx(0.0, abs=1e-6)
    picture[1] = 1000.0
    mask = torch.ones(4, 4, dtype=torch.bool)
    mask[1] = False
    assert auto_exposure(picture, mask=mask) == pytest.approx(0.0, abs=1e-6)


def test_errors_name_the_argument() -> None:
    with pytest.raises(OptionError, match="operator must be one of none, reinhard, aces"):
        tone_map(torch.zeros(3), "filmic")
    with pytest.raises(OptionError, match="exposure"):
        tone_map(torch.zeros(3), exposure=math.nan)
    with pytest.raises(InputError, match="radiance"):
        tone_map(torch.zeros(3, 4))


@pytest.mark.parametrize("operator", OPERATORS)
@settings(deadline=None, max_examples=60)
@given(
    low=st.floats(0, 1e8),
    step=st.floats(0, 1e8),
    exposure=st.floats(-20, 20),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_more_light_is_never_darker(
    operator: str, low: float, step: float, exposure: float, dtype: torch.dtype
) -> None:
    grey = torch.tensor([[low] * 3, [low + step] * 3], dtype=dtype)
    value = tone_map(grey, operator, exposure=exposure)
    assert value.dtype == dtype
    assert bool(((value >= 0) & (value <= 1)).all())
    assert bool((value[1] >= value[0] - 1e-6).all())
