"""Corners of faces, against Python's own way with words."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torchrender.kernels.files.corners import count_words, parse_corners

index = st.integers(1, 10**9)
corner = st.one_of(
    index.map(str),
    st.tuples(index, index).map("{0[0]}/{0[1]}".format),
    st.tuples(index, index).map("{0[0]}//{0[1]}".format),
    st.tuples(index, index, index).map("{0[0]}/{0[1]}/{0[2]}".format),
)


def parsed(text: bytes, lines: int, room: int = 200) -> tuple[int, np.ndarray, np.ndarray]:
    table, counts = np.full((room, 3), -7, np.int64), np.zeros(lines, np.int64)
    found = parse_corners(np.frombuffer(text, np.uint8), table, counts)
    return found, table, counts


@settings(deadline=None)
@given(st.lists(st.lists(corner, max_size=6), min_size=1, max_size=10), st.sampled_from([" ", "\t ", "  "]))
def test_the_same_as_splitting(faces: list[list[str]], blank: str) -> None:
    text = "\n".join(blank + blank.join(face) + blank for face in faces).encode()
    found, table, counts = parsed(text, len(faces))
    expected = [[int(p or 0) for p in [*word.split("/"), "", ""][:3]] for face in faces for word in face]
    assert found == len(expected) and table[:found].tolist() == expected
    assert counts.tolist() == [len(face) for face in faces]


@pytest.mark.parametrize("word", ["1/", "/1", "1/2/", "1//", "//1", "-1", "1/2/3/4", "1.0", "a", "1 # b", "9" * 17])
def test_anything_else_is_left_to_the_caller(word: str) -> None:
    assert parsed(f"1 2 {word} 3".encode(), 1)[0] == -1


def test_room_is_checked() -> None:
    assert parsed(b"1 2 3", 1, room=2)[0] == -1
    assert parsed(b"", 0)[0] == 0


@settings(deadline=None)
@given(st.text(alphabet="ab \t\n", max_size=60))
def test_words_of_lines(text: str) -> None:
    lines = text.split("\n")
    counts = np.zeros(len(lines), np.int64)
    count_words(np.frombuffer(text.encode(), np.uint8), counts)
    assert counts.tolist() == [len(line.split()) for line in lines]
