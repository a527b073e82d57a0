"""Parts of a marched ray."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.rays.depth_march import clip

PLACES = st.floats(-3.0, 3.0)


@given(PLACES, st.sampled_from([0.0, 0.0, 0.4, -0.7, 3.0]), st.tuples(PLACES, PLACES), st.tuples(PLACES, PLACES))
@settings(max_examples=80, deadline=None)
def test_a_clipped_ray_is_where_it_lies_in_the_slab(
    position: float, rate: float, slab: tuple[float, float], part: tuple[float, float]
) -> None:
    """Beside a slab that it runs along there is nothing of it."""
    (low, high), (first, last) = sorted(slab), sorted(part)
    begin, end = clip(position, rate, low, high, first, last)
    along = np.linspace(first, last, 41)
    inside = (position + along * rate >= low) & (position + along * rate <= high)
    near = (np.abs(position + along * rate - low) < 1e-9) | (np.abs(position + along * rate - high) < 1e-9)
    found = (along >= begin) & (along <= end)
    assert ((found == inside) | near).all()
    assert (begin >= first and end <= last) or begin > end
