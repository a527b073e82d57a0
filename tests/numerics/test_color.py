from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.errors import InputError
from torchrender.numerics.color import linear_from_srgb, luminance, srgb_from_linear, srgb_table


def loop_linear(v: float) -> float:
    return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4


def test_matches_the_definition() -> None:
    values = torch.linspace(0, 1, 257, dtype=torch.float64)
    expected = torch.tensor([loop_linear(float(v)) for v in values], dtype=torch.float64)
    torch.testing.assert_close(linear_from_srgb(values), expected, rtol=0, atol=1e-15)


def test_published_values() -> None:
    grey = linear_from_srgb(torch.tensor([0.0, 0.5, 1.0], dtype=torch.float64))
    torch.testing.assert_close(grey, torch.tensor([0.0, 0.21404114, 1.0], dtype=torch.float64), rtol=0, atol=1e-8)


@settings(deadline=None, max_examples=50)
@given(st.floats(-4, 4))
def test_inverse_of_each_other(value: float) -> None:
    v = torch.tensor(value, dtype=torch.float64)
    assert float(srgb_from_linear(linear_from_srgb(v))) == pytest.approx(value, abs=1e-6)
    assert float(linear_from_srgb(srgb_from_linear(v))) == pytest.approx(value, abs=1e-6)


def test_gradients_are_finite_at_zero() -> None:
    for function in (linear_from_srgb, srgb_from_linear):
        v = torch.tensor([0.0, 1e-30, 0.04], requires_grad=True)
        function(v).sum().backward()
        assert bool(torch.isfinite(v.grad).all())


def test_eight_bit_codes_survive_a_round_trip() -> None:
    codes = torch.arange(256)
    back = (srgb_from_linear(srgb_table(8)) * 255 + 0.5).long()
    assert torch.equal(back, codes)


def test_sixteen_bit_table_contains_the_eight_bit_one() -> None:
    deep = srgb_table(16)
    assert bool((deep[1:] > deep[:-1]).all())
    np.testing.assert_allclose(deep[::257].numpy(), srgb_table(8).numpy(), rtol=1e-6)
    with pytest.raises(InputError, match="bits"):
        srgb_table(10)


def test_luminance() -> None:
    assert float(luminance(torch.ones(3))) == pytest.approx(1.0)
    assert float(luminance(torch.tensor([0.0, 1.0, 0.0]))) == pytest.approx(0.7152)
    assert luminance(torch.rand(2, 4, 5, 3)).shape == (2, 4, 5)
    with pytest.raises(InputError, match="linear must have shape"):
        luminance(torch.rand(4))


@settings(deadline=None, max_examples=50)
@given(
    low=st.floats(-1e4, 1e4, width=32),
    step=st.floats(0, 1e4, width=32),
    dtype=st.sampled_from([torch.float32, torch.float64]),
)
def test_curves_rise_and_undo_each_other_in_both_precisions(low: float, step: float, dtype: torch.dtype) -> None:
    value = torch.tensor([low, low + step], dtype=dtype)
    eps = 1e-5 if dtype == torch.float32 else 1e-9  # the published constants leave a step of 1e-8 at the knee
    for there, back in ((linear_from_srgb, srgb_from_linear), (srgb_from_linear, linear_from_srgb)):
        found = there(value)
        assert found.dtype == dtype
        assert float(found[1]) >= float(found[0]) - eps
        torch.testing.assert_close(back(found), value, rtol=10 * eps, atol=1e-6)
