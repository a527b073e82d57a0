"""Points into objects, and a tree of oriented boxes around each (specification 13, section 7)."""

from __future__ import annotations

import math

import numpy as np

from torchrender.checks import check_choice, check_range, check_tensor
from torchrender.errors import InputError
from torchrender.kernels.walkthrough.clusters import join_cells
from torchrender.walkthrough.density import Samples
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import PointModel, no_points
from torchrender.walkthrough.options import EDGES, WalkthroughOptions

MOST_OBJECTS = 65536
FLOOR = 1e-6
"""Least half side of a box, scene units: points that lie at one place have no extent."""


def cluster_points(position: Array, epsilon: float, *, exact: bool = True, edge: str = "safe") -> Array:
    """(M,) int64 object of each of M points (M,3), numbered in the order of their first points.

    ``exact``: connected components of the graph "no farther than epsilon". Else by the source's grid: cubes whose
    points, and those of the 26 adjacent cubes, share an object. ``edge`` "safe" gives cubes of epsilon / (2 sqrt 3),
    the
    largest for which two points of adjacent cubes are never more than epsilon apart; "source" the published
    sqrt(2)/4 epsilon, which is safe for cubes that share a face only. The grid may cut objects whose points are farther
    apart than a cube.

    Raises:
        InputError: no (M,3) array, or values that are not finite. OptionError: epsilon not positive, another edge.
    """
    import torch

    position = np.asarray(position, np.float64)
    check_tensor("position", torch.from_numpy(position), ("M", 3))
    check_range("epsilon", epsilon, 1e-300)
    check_choice("edge", edge, EDGES)
    if not len(position):
        return np.zeros(0, np.int64)
    if not np.isfinite(position).all():
        raise InputError("position must be finite")
    if exact:
        # All points of a cube of this edge are within epsilon of one another; neighbours up to two cubes away may be.
        side, reach, limit = epsilon / math.sqrt(3.0), 2, epsilon * epsilon
    else:
        side, reach, limit = (epsilon / (2 * math.sqrt(3.0)) if edge == "safe" else math.sqrt(2) / 4 * epsilon), 1, -1.0
    low = position.min(0)
    size = np.floor((position.max(0) - low) / side) + 1 + 2 * reach
    if size.prod() > 2.0**62:
        raise InputError("epsilon is too small for the extent of the points")
    cell = np.floor((position - low) / side).astype(np.int64) + reach
    stride = np.array([1, int(size[0]), int(size[0]) * int(size[1])], np.int64)
    number = cell @ stride
    order = np.argsort(number, kind="stable")
    keys, starts = np.unique(number[order], return_index=True)
    offsets = np.mgrid[-reach : reach + 1, -reach : reach + 1, -reach : reach + 1].reshape(3, -1).T
    offsets = offsets[(offsets @ stride) > 0]
    parent = np.arange(len(keys))
    bounds = np.append(starts, len(order)).astype(np.int64)
    sorted_ = np.ascontiguousarray(position[order])
    join_cells(keys, bounds, stride, np.ascontiguousarray(offsets), sorted_, limit, parent)
    while True:
        above = parent[parent]
        if np.array_equal(above, parent):
            break
        parent = above
    owner = np.zeros(len(order), np.int64)
    owner[order] = np.repeat(parent, np.diff(bounds))
    _, first, inverse = np.unique(owner, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return np.asarray(rank[inverse.reshape(-1)])


def build_points(samples: Samples, options: WalkthroughOptions) -> PointModel:
    """Objects, their trees, and the points in the order of the leaves."""
    if not len(samples.position):
        return no_points()
    footprint = float(np.exp(-0.5 * np.median(samples.log_density.astype(np.float64))))
    epsilon = options.epsilon * footprint
    objects = cluster_points(samples.position, epsilon, exact=options.exact_objects, edge=options.edge)
    by_object = np.argsort(objects, kind="stable")
    starts = np.append(np.unique(objects[by_object], return_index=True)[1], len(by_object))
    order = by_object.copy()
    nodes: list[Array] = []
    links: list[tuple[int, int, int, int]] = []
    roots = []
    for first, end in zip(starts[:-1].tolist(), starts[1:].tolist()):
        roots.append(len(nodes))
        grow(samples.position, order, (first, end), nodes, links, options.leaf_size, 4 * epsilon)
    return PointModel(
        position=samples.position[order],
        normal=samples.normal[order],
        color=samples.color[order],
        log_density=samples.log_density[order],
        object_id=objects[order].astype(np.int32),
        nodes=np.stack(nodes),
        links=np.array(links, np.int64),
        roots=np.array(roots, np.int64),
    )


def box_around(points: Array) -> tuple[Array, Array, Array]:
    """Centre, axes (rows) and half sides of the box along the principal axes of points (K,3)."""
    mean = points.mean(0)
    away = points - mean
    axes = np.linalg.eigh(away.T @ away)[1].T if len(points) > 1 else np.eye(3)
    along = away @ axes.T
    low, high = along.min(0), along.max(0)
    # A little more than the points need: their rounding must not leave them outside.
    half = np.maximum(0.5 * (high - low) * (1 + 1e-9), FLOOR)
    return mean + 0.5 * (low + high) @ axes, axes, half


def grow(
    position: Array,
    order: Array,
    run: tuple[int, int],
    nodes: list[Array],
    links: list[tuple[int, int, int, int]],
    leaf: int,
    least: float,
) -> None:
    """Append the tree over ``order[run]``; ``order`` is sorted so that each node's points follow one another.

    Children of a node stand side by side. Split at the mean along the longest axis, at the median where one side would
    be empty, until there are at most ``leaf`` points or the box is smaller than ``least``.
    """
    nodes.append(np.zeros(15))
    links.append((*run, 0, 0))
    waiting = [(len(nodes) - 1, run)]
    while waiting:
        node, (first, end) = waiting.pop()
        part = order[first:end]
        centre, axes, half = box_around(position[part])
        nodes[node] = np.concatenate([centre, axes.reshape(-1), half])
        if end - first <= leaf or 2 * half.max() < least:
            continue
        along = (position[part] - position[part].mean(0)) @ axes[int(half.argmax())]
        left = along < 0
        if not 0 < left.sum() < len(part):
            left = np.zeros(len(part), bool)
            left[np.argsort(along, kind="stable")[: len(part) // 2]] = True
        middle = first + int(left.sum())
        order[first:end] = np.concatenate([part[left], part[~left]])
        child = len(nodes)
        links[node] = (first, end, child, child + 2)
        for piece in ((first, middle), (middle, end)):
            nodes.append(np.zeros(15))
            links.append((*piece, 0, 0))
            waiting.append((len(nodes) - 1, piece))
