"""Textures of planes: as many texels as pixels were kept, each from the photos that saw it best, holes told from
gaps."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from torchrender.kernels.walkthrough.texture import GUESSED, HOLE, SEEN, UNSEEN, Patch, Votes, resample
from torchrender.walkthrough.density import Comparisons
from torchrender.walkthrough.frames.prepare import Capture, Progress, quiet
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.holes import fill_holes, smooth_fill
from torchrender.walkthrough.model import FILLED, SEEN_ALPHA, PlanePatch
from torchrender.walkthrough.options import WalkthroughOptions
from torchrender.walkthrough.outline import largest_rectangle, outline_of
from torchrender.walkthrough.planes import Plane

MOST_SIDE = 4096
MARGIN = 2
"""Texels by which a texture goes on beyond what was seen, so that planes that meet leave no crack."""

FEATHER = 12.0

STRAY, MOST_STRAY = 0.003, 64.0
"""Share of a plane's seen texels, and texels, below which a piece of it that stands apart is none."""

CLOSED = 0.03
"""Share of a texture's longer side: gaps as wide as twice that in its outline do not open what it encloses."""


@dataclass(frozen=True)
class TextureReport:
    """Texels over all planes."""

    seen: int
    filled: int
    holes: int


def texel_density(count: int, area: float, rho_scale: float) -> float:
    """Texels per scene unit that keep the number of pixels: sqrt(N / sum 1/sigma), times a factor."""
    return rho_scale * float(np.sqrt(count / max(area, 1e-300)))


def make_textures(
    capture: Capture,
    planes: list[Plane],
    found: Comparisons,
    options: WalkthroughOptions,
    progress: Progress = quiet,
    *,
    near: float,
    average: bool = False,
) -> tuple[list[PlanePatch], TextureReport]:
    """A textured patch, or where a plane is larger than a texture may be several, for each plane with kept pixels.

    Args:
        near: distance from a plane, scene units, within which pixels without a plane show it, too.
        average: every photo weighs the same (for comparison).
    """
    min_votes = options.min_votes or (1 if capture.exact else 2)
    votes = Votes(max(options.tau_z, 1e-3), options.blend_power, min_votes, FEATHER, near, average)
    poses = np.ascontiguousarray(capture.camera_from_world[:, :3])
    patches: list[PlanePatch] = []
    totals = np.zeros(3, np.int64)
    for row in progress(range(len(planes)), "textures"):
        if found.count[row] < 1 or found.area[row] <= 0:
            continue
        rho = texel_density(int(found.count[row]), float(found.area[row]), options.rho_scale)
        for patch, size in _rectangles(capture, planes[row], row, rho):
            made, counts = _texture(capture, patch, size, (poses, votes, options))
            totals += counts
            if made is not None:
                patches.append(made)
    return patches, TextureReport(*(int(t) for t in totals))


def axes_of(normal: Array, points: Array) -> tuple[Array, Array]:
    """Unit axes in a plane: the first along the longer side of the smallest rectangle around points (K,3)."""
    helper = np.eye(3)[int(np.abs(normal).argmin())]
    a = np.cross(normal, helper)
    a /= np.linalg.norm(a)
    b = np.cross(normal, a)
    flat = np.stack([points @ a, points @ b], axis=1)
    centre = flat.mean(0)
    scale = max(float(np.abs(flat - centre).max()), 1e-30)
    box = cv2.boxPoints(cv2.minAreaRect(((flat - centre) / scale).astype(np.float32)))
    first, second = box[1] - box[0], box[2] - box[1]
    along = first if np.linalg.norm(first) >= np.linalg.norm(second) else second
    length = float(np.linalg.norm(along))
    along = along / length if length > 1e-9 else np.array([1.0, 0.0])
    across = along[0] * a + along[1] * b
    across /= np.linalg.norm(across)
    return across, np.cross(normal, across)


def _rectangles(capture: Capture, plane: Plane, row: int, rho: float) -> list[tuple[Patch, Array]]:
    points = _outline_points(capture, plane, row)
    points = points - ((points @ plane.normal) - plane.offset)[:, None] * plane.normal
    across, down = axes_of(plane.normal, points)
    s, t = points @ across, points @ down
    low, high = np.array([s.min(), t.min()]), np.array([s.max(), t.max()])
    # Texel centres of the outermost samples lie half a texel inside; the margin takes the rest.
    border = (MARGIN + 1) / rho
    low, high = low - border, high + border
    pieces = np.maximum(np.ceil((high - low) * rho / MOST_SIDE).astype(int), 1)
    if pieces.prod() > 64:
        rho *= float(np.sqrt(64 / pieces.prod()))
        pieces = np.maximum(np.ceil((high - low) * rho / MOST_SIDE).astype(int), 1)
    made = []
    base = plane.normal * plane.offset
    for v in range(pieces[1]):
        for u in range(pieces[0]):
            part = (high - low) / pieces
            corner = low + part * np.array([u, v])
            size = np.maximum(np.ceil(part * rho).astype(int), 1)
            origin = base + corner[0] * across + corner[1] * down
            made.append((Patch(origin, across, down, plane.normal, 1.0 / rho, row), size))
    return made


def _outline_points(capture: Capture, plane: Plane, row: int) -> Array:
    """Points on the border of the plane's pixels in each photo, and some inside."""
    parts = [plane.points]
    for i in plane.photos:
        mask = (capture.plane[i] == row).astype(np.uint8)
        border = mask.astype(bool) & (cv2.erode(mask, np.ones((3, 3), np.uint8), borderValue=0) == 0)
        rows, columns = np.nonzero(border)
        if len(rows) > 2000:
            keep = np.linspace(0, len(rows) - 1, 2000).astype(int)
            rows, columns = rows[keep], columns[keep]
        parts.append(capture.points(int(i), rows, columns) @ capture.pose[i, :3, :3].T + capture.pose[i, :3, 3])
    return np.concatenate(parts)


def _seeing(capture: Capture, patch: Patch, size: Array, poses: Array) -> Array:
    """Photos in whose picture some of the patch may lie, from a grid of points on it and its plane."""
    s, t = np.meshgrid(np.linspace(0, size[0], 25) * patch.step, np.linspace(0, size[1], 25) * patch.step)
    grid = patch.origin + s.reshape(-1, 1) * patch.across + t.reshape(-1, 1) * patch.down
    height, width = capture.size
    camera = grid @ poses[:, :, :3].transpose(0, 2, 1) + poses[:, None, :, 3]
    z = camera[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        u = camera[..., 0] / z * capture.lens[:, 0, None] + capture.lens[:, 2, None]
        v = camera[..., 1] / z * capture.lens[:, 1, None] + capture.lens[:, 3, None]
    # A photo that sees less than a cell of the grid still counts: by half a picture more on each side.
    near = (z > 0) & (u > -0.5 * width) & (u < 1.5 * width) & (v > -0.5 * height) & (v < 1.5 * height)
    return np.nonzero(near.any(axis=1))[0].astype(np.int64)


def _texture(
    capture: Capture, patch: Patch, size: Array, how: tuple[Array, Votes, WalkthroughOptions]
) -> tuple[PlanePatch | None, Array]:
    poses, votes, options = how
    width, height = int(size[0]), int(size[1])
    color, state = np.zeros((height, width, 3), np.uint8), np.zeros((height, width), np.uint8)
    chosen = _seeing(capture, patch, size, poses)
    resample(patch, chosen, np.ascontiguousarray(poses[chosen]), capture.photos, votes, color, state)
    seen = _without_strays(state == SEEN)
    state[(state == SEEN) & ~seen] = HOLE
    if not seen.any():
        return None, np.zeros(3, np.int64)
    inside = _hull(seen)
    guessed = inside & (state == GUESSED) & _enclosed(seen)
    # A guess that hangs in the open is none: behind glass without depth anything may be.
    state[(state == GUESSED) & ~guessed] = HOLE
    unseen = inside & (state == UNSEEN)
    wanted = unseen | guessed if options.fill != "off" else np.zeros_like(seen)
    counts = np.array([seen.sum(), wanted.sum(), (inside & (state == HOLE)).sum()], np.int64)
    if wanted.any():
        known = seen | guessed
        color = (
            np.where(known[..., None], fill_holes(color, known, unseen, options, options.seed + patch.plane), color)
            if not unseen.any()
            else fill_holes(color, known, unseen, options, options.seed + patch.plane)
        )
    alpha = np.where(seen, SEEN_ALPHA, np.where(wanted, FILLED, 0)).astype(np.uint8)
    # A little further, except where somebody saw through.
    grown = _beside(alpha > 0)
    alpha[grown & (alpha == 0) & (state != HOLE)] = FILLED
    if not capture.exact:
        # Beside what is seen through, noise leaves texels that nobody votes on: filled, they stick out of outlines.
        alpha[(alpha == FILLED) & _beside(state == HOLE)] = 0
    color = np.where((seen | wanted)[..., None], color, _padded(color, seen | wanted))
    return _patch(patch, np.concatenate([color, alpha[..., None]], axis=2)), counts


def _hull(seen: Array) -> Array:
    rows, columns = np.nonzero(seen)
    hull = cv2.convexHull(np.stack([columns, rows], axis=1).astype(np.int32))
    mask = np.zeros(seen.shape, np.uint8)
    cv2.fillConvexPoly(mask, hull, 1)
    return mask > 0


def _beside(mask: Array) -> Array:
    return cv2.dilate(mask.astype(np.uint8), np.ones((2 * MARGIN + 1, 2 * MARGIN + 1), np.uint8)) > 0


def _without_strays(seen: Array) -> Array:
    """The texels ``seen`` (Ht,Wt) without specks apart from the rest: at outlines of other things some pixels are taken
    for the plane, and what lies between would be filled."""
    joined = cv2.dilate(seen.astype(np.uint8), np.ones((3, 3), np.uint8))
    count, labels = cv2.connectedComponents(joined, connectivity=8)
    size = np.bincount(labels.reshape(-1), weights=seen.reshape(-1), minlength=count)
    least = min(STRAY * float(seen.sum()), MOST_STRAY)
    return seen & (size >= least)[labels]


def _enclosed(seen: Array) -> Array:
    """(Ht,Wt) bool: within the outer outlines of what was seen, small gaps in them closed."""
    reach = max(int(CLOSED * max(seen.shape)), 2)
    square = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    padded = np.pad(seen.astype(np.uint8), reach)
    closed = cv2.morphologyEx(padded, cv2.MORPH_CLOSE, square)
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(closed, outlines, -1, 1, thickness=cv2.FILLED)
    return np.asarray(closed[reach:-reach, reach:-reach] > 0)


def _padded(color: Array, known: Array) -> Array:
    """Colours of transparent texels: those of their surroundings, so that no filter reads black."""
    return np.clip(np.rint(smooth_fill(color, known)), 0, 255).astype(np.uint8)


def _patch(patch: Patch, texture: Array) -> PlanePatch | None:
    """Cut to what is opaque, with its outline."""
    opaque = texture[..., 3] > 0
    rows, columns = np.nonzero(opaque.any(axis=1))[0], np.nonzero(opaque.any(axis=0))[0]
    if not len(rows):
        return None
    top, left = int(rows[0]), int(columns[0])
    cut = np.ascontiguousarray(texture[top : rows[-1] + 1, left : columns[-1] + 1])
    outline = outline_of(cut[..., 3] > 0)
    return PlanePatch(
        normal=patch.normal,
        origin=patch.origin + patch.step * (left * patch.across + top * patch.down),
        across=patch.across,
        down=patch.down,
        step=patch.step,
        plane=patch.plane,
        texture=cut,
        corners=outline.corners,
        triangles=outline.triangles,
        raw_corners=outline.raw_corners,
        solid=largest_rectangle(cut[..., 3] > 0),
    )
