"""A photo divided into parts by a few strokes on each, and the parts as marked regions.

GrabCut tells which pixels look like the strokes of one part and not like those of the others; what several parts claim,
or none, goes by watershed to the neighbour that no edge parts it from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_range, check_tensor
from torchrender.errors import InputError
from torchrender.photo.fog.depth.segments import SIDE, cut_out
from torchrender.photo.fog.marks.records import LABELS, Point, Polygon, RegionMark, as_point

MOST_PARTS = 16
LONELY = 0.01
"""Share of the photo that a piece without any stroke must have to stay what it looks like."""
LEAST_AREA = 12.0  # pixels of a region
MOST_REGIONS = 200
_ROUGH = 0.0015  # of the longer side: how far an outline may be off


@dataclass(frozen=True, kw_only=True)
class Stroke:
    """A line over a part of a photo, in pixels; one point is a dot.

    Raises:
        InputError: no points, or values outside their ranges.
    """

    part: int
    points: Polygon
    width: float = 9.0

    def __post_init__(self) -> None:
        check_range("stroke part", self.part, 0, MOST_PARTS - 1)
        check_range("stroke width", self.width, 1.0, 1000.0)
        if not self.points:
            raise InputError("a stroke needs at least one point")
        points: list[Point] = [as_point(f"stroke point {k}", p) for k, p in enumerate(self.points)]
        object.__setattr__(self, "points", tuple(points))


def painted(strokes: Sequence[Stroke], height: int, width: int) -> Tensor:
    """(H,W) int64 part of the last stroke over each pixel; -1 where there is none."""
    seeds = np.full((height, width), -1, np.int16)
    for stroke in strokes:
        points = np.round((np.array(stroke.points) - 0.5) * 16).astype(np.int32)
        wide = max(1, round(stroke.width))
        if len(points) == 1:
            cv2.circle(seeds, points[0].tolist(), max(8, round(8 * stroke.width)), stroke.part, -1, shift=4)
        else:
            cv2.polylines(seeds, [points.reshape(-1, 1, 2)], False, stroke.part, wide, cv2.LINE_8, shift=4)
    return torch.from_numpy(seeds.astype(np.int64))


def divide(photo: Tensor, seeds: Tensor) -> Tensor:
    """(H,W) int64: the part that each pixel of a photo (H,W,3) belongs to.

    Args:
        seeds: (H,W) int64, as :func:`painted` gives them; at least two parts.

    Raises:
        InputError: shapes that differ, fewer than two parts, or strokes too thin to be seen.
    """
    check_tensor("seeds", seeds, tuple(photo.shape[:2]))
    h, w = photo.shape[:2]
    parts = [int(p) for p in seeds.unique() if p >= 0]
    if len(parts) < 2:
        raise InputError("a photo is divided by strokes on at least two parts")
    scale = min(1.0, SIDE / max(h, w))
    size = (max(2, round(w * scale)), max(2, round(h * scale)))
    claims = np.zeros((len(parts), size[1], size[0]), bool)
    strokes = np.zeros_like(claims)
    for k, part in enumerate(parts):
        found = cut_out(photo, seeds == part, (seeds >= 0) & (seeds != part))
        own = cv2.resize((seeds == part).numpy().astype(np.float32), size, interpolation=cv2.INTER_AREA)
        strokes[k] = own > 0.25
        small = cv2.resize(found.numpy().astype(np.float32), size, interpolation=cv2.INTER_AREA)
        claims[k] = _anchored(small > 0.5, strokes[k])
    sure = claims & (claims.sum(axis=0) == 1)
    sure = (sure & ~strokes.any(axis=0)) | strokes
    codes = cv2.resize(
        (photo.clamp(0.0, 1.0).sqrt() * 255).byte().numpy(), size, interpolation=cv2.INTER_AREA
    )  # fmt: skip
    number = _flooded(codes, sure)
    # Outlines grow smoothly: the part with the largest share of a pixel has it.
    shares = np.stack([cv2.resize((number == k).astype(np.float32), (w, h)) for k in range(len(parts))])
    out = torch.tensor(parts)[torch.from_numpy(shares.argmax(axis=0))]
    return torch.where(seeds >= 0, seeds, out)


def _anchored(mask: np.ndarray, strokes: np.ndarray) -> np.ndarray:
    """A mask without its small pieces that no stroke touches."""
    _, pieces, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    keep = stats[:, cv2.CC_STAT_AREA] >= LONELY * mask.size
    keep[np.unique(pieces[strokes & mask])] = True
    keep[0] = False
    found: np.ndarray = keep[pieces]
    return found


def _flooded(codes: np.ndarray, sure: np.ndarray) -> np.ndarray:
    """(h,w) number of the sure part (K,h,w) that reaches each pixel first, over edges last."""
    markers = np.where(sure.any(axis=0), sure.argmax(axis=0) + 1, 0).astype(np.int32)
    if (markers == 0).any():
        # Watershed leaves lines between parts and a frame: grown by a pixel there is no frame to be left.
        wide = cv2.copyMakeBorder(codes, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        flooded = cv2.copyMakeBorder(markers, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
        cv2.watershed(cv2.GaussianBlur(wide, (0, 0), 1.0), flooded)
        flooded = flooded[1:-1, 1:-1]
        markers = np.where(markers > 0, markers, flooded)
    lines = markers <= 0
    if lines.any():
        _, near = cv2.distanceTransformWithLabels(
            lines.astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
        )
        owner = np.zeros(int(near.max()) + 1, np.int32)
        owner[near[~lines]] = markers[~lines]
        markers = np.where(lines, owner[near], markers)
    numbers: np.ndarray = markers - 1
    return numbers


def regions_of(parts: Tensor, labels: Sequence[str], depths: Sequence[float | None] | None = None) -> list[RegionMark]:
    """Outlines of parts (H,W), the largest first, so that painted one over the other they show the parts again.

    Args:
        labels: of each part: ground, vertical or sky. depths: metres of vertical ones, None by their foot.

    Raises:
        InputError: a part without a label.
    """
    check_tensor("parts", parts, ("H", "W"))
    if int(parts.min()) < 0 or int(parts.max()) >= len(labels):
        raise InputError(f"labels must name every part, got {len(labels)} for parts up to {int(parts.max())}")
    rough = max(0.5, _ROUGH * max(parts.shape))
    found: list[tuple[float, RegionMark]] = []
    for part in parts.unique().tolist():
        label = labels[part]
        depth = depths[part] if depths is not None and label == LABELS[1] else None
        mask = (parts == part).numpy().astype(np.uint8)
        for outline in cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
            area = float(cv2.contourArea(outline))
            if area < LEAST_AREA:
                continue
            corners = cv2.approxPolyDP(outline, rough, True).reshape(-1, 2) + 0.5
            if len(corners) < 3 or cv2.contourArea(corners.astype(np.float32)) < 1.0:
                continue
            polygon = tuple((float(x), float(y)) for x, y in corners)
            found.append((area, RegionMark(label=label, polygon=polygon, depth=depth)))
    found.sort(key=lambda entry: -entry[0])
    return [region for _, region in found[:MOST_REGIONS]]
