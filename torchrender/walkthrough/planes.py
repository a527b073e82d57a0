"""One plane from its fits in several photos."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from torchrender.walkthrough.classify import Fit, Tolerances, fit_plane, widening
from torchrender.walkthrough.frames.prepare import Capture, Progress, quiet
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.options import WalkthroughOptions

OUTLINE_GAP = 5.0
"""Footprints between the outlines of two fits up to which they are one object."""


@dataclass(frozen=True, eq=False)
class Plane:
    """normal . x = offset, world space."""

    normal: Array  # (3,) float64 unit, towards the cameras
    offset: float
    photos: Array  # (J,) int64 photos that it was found in
    points: Array  # (K,3) some of its points
    largest: float  # their distances to it
    mean: float


def merge_fits(fits: list[Fit], options: WalkthroughOptions, tolerances: Tolerances) -> tuple[list[Plane], Array]:
    """Planes, and for each fit the row of its plane.

    Fits are joined when their normals differ by less than the merge angle, each one's centroid lies within twice the
    tolerance of the other, and they overlap or nearly touch. Joined fits are fitted again; those that do not lie on the
    common plane leave it.
    """
    owner = np.full(len(fits), -1, np.int64)
    if not fits:
        return [], owner
    pairs = _pairs(fits, options, tolerances)
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(fits), len(fits)))
    planes: list[Plane] = []
    _, label = connected_components(graph, directed=False)
    for group in range(label.max() + 1):
        left = np.nonzero(label == group)[0]
        while len(left):
            plane, members = _common(fits, left, tolerances, options)
            owner[members] = len(planes)
            planes.append(plane)
            left = np.setdiff1d(left, members)
    return planes, owner


def _pairs(fits: list[Fit], options: WalkthroughOptions, tolerances: Tolerances) -> Array:
    """(K,2) fits that belong together."""
    normal, offset = np.stack([f.normal for f in fits]), np.array([f.offset for f in fits])
    centroid = np.stack([f.centroid for f in fits])
    # Each fit's normal faces its own camera: both sides of a thin wall are two planes.
    aligned = normal @ normal.T > np.cos(np.radians(options.merge_angle_deg))
    gap = np.abs(centroid @ normal.T - offset)
    close = np.maximum(gap, gap.T) < 2 * tolerances.largest
    rows, columns = np.nonzero(np.triu(aligned & close, 1))
    trees = [cKDTree(f.points) for f in fits]
    spacing = np.array([f.footprint * np.sqrt(f.count / max(len(f.points), 1)) for f in fits])
    size = np.array([np.linalg.norm(f.points - f.centroid, axis=1).max() for f in fits])
    apart = np.linalg.norm(centroid[rows] - centroid[columns], axis=1)
    kept = []
    for a, b, distance in zip(rows.tolist(), columns.tolist(), apart.tolist()):
        reach = OUTLINE_GAP * max(fits[a].footprint, fits[b].footprint) + max(spacing[a], spacing[b])
        if distance > size[a] + size[b] + reach:
            continue
        found, _ = trees[a].query(fits[b].points, distance_upper_bound=reach)
        if np.isfinite(found).any():
            kept.append((a, b))
    return np.array(kept, np.int64).reshape(-1, 2)


def _common(
    fits: list[Fit], members: Array, tolerances: Tolerances, options: WalkthroughOptions
) -> tuple[Plane, Array]:
    """The plane of the fits that agree, and which these are: at least the largest."""
    members = members[np.argsort([-fits[k].count for k in members], kind="stable")]
    cosine = np.cos(np.radians(options.merge_angle_deg))
    for _ in range(8):
        points = np.concatenate([fits[k].points for k in members])
        weights = np.concatenate([np.full(len(fits[k].points), fits[k].count / len(fits[k].points)) for k in members])
        normal, offset, _ = fit_plane(points, weights)
        if normal @ fits[members[0]].normal < 0:
            normal, offset = -normal, -offset
        off = np.array([np.percentile(np.abs(fits[k].points @ normal - offset), 90) for k in members])
        turned = np.array([fits[k].normal @ normal for k in members])
        good = (off <= tolerances.largest) & (turned > cosine)
        good[0] |= not good.any()
        if good.all() or len(members) == 1:
            break
        # The worst go first: one that is far off pulls the others.
        limit = max(tolerances.largest, 0.5 * float(off.max()))
        keep = good | ((off <= limit) & (turned > cosine))
        members = members[keep] if not keep.all() else members[good]
        if not len(members):
            break
    points = np.concatenate([fits[k].points for k in members])
    distance = np.abs(points @ normal - offset)
    photos = np.unique([fits[k].photo for k in members]).astype(np.int64)
    return Plane(
        normal, float(offset), photos, points, float(np.percentile(distance, 99)), float(distance.mean())
    ), members


def assign_pixels(
    capture: Capture, planes: list[Plane], owner: Array, tolerances: Tolerances, progress: Progress = quiet
) -> None:
    """Turn the numbers of fits in ``capture.plane`` into rows of planes; pixels that are off their plane leave it."""
    table = np.append(owner, -1).astype(np.int32)
    normals = np.stack([p.normal for p in planes]) if planes else np.zeros((1, 3))
    offsets = np.array([p.offset for p in planes]) if planes else np.zeros(1)
    for i in progress(range(len(capture)), "assign pixels"):
        plane = table[capture.plane[i]]
        rows, columns = np.nonzero(plane >= 0)
        if not len(rows):
            capture.plane[i] = -1
            continue
        turn, eye = capture.pose[i, :3, :3], capture.pose[i, :3, 3]
        n, d = normals @ turn, offsets - normals @ eye
        row = plane[rows, columns]
        fx, fy, cx, cy = capture.lens[i]
        along = n[row, 0] * (columns + 0.5 - cx) / fx + n[row, 1] * (rows + 0.5 - cy) / fy + n[row, 2]
        z = capture.depth[i, rows, columns].astype(np.float64)
        off = np.abs(along * z - d[row]) > tolerances.largest * widening(capture, i, z, tolerances)
        # A plane through the eye, or seen from behind, cannot be drawn for this photo.
        off |= along >= 0
        plane[rows[off], columns[off]] = -1
        capture.plane[i] = plane
        rows, columns, row = rows[~off], columns[~off], row[~off]
        # Densities of photos are compared by the common plane, not by what each pixel makes of it.
        capture.normal[i, rows, columns] = np.rint(n[row] * 32767)
