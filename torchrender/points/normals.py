"""Normals and radii of points that come without: from their nearest neighbours.

Orientation: Hoppe and others, Surface reconstruction from unorganized points, SIGGRAPH 1992. Source: specification 06,
section 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import cKDTree

Array = np.ndarray[Any, Any]

CHUNK = 1 << 17  # points whose neighbours are in memory at a time
OPEN = 0.1  # share of its area that the normals of a closed surface may add up to
SURE = 0.9  # share of the edges of the tree whose ends have to agree well, for a side to be called known


def estimate_radii(position: Array, rows: Array, neighbour: int, scale: float) -> Array:
    """(R,) ``scale`` times the distance to the n-th nearest neighbour, for the points that ``rows`` (P,) marks."""
    tree = cKDTree(position)
    wanted = position[rows]
    rank = min(neighbour, len(position) - 1)
    found = np.zeros(len(wanted))
    for begin in range(0, len(wanted), CHUNK):
        part = slice(begin, begin + CHUNK)
        # The first neighbour is the point itself.
        distance, _ = tree.query(wanted[part], k=[rank + 1], workers=-1)
        found[part] = scale * distance[:, 0]
    return found


def estimate_normals(position: Array, known: Array | None, neighbours: int) -> tuple[Array, bool]:
    """Unit normals (P,3), zero where the neighbours lie on a line or at one place, and whether their side is sure.

    ``known`` (P,3): normals that are given, zero where not; the estimated ones are turned to their side.
    """
    count = min(neighbours, len(position))
    if count < 3:
        return np.zeros((len(position), 3)), False
    _, near = cKDTree(position).query(position, k=count, workers=-1)
    normal = np.concatenate(
        [_smallest_axes(position, near[begin : begin + CHUNK]) for begin in range(0, len(near), CHUNK)]
    )
    if known is not None:
        # The given normals among the neighbours decide.
        side = np.einsum("pkc,pc->p", known[near], normal)
        return np.where(side[:, None] < 0, -normal, normal), bool((side != 0).all())
    return _orient(position, normal, near)


def _smallest_axes(position: Array, near: Array) -> Array:
    """Eigenvector of the smallest eigenvalue of each neighbourhood's covariance (N,3)."""
    offset = position[near] - position[near].mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("pki,pkj->pij", offset, offset))
    flat = values[:, 1] > 1e-12 * np.maximum(values[:, 2], np.finfo(float).tiny)
    return np.where(flat[:, None], vectors[:, :, 0], 0.0)


def _orient(position: Array, normal: Array, near: Array) -> tuple[Array, bool]:
    """Flip normals so that neighbours agree, from the outermost point of each connected part."""
    count, links = len(position), min(8, near.shape[1])
    rows = np.repeat(np.arange(count), links - 1)
    columns = near[:, 1:links].reshape(-1)
    agreement = np.abs(np.einsum("ij,ij->i", normal[rows], normal[columns]))
    # A weight of zero would be no edge at all.
    graph = coo_matrix((1.0 + 1e-9 - np.minimum(agreement, 1.0), (rows, columns)), shape=(count, count))
    tree = minimum_spanning_tree(graph.tocsr().maximum(graph.T.tocsr()))
    centre = position.mean(axis=0)
    # The outermost point's normal points outwards for sure: every start of a part is chosen so.
    outwards = np.einsum("ij,ij->i", position - centre, normal)
    farthest = np.argsort(-np.einsum("ij,ij->i", position - centre, position - centre))
    seen = np.zeros(count, bool)
    sign = np.ones(count)
    for start in farthest:
        if seen[start]:
            continue
        order, before = breadth_first_order(tree, start, directed=False)
        seen[order] = True
        sign[start] = 1.0 if outwards[start] >= 0 else -1.0
        same = np.einsum("ij,ij->i", normal[order[1:]], normal[before[order[1:]]])
        for k, agrees in zip(order[1:], same >= 0, strict=True):
            sign[k] = sign[before[k]] if agrees else -sign[before[k]]
    turned = normal * sign[:, None]
    agree = np.abs(np.einsum("ij,ij->i", turned[rows], turned[columns])) > 0.5
    return turned, bool(agree.mean() > SURE) and _closed(position, turned, near[:, links - 1])


def _closed(position: Array, normal: Array, neighbour: Array) -> bool:
    """Whether the points bound a body and their normals point out of it.

    The normals of a closed surface, weighted by area, add up to nothing; those of a scan of one side of things, or of a
    part of a room, do not. ``neighbour`` (P,): one at some distance, which tells the area that a point stands for.
    """
    distance = np.linalg.norm(position - position[neighbour], axis=1)
    area = distance**2
    flux = np.linalg.norm((area[:, None] * normal).sum(axis=0)) / max(area.sum(), np.finfo(float).tiny)
    offset = position - position.mean(axis=0)
    volume = (area * np.einsum("ij,ij->i", offset, normal)).sum()
    return bool(flux < OPEN and volume > 0)
