"""Which points a camera need not look at: outside its view, or behind planes (specification 13, section 8)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torchrender.scene.camera import Cameras
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import PlanePatch, PointModel

BORDER = 4
"""Pixels around the picture from which a point may still reach into it."""


@dataclass(frozen=True, eq=False)
class Visible:
    """Runs of points to draw."""

    runs: Array  # (R,2) int64 first point and one past the last
    outside: int  # points left out because their boxes lie outside the view
    hidden: int  # because planes hide them


def outside(nodes: Array, planes: Array) -> Array:
    """(K,F) bool: all eight corners of box k lie outside plane f, (n, d) with n.p + d >= 0 inside.

    A box is out of view if that holds for one plane; that every corner is outside some plane is not enough: the view
    may
    lie within the box.
    """
    return distances(nodes, planes)[1] < 0


def distances(nodes: Array, planes: Array) -> tuple[Array, Array]:
    """(K,F) least and greatest n.p + d over the corners of boxes."""
    n = planes[:, :3]
    middle = nodes[:, :3] @ n.T + planes[:, 3]
    axes, half = nodes[:, 3:12].reshape(-1, 3, 3), nodes[:, 12:]
    reach = (np.abs(axes @ n.T) * half[:, :, None]).sum(1)
    return middle - reach, middle + reach


def occluders(patches: tuple[PlanePatch, ...], eye: Array, most: int) -> list[Array]:
    """Shadow volumes (5,4) of the planes that fill most of the view around ``eye``: a point is hidden if n.p + d > 0
    for
    all five. Made of the largest rectangle without holes of each plane."""
    sized = []
    for patch in patches:
        rectangle = patch.solid
        if rectangle[2] <= rectangle[0] or rectangle[3] <= rectangle[1]:
            continue
        # Half a texel inside, because the picture of the plane ends at texels.
        u0, v0, u1, v1 = rectangle + np.array([0.5, 0.5, -0.5, -0.5])
        corners = patch.world(np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]]))
        toward = corners.mean(0) - eye
        distance = float(np.linalg.norm(toward))
        height = abs(float(toward @ patch.normal))
        if height < 1e-9 * max(distance, 1e-300):
            continue
        area = (u1 - u0) * (v1 - v0) * patch.step**2
        # The solid angle of a wall close by is not area cos / distance^2 of its middle: at most a half space.
        angle = min(area * height / max(distance, 1e-300) ** 3, 2 * np.pi)
        sized.append((angle, corners, patch))
    sized.sort(key=lambda s: -s[0])
    return [_shadow(corners, patch.normal, eye, patch.step) for _, corners, patch in sized[:most]]


def _shadow(corners: Array, normal: Array, eye: Array, step: float) -> Array:
    middle = corners.mean(0)
    side = -1.0 if (eye - middle) @ normal > 0 else 1.0
    planes = np.zeros((5, 4))
    planes[0, :3] = side * normal
    # A texel behind the plane, so that points on it stay: planes win against points that are no nearer.
    planes[0, 3] = -side * (normal @ middle) - step
    for k in range(4):
        across = np.cross(corners[k] - eye, corners[(k + 1) % 4] - eye)
        across /= max(float(np.linalg.norm(across)), 1e-300)
        if across @ (middle - eye) < 0:
            across = -across
        planes[1 + k, :3], planes[1 + k, 3] = across, -(across @ eye)
    return planes


def visible_runs(points: PointModel, camera: Cameras, shadows: list[Array], near: float) -> Visible:
    """Walk all trees from their roots, level by level. Boxes wholly in view are taken with all below them, unless
    planes
    may still hide parts."""
    wide = camera.sub_camera(-BORDER, -BORDER, camera.width + 2 * BORDER, camera.height + 2 * BORDER)
    planes = wide.frustum_planes()[0].numpy()
    planes = planes[np.linalg.norm(planes[:, :3], axis=1) > 0.5]
    del near
    front = points.roots
    runs, outside_count, hidden_count = [], 0, 0
    while len(front):
        nodes, links = points.nodes[front], points.links[front]
        count = links[:, 1] - links[:, 0]
        least, greatest = distances(nodes, planes)
        gone = (greatest < 0).any(1)
        outside_count += int(count[gone].sum())
        whole = (least >= 0).all(1)
        hidden = np.zeros(len(front), bool)
        touched = np.zeros(len(front), bool)
        for shadow in shadows:
            low, high = distances(nodes, shadow)
            hidden |= (low > 0).all(1)
            touched |= (high > 0).all(1)
        hidden &= ~gone
        hidden_count += int(count[hidden].sum())
        leaf = links[:, 2] == links[:, 3]
        taken = ~gone & ~hidden & (leaf | (whole & ~touched))
        runs.append(links[taken, :2])
        below = ~gone & ~hidden & ~taken
        front = np.concatenate([links[below, 2], links[below, 2] + 1])
    found = np.concatenate(runs) if runs else np.zeros((0, 2), np.int64)
    return Visible(np.ascontiguousarray(found[np.argsort(found[:, 0])]), outside_count, hidden_count)
