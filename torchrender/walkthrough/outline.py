"""Outlines of what is opaque in a texture: simplified polygons, their triangles, and the largest rectangle inside."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from torchrender.walkthrough.frames.record import Array

MOST_CORNERS = 96
"""Of a polygon that is cut into triangles; more ragged ones get their convex hull: alpha says what is there."""

RECTANGLE_CELLS = 48


@dataclass(frozen=True, eq=False)
class Outline:
    """Polygons around all opaque texels, texel coordinates (column, row)."""

    corners: Array  # (V,2) float64
    triangles: Array  # (F,3) int64
    raw_corners: int  # before they were simplified


def outline_of(opaque: Array) -> Outline:
    """Polygons that hold every opaque texel (Ht,Wt) bool, simplified by up to one texel."""
    # A frame of two texels, so that what is simplified away is never opaque.
    mask = cv2.copyMakeBorder(opaque.astype(np.uint8), 4, 4, 4, 4, cv2.BORDER_CONSTANT, value=0)
    mask = cv2.dilate(mask, np.ones((5, 5), np.uint8))
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    corners: list[Array] = []
    triangles: list[Array] = []
    first, raw = 0, 0
    for contour in contours:
        raw += len(contour)
        polygon = cv2.approxPolyDP(contour, 1.0, True).reshape(-1, 2)
        cut = ear_clip(polygon.astype(np.float64)) if 3 <= len(polygon) <= MOST_CORNERS else None
        if cut is None:
            polygon = cv2.approxPolyDP(cv2.convexHull(contour), 1.0, True).reshape(-1, 2)
            if len(polygon) < 3:
                x, y, w, h = cv2.boundingRect(contour)
                polygon = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])
            cut = np.array([(0, k, k + 1) for k in range(1, len(polygon) - 1)])
        corners.append(polygon + 0.5 - 4.0)
        triangles.append(cut + first)
        first += len(polygon)
    if not corners:
        return Outline(np.zeros((0, 2)), np.zeros((0, 3), np.int64), 0)
    return Outline(np.concatenate(corners), np.concatenate(triangles).astype(np.int64), raw)


def ear_clip(polygon: Array) -> Array | None:
    """(V-2,3) triangles of a simple polygon (V,2), or None if it cuts itself."""
    left = list(range(len(polygon)))
    x, y = polygon[:, 0], polygon[:, 1]
    turn = 1.0 if (x * np.roll(y, -1) - np.roll(x, -1) * y).sum() > 0 else -1.0

    def side(a: Array, b: Array, c: Array) -> Array:
        return turn * (
            (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1]) - (b[..., 1] - a[..., 1]) * (c[..., 0] - a[..., 0])
        )

    found = []
    while len(left) > 3:
        for k in range(len(left)):
            i, j, m = left[k - 1], left[k], left[(k + 1) % len(left)]
            a, b, c = polygon[i], polygon[j], polygon[m]
            if side(a, b, c) < 0:
                continue
            others = polygon[[v for v in left if v not in (i, j, m)]]
            inside = (side(a, b, others) >= 0) & (side(b, c, others) >= 0) & (side(c, a, others) >= 0)
            if inside.any():
                continue
            found.append((i, j, m))
            left.pop(k)
            break
        else:
            return None
    found.append((left[0], left[1], left[2]))
    triangles = np.array(found)
    area = np.abs(side(polygon[triangles[:, 0]], polygon[triangles[:, 1]], polygon[triangles[:, 2]])).sum()
    whole = abs((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
    return triangles if abs(area - whole) <= 1e-6 * max(whole, 1.0) else None


def largest_rectangle(opaque: Array) -> Array:
    """(4,) first column, first row, and those one past the end, of a large rectangle of opaque texels; zeros: none."""
    height, width = opaque.shape
    cell = max(-(-max(height, width) // RECTANGLE_CELLS), 1)
    rows, columns = height // cell, width // cell
    if not rows or not columns:
        return np.zeros(4)
    coarse = np.asarray(opaque[: rows * cell, : columns * cell].reshape(rows, cell, columns, cell).all(axis=(1, 3)))
    heights, best, found = np.zeros(columns, int), 0, (0, 0, 0, 0)
    for row in range(rows):
        heights = np.where(coarse[row], heights + 1, 0)
        stack: list[int] = []
        for column in range(columns + 1):
            now = int(heights[column]) if column < columns else 0
            while stack and heights[stack[-1]] >= now:
                tall = int(heights[stack.pop()])
                first = stack[-1] + 1 if stack else 0
                if tall * (column - first) > best:
                    best = tall * (column - first)
                    found = (first, row - tall + 1, column, row + 1)
            stack.append(column)
    return np.array(found, np.float64) * cell
