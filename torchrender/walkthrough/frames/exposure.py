"""Exposure and sharpness of photos relative to one another, from surfaces that several of them see."""

from __future__ import annotations

import cv2
import numpy as np

from torchrender.numerics.color import srgb_table
from torchrender.walkthrough.frames.pairs import match, random_pixels
from torchrender.walkthrough.frames.prepare import Capture
from torchrender.walkthrough.frames.record import Array

DARK, BRIGHT = 12, 243
"""Codes between which a pixel tells the exposure."""

SAMPLES = 800
PARTNERS = 8


def solve_exposure(capture: Capture, near: list[Array], seed: int = 0) -> None:
    """One gain for each photo by least squares of logarithms over overlaps (the mean over photos stays), applied in
    place
    to the codes, and the loss of density of photos that are blurred or burnt out."""
    count = len(capture)
    if count < 2:
        return
    table = np.log(np.maximum(srgb_table(8).numpy().astype(np.float64), 1e-5))
    rng = np.random.default_rng(seed)
    rows: list[tuple[int, int, float, float, float]] = []
    energy = [_energy(capture.color[i]) for i in range(count)]
    for i in range(count):
        pixels = random_pixels(capture, i, SAMPLES, rng)
        for j in near[i][:PARTNERS].tolist():
            m = match(capture, i, j, pixels, 0.02)
            a, b = m.v.astype(int), m.u.astype(int)
            here, there = capture.color[i, m.row, m.column], capture.color[j, a, b]
            good = (np.minimum(here, there).min(1) > DARK) & (np.maximum(here, there).max(1) < BRIGHT)
            if good.sum() < 40:
                continue
            ratio = (table[here[good]] - table[there[good]]).mean(1)
            closer = np.log(m.depth[good] / capture.depth[i, m.row[good], m.column[good]])
            sharper = np.log(energy[i][m.row[good], m.column[good]] / energy[j][a[good], b[good]]) - 0.5 * closer
            rows.append((i, j, float(np.median(ratio)), float(np.median(sharper)), float(good.sum())))
    if not rows:
        return
    capture.gain[:] = np.exp(-_least_squares(rows, 2, count, capture.gain))
    # Half of what is missing in contrast counts: contrast differs for other reasons, too.
    blur = _least_squares(rows, 3, count, capture.gain)
    blur -= np.median(blur)
    burnt = np.array([(capture.color[i].max(2) >= 250).mean() for i in range(count)])
    burnt -= np.median(burnt)
    capture.log_quality[:] = np.where(blur < -0.25, 2.0 * blur, 0.0) - np.where(burnt > 0.1, 8.0 * burnt, 0.0)
    for i in range(count):
        if abs(np.log(capture.gain[i])) > 0.004:
            capture.color[i] = apply_gain(capture.color[i], float(capture.gain[i]))


def _energy(color: Array) -> Array:
    """Local contrast of fine detail, relative to brightness."""
    grey = cv2.cvtColor(color, cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = np.abs(grey - cv2.GaussianBlur(grey, (0, 0), 1.5))
    return cv2.GaussianBlur(fine, (0, 0), 6.0) / (cv2.GaussianBlur(grey, (0, 0), 6.0) + 8.0) + 2e-3


def _least_squares(rows: list[tuple[int, int, float, float, float]], column: int, count: int, like: Array) -> Array:
    """Values (N,) whose differences over pairs are the measured ones, mean zero; pairs far off are weighed down."""
    i, j = np.array([r[0] for r in rows]), np.array([r[1] for r in rows])
    measured, weight = np.array([r[column] for r in rows]), np.sqrt(np.array([r[4] for r in rows]))
    found = np.zeros_like(like)
    robust = np.ones(len(rows))
    for _ in range(5):
        matrix, right = np.zeros((count, count)), np.zeros(count)
        w = weight * robust
        np.add.at(matrix, (i, i), w)
        np.add.at(matrix, (j, j), w)
        np.add.at(matrix, (i, j), -w)
        np.add.at(matrix, (j, i), -w)
        np.add.at(right, i, w * measured)
        np.add.at(right, j, -w * measured)
        matrix += 1e-3 * max(weight.mean(), 1e-9) * np.eye(count) + 1e-12
        found = np.linalg.solve(matrix, right)
        residual = np.abs(measured - (found[i] - found[j]))
        robust = 1.0 / (1.0 + (residual / max(float(np.median(residual)), 0.01)) ** 2)
    return found - found.mean()


def apply_gain(color: Array, gain: float) -> Array:
    """Codes of the picture with ``gain`` times its linear light."""
    linear = np.clip(srgb_table(8).numpy().astype(np.float64) * gain, 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    codes = np.rint(encoded * 255).astype(np.uint8)
    codes[255] = max(codes[255], codes[254])
    return np.asarray(codes[color])
