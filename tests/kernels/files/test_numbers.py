"""Numbers in text, against Python's own: the same to the last bit, or left to the caller."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.files.numbers import parse_numbers
from torchrender.scene.files.plain.numbers import numbers_of

words = st.one_of(
    st.floats(allow_nan=False).map(repr),
    st.floats(-1e6, 1e6).map(lambda x: f"{x:.7f}"),
    st.floats(-1e6, 1e6).map(lambda x: f"{x:.3e}"),
    st.integers(-(10**25), 10**25).map(str),
    st.sampled_from(
        ["0", "-0", "+1.", ".5", "-.5e1", "1E5", "0.000000000000001", "00012", "1e-400", "1e400", "nan", "inf"]
    ),
)


@settings(deadline=None)
@given(st.lists(words, max_size=30), st.sampled_from([" ", "\n", "\t\r\n  "]))
def test_the_same_as_python(found: list[str], blank: str) -> None:
    text = (blank + blank.join(found) + blank).encode()
    values = numbers_of(text)
    expected = np.array([float(w) for w in found], np.float64)
    np.testing.assert_array_equal(
        values.view(np.int64)[~np.isnan(expected)], expected.view(np.int64)[~np.isnan(expected)]
    )
    assert (np.isnan(values) == np.isnan(expected)).all()


@pytest.mark.parametrize("word", ["1.2.3", "x", "1e", "--1", "1,5", "0x10", "1_000", "e5", "."])
def test_what_is_no_number_is_an_error(word: str) -> None:
    with pytest.raises(ValueError, match="no number"):
        numbers_of(f"1 2 {word} 3".encode())


def test_room_is_checked() -> None:
    out, hard = np.zeros(2), np.zeros((2, 2), np.int64)
    assert parse_numbers(np.frombuffer(b"1 2 3", np.uint8), out, hard)[0] == -1
    assert numbers_of(b"").size == 0 and numbers_of(b" \n ").size == 0
