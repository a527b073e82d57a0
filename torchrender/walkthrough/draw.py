"""Pictures of a walkthrough: planes by inverse homographies, points as squares, one depth buffer for both."""

from __future__ import annotations

import time
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import cv2
import numpy as np
import torch
from torch import Tensor

from torchrender.checks import check_class, options_of
from torchrender.errors import CameraError
from torchrender.kernels.compile import thread_count
from torchrender.kernels.walkthrough import splat
from torchrender.kernels.walkthrough.pinholes import close_pinholes
from torchrender.kernels.walkthrough.plane_pixels import shade_planes
from torchrender.numerics.color import srgb_table
from torchrender.points.draw import render_points
from torchrender.points.options import SplatOptions
from torchrender.points.tree import PatchSet, build_patches
from torchrender.raster import rasterize_visibility
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.drawing.culling import Visible, visible_runs
from torchrender.walkthrough.drawing.packed import Packed, packed
from torchrender.walkthrough.drawing.workspace import WORKSPACE
from torchrender.walkthrough.frames.record import Array
from torchrender.walkthrough.model import Walkthrough
from torchrender.walkthrough.options import DrawOptions
from torchrender.walkthrough.view_colors import apply_view_colors

PLANE_LEAD = 1e-4
"""Share of depth by which a point must be nearer than a plane to be seen before it."""

NOTHING, PLANE, FILLED, POINT, GAP = 0, 1, 2, 3, 4
"""What a pixel shows: nothing, a plane as photographed, a plane as filled in, a point, a gap between them that was
closed."""

BLEND_DEPTH = 0.01


@dataclass(frozen=True)
class DrawStatistics:
    """What one camera drew."""

    points: int  # of the model
    drawn: int  # considered after culling
    outside: int  # left out: outside the view
    hidden: int  # left out: behind planes
    uncovered: int  # pixels that show nothing
    ms: dict[str, float]  # wall time of each step


@dataclass(frozen=True, eq=False)
class WalkthroughImage:
    """Pictures of a walkthrough from B cameras."""

    cameras: Cameras
    image: Tensor  # (B,H,W,3) linear
    depth: Tensor  # (B,H,W) camera z; +inf where nothing is
    kind: Tensor  # (B,H,W) uint8: 0 nothing, 1 plane, 2 plane as filled in, 3 point, 4 closed gap
    statistics: tuple[DrawStatistics, ...]  # one per camera

    @property
    def covered(self) -> Tensor:
        """(B,H,W) bool: something is there."""
        return self.kind != NOTHING


def draw_walkthrough(
    walkthrough: Walkthrough, cameras: Cameras, options: DrawOptions | None = None
) -> WalkthroughImage:
    """Draw a walkthrough from B perspective cameras.

    Args:
        cameras: of any size; near planes cut what is closer.

    Raises:
        CameraError: orthographic cameras.
    """
    check_class("walkthrough", walkthrough, Walkthrough)
    check_class("cameras", cameras, Cameras)
    options = options_of(options, DrawOptions)
    if cameras.orthographic:
        raise CameraError("walkthroughs are drawn by perspective cameras only")
    shape = (len(cameras), cameras.height, cameras.width)
    image, depth = np.zeros((*shape, 3), np.float32), np.empty(shape, np.float32)
    kind = np.zeros(shape, np.uint8)
    statistics = tuple(
        _draw(walkthrough, cameras[n], options, (image[n], depth[n], kind[n])) for n in range(len(cameras))
    )
    pictures = (torch.from_numpy(image), torch.from_numpy(depth), torch.from_numpy(kind))
    return WalkthroughImage(cameras, *pictures, statistics)


def _draw(
    walkthrough: Walkthrough, camera: Cameras, options: DrawOptions, out: tuple[Array, Array, Array]
) -> DrawStatistics:
    image, depth, kind = out
    arrays = packed(walkthrough)
    ticks = [time.perf_counter()]
    if walkthrough.planes:
        _draw_planes(walkthrough, arrays, camera, out)
    else:
        depth.fill(np.inf)
    ticks.append(time.perf_counter())
    points = walkthrough.points
    seen = Visible(np.array([[0, len(points)]], np.int64), 0, 0)
    if len(points) and options.cull:
        seen = visible_runs(points, camera, arrays.occluders.shadows(camera.eye[0].numpy(), options.occluders))
    ticks.append(time.perf_counter())
    drawn = int((seen.runs[:, 1] - seen.runs[:, 0]).sum()) if len(points) else 0
    if drawn:
        if options.splats == "ewa":
            _draw_ewa(walkthrough, camera, out)
        else:
            _draw_squares(arrays, camera, options, seen.runs, out)
    ticks.append(time.perf_counter())
    if options.gap_pixels:
        close_gaps(out, options.gap_pixels)
    ticks.append(time.perf_counter())
    if options.view_colors and walkthrough.view_colors is not None:
        apply_view_colors(walkthrough.view_colors, camera, image, depth, arrays.diagonal, WORKSPACE)
    empty = kind == NOTHING
    if any(options.background):
        image[empty] = options.background
    ticks.append(time.perf_counter())
    ms = {n: 1e3 * (b - a) for n, a, b in zip(("planes", "cull", "points", "gaps", "view colours"), ticks, ticks[1:])}
    return DrawStatistics(len(points), drawn, seen.outside, seen.hidden, int(np.count_nonzero(empty)), ms)


def plane_matrices(frames: Array, camera: Cameras) -> Array:
    """(P,3,3) texel coordinates from homogeneous pixels: the inverse homography of each plane.

    ``frames`` (P,3,3) has in its columns the texel column, the texel row and the origin, world space.
    """
    k = camera.intrinsics[0].numpy()
    pose = camera.camera_from_world[0].numpy()
    # In the camera's frame. A plane through the eye has no inverse, and no pixel either.
    h = k @ (pose[:3, :3] @ frames + np.array([[0, 0, 1.0]]) * pose[:3, 3:])
    # Texels are small and origins far: the columns' own sizes say nothing about whether there is an inverse.
    size = np.maximum(np.linalg.norm(h, axis=1, keepdims=True), 1e-300)
    flat = np.abs(np.linalg.det(h / size)) < 1e-12
    h[flat] = np.eye(3)
    made = np.linalg.inv(h)
    made[flat] = 0.0
    made[flat, 2, 2] = 1.0
    return np.ascontiguousarray(made)


def _draw_planes(walkthrough: Walkthrough, arrays: Packed, camera: Cameras, out: tuple[Array, Array, Array]) -> None:
    image, depth, kind = out
    seen = rasterize_visibility(walkthrough.plane_scene.geometry, camera)
    depth[:] = seen.depth[0].numpy()
    matrices = plane_matrices(arrays.frames, camera)
    shade_planes(seen.triangle[0].numpy(), arrays.plane_of, matrices, walkthrough.atlas, image, kind)


_TABLE = srgb_table(8).numpy()


def _draw_squares(
    arrays: Packed, camera: Cameras, options: DrawOptions, runs: Array, out: tuple[Array, Array, Array]
) -> None:
    depth = out[1]
    height, width = depth.shape
    pose = camera.camera_from_world[0].numpy()[:3].copy()
    pose[:, 3] += pose[:, :3] @ arrays.origin
    k = camera.intrinsics[0].numpy()
    view = splat.View(
        matrix=pose,
        lens=np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]]),
        near=float(camera.near[0]),
        far=min(float(camera.far[0]), 1e30),
        cap=options.splat_cap,
        grow=options.splat_grow,
    )
    lengths = runs[:, 1] - runs[:, 0]
    starts = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.int64)
    records = WORKSPACE.floats("records", (int(lengths.sum()), splat.RECORD))
    splat.project(arrays.points, view, runs, starts, (width, height), records)
    space = (WORKSPACE.floats("near", (height, width)), WORKSPACE.floats("sums", (height, width, 4)))
    shares = splat.Shares(1.0 - PLANE_LEAD, BLEND_DEPTH, thread_count())
    splat.draw_points((arrays.points.color, _TABLE), runs, starts, records, shares, space, out)
    close_pinholes(*out, space[0])


_PATCHES: WeakKeyDictionary[Walkthrough, PatchSet] = WeakKeyDictionary()


def _draw_ewa(walkthrough: Walkthrough, camera: Cameras, out: tuple[Array, Array, Array]) -> None:
    """The point machinery's own filters; its depth against that of the planes."""
    image, depth, kind = out
    if walkthrough not in _PATCHES:
        _PATCHES[walkthrough] = build_patches(walkthrough.cloud())
    drawn = render_points(_PATCHES[walkthrough], camera, SplatOptions(shading="none", two_sided=True))
    near = drawn.depth[0].numpy()
    shown = (drawn.weight[0].numpy() > 0) & (near < depth * (1.0 - PLANE_LEAD))
    image[shown] = drawn.image[0].numpy()[shown]
    depth[shown] = near[shown]
    kind[shown] = POINT


def close_gaps(out: tuple[Array, Array, Array], pixels: int) -> None:
    """Pixels that show nothing within ``pixels`` of something take the colour of what is farthest among their
    neighbours, ring by ring, so that nothing in front grows."""
    image, depth, kind = out
    for _ in range(pixels):
        empty = kind == NOTHING
        if not empty.any():
            return
        known = ~empty
        total = cv2.boxFilter(known.astype(np.float32), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
        ring = empty & (total > 0)
        if not ring.any():
            return
        held = np.where(known, depth, 0.0).astype(np.float32)
        far = cv2.dilate(np.where(np.isfinite(held), held, 0.0), np.ones((3, 3)))
        rows, columns = np.nonzero(ring)
        weight, color = np.zeros(len(rows)), np.zeros((len(rows), 3))
        for dy in (-1, 0, 1):
            for dx in (-1, 0, 1):
                y, x = rows + dy, columns + dx
                inside = (y >= 0) & (x >= 0) & (y < depth.shape[0]) & (x < depth.shape[1])
                y, x = np.where(inside, y, 0), np.where(inside, x, 0)
                good = inside & known[y, x] & (depth[y, x] >= 0.95 * far[rows, columns])
                weight += good
                color += np.where(good[:, None], image[y, x], 0.0)
        image[rows, columns] = color / np.maximum(weight, 1)[:, None]
        depth[rows, columns] = far[rows, columns]
        kind[rows, columns] = GAP
