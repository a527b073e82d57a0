"""What of a plane's surroundings belongs to it."""

from __future__ import annotations

import numpy as np

from torchrender.walkthrough.textures import _enclosed, _without_strays


def test_specks_apart_from_a_plane_are_dropped_and_pieces_of_it_stay() -> None:
    seen = np.zeros((80, 120), bool)
    seen[20:60, 10:60] = True
    seen[20:60, 70:100] = True  # a second piece
    seen[30:32, 30:32] = False
    seen[5:7, 50:53] = True  # a speck
    kept = _without_strays(seen)
    assert not kept[:10].any()
    seen[:10] = False
    assert (kept == seen).all()


def test_a_gap_within_a_plane_is_enclosed_and_its_surroundings_are_not() -> None:
    seen = np.zeros((100, 100), bool)
    seen[20:80, 20:80] = True
    seen[35:65, 35:65] = False  # a screen without depth
    seen[20:22, 40:44] = False  # a notch in the outline
    inside = _enclosed(seen)
    assert inside[20:80, 20:80].all()
    assert not inside[:18].any() and not inside[:, 82:].any()
