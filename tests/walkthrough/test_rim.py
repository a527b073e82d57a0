"""The rim of undistorted photos is not taken for something seen; what is bright or dark is."""

from __future__ import annotations

import numpy as np

from torchrender.walkthrough.frames.rim import empty_rim


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(20, 230, (96, 128, 3)).astype(np.uint8)


def test_a_rim_is_found_on_the_sides_that_have_one():
    color = picture()
    bow = (3 + 1.5 * np.cos(np.linspace(-2, 2, 96))).astype(int)
    for row, width in enumerate(bow):
        color[row, :width] = 255
    color[-4:] = 0
    color[30:40, :60] = 255  # a lamp that touches the rim
    found = empty_rim(color)
    expected = np.zeros((96, 128), bool)
    for row, width in enumerate(bow):
        expected[row, :width] = True
    expected[-4:] = True
    assert found[expected].all()
    assert not found[:90, 10:].any() and not found[:, -40:][:88].any()


def test_what_is_burnt_out_or_dark_stays():
    assert not empty_rim(picture()).any()
    assert not empty_rim(np.zeros((96, 128, 3), np.uint8)).any()
    assert not empty_rim(np.full((96, 128, 3), 255, np.uint8)).any()
    window = picture()
    window[:40, :50] = 255
    rng = np.random.default_rng(1)
    curtain = picture()
    for row in range(96):
        curtain[row, : rng.integers(0, 6)] = 255
    assert not empty_rim(window).any() and not empty_rim(curtain).any()
