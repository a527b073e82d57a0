"""Which points a camera need not look at: outside its view, or behind planes (specification 13, section 8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from torchrender.kernels.walkthrough.culling import visible
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


@dataclass(frozen=True, eq=False)
class Occluders:
    """The largest rectangle without holes of each plane that has one."""

    corners: Array  # (O,4,3) float64 world, around the rectangle
    normal: Array  # (O,3)
    area: Array  # (O,)
    step: Array  # (O,) size of a texel

    @classmethod
    def of(cls, patches: Sequence[PlanePatch]) -> Occluders:
        """Of all patches."""
        corners, chosen = [], []
        for patch in patches:
            # Half a texel inside, because the picture of the plane ends at texels.
            u0, v0, u1, v1 = patch.solid + np.array([0.5, 0.5, -0.5, -0.5])
            if u1 > u0 and v1 > v0:
                corners.append(patch.world(np.array([[u0, v0], [u1, v0], [u1, v1], [u0, v1]])))
                chosen.append((patch, (u1 - u0) * (v1 - v0) * patch.step**2))
        return cls(
            np.stack(corners) if corners else np.zeros((0, 4, 3)),
            np.stack([p.normal for p, _ in chosen]) if chosen else np.zeros((0, 3)),
            np.array([area for _, area in chosen]),
            np.array([p.step for p, _ in chosen]),
        )

    def shadows(self, eye: Array, most: int) -> Array:
        """(S,5,4) shadow volumes of those that fill most of the view around ``eye``: a point is hidden if n.p + d > 0
        for all five planes."""
        middle = self.corners.mean(1)
        toward = middle - eye
        distance = np.maximum(np.linalg.norm(toward, axis=1), 1e-300)
        height = np.abs((toward * self.normal).sum(1))
        # The solid angle of a wall close by is not area cos / distance^2 of its middle: at most a half space.
        angle = np.minimum(self.area * height / distance**3, 2 * np.pi)
        angle[height < 1e-9 * distance] = -1.0  # seen edge on
        order = np.argsort(-angle, kind="stable")[:most]
        order = order[angle[order] > 0]
        planes = np.zeros((len(order), 5, 4))
        normal, middle = self.normal[order], middle[order]
        side = np.where(((eye - middle) * normal).sum(1) > 0, -1.0, 1.0)
        planes[:, 0, :3] = side[:, None] * normal
        # A texel behind the plane, so that points on it stay: planes win against points that are no nearer.
        planes[:, 0, 3] = -side * (normal * middle).sum(1) - self.step[order]
        edges = self.corners[order] - eye
        across = np.cross(edges, np.roll(edges, -1, axis=1))
        across /= np.maximum(np.linalg.norm(across, axis=2, keepdims=True), 1e-300)
        across *= np.where((across * (middle - eye)[:, None]).sum(2, keepdims=True) < 0, -1.0, 1.0)
        planes[:, 1:, :3], planes[:, 1:, 3] = across, -(across @ eye)
        return planes


def visible_runs(points: PointModel, camera: Cameras, shadows: Array) -> Visible:
    """Walk all trees from their roots. Boxes wholly in view are taken with all below them, unless planes may still hide
    parts.

    A box is out of view if all its corners are outside one plane of the view; that every corner is outside some plane
    is not enough: the view may lie within the box.
    """
    wide = camera.sub_camera(-BORDER, -BORDER, camera.width + 2 * BORDER, camera.height + 2 * BORDER)
    planes = wide.frustum_planes()[0].numpy()
    planes = np.ascontiguousarray(planes[np.linalg.norm(planes[:, :3], axis=1) > 0.5])
    runs = np.empty((len(points.links), 2), np.int64)
    found, outside, hidden = visible(points.nodes, points.links, points.roots, planes, shadows, runs)
    runs = runs[:found]
    return Visible(np.ascontiguousarray(runs[np.argsort(runs[:, 0])]), int(outside), int(hidden))
