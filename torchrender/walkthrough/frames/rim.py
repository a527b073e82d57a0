"""The empty rim that undistorted or rotated photos have."""

from __future__ import annotations

import cv2
import numpy as np

from torchrender.walkthrough.frames.record import Array

WIDEST = 0.05
"""Share of the picture's larger side that a rim may be wide."""

LEAST = 0.5
"""Share of a side's lines that must begin with an empty run: a lamp at the border is no rim."""

SMOOTH = 0.8
"""Share of these whose runs must be as long as the next one's, to a pixel: a burnt-out curtain is no rim either."""

WHITE, BLACK = 250, 5


def empty_rim(color: Array) -> Array:
    """(H,W) bool: the white or black rim along the sides of a photo (H,W,3) uint8.

    Its pixels show nothing, and must not become colours of the scene. A side has one if most of its lines begin with a
    short run of empty pixels that is about as long as the next line's.
    """
    height, width = color.shape[:2]
    widest = max(int(WIDEST * max(height, width)), 1)
    mask = np.zeros((height, width), bool)
    for extreme in (color.min(axis=2) >= WHITE, color.max(axis=2) <= BLACK):
        for turned, out in ((extreme, mask), (extreme.T, mask.T)):
            for lines, part in ((turned, out), (turned[:, ::-1], out[:, ::-1])):
                _mark(lines[:, : widest + 1], part)
    if not mask.any():
        return mask
    # Its inner edge is mixed with the picture.
    return cv2.dilate(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0


def _mark(lines: Array, mask: Array) -> None:
    """Mark the runs at the beginning of lines (K,W) in ``mask``."""
    runs = np.where(lines.all(axis=1), lines.shape[1], (~lines).argmax(axis=1))
    short = (runs > 0) & (runs < lines.shape[1])
    if short.mean() < LEAST:
        return
    both = short[1:] & short[:-1]
    if (np.abs(np.diff(runs))[both] <= 1).mean() < SMOOTH:
        return
    # Where what is seen is burnt out, too, the rim is as wide as elsewhere.
    runs = np.where(short, runs, np.where(runs > 0, int(np.median(runs[short])), 0))
    mask[:, : lines.shape[1]] |= np.arange(lines.shape[1]) < runs[:, None]
