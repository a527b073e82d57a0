"""Colour that depends on the view: gloss, reflections, light that changed between photos.

A walkthrough has one colour for each place, the mean of what photos saw. What each photo saw differently is kept as a
small
picture, and added to pictures from near the photo; far from all photos the mean is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from torchrender.kernels.walkthrough.view_colors import SCALE, STEP, Looks, Residuals, add_residuals
from torchrender.numerics.color import srgb_table
from torchrender.scene.camera import Cameras
from torchrender.walkthrough.drawing.workspace import Workspace
from torchrender.walkthrough.frames.record import Array

PHOTOS = 5
"""Photos that one picture looks at, nearest first."""

TOLERANCE = 0.03
NEAR = 3e-4
REST = 1.0 / (NEAR + 0.06) ** 2
"""Weight of no change: that of a photo that looks from 20 degrees aside."""

SMOOTH = 0.06
"""Standard deviation of a sample's differences, in square roots of linear light, at which half of it counts."""

BYTES = 5
"""Of a sample: three of colour, two of depth."""


@dataclass(frozen=True, eq=False, kw_only=True)
class ViewColors:
    """N small residual pictures of h x w samples."""

    residual: Array  # (N,h,w,3) int8
    inverse_depth: Array  # (N,h,w) uint16
    unit: Array  # (N,) float64
    lens: Array  # (N,4) float64
    pose: Array  # (N,4,4) float64 camera from world

    @property
    def size_bytes(self) -> int:
        """Raw."""
        return int(BYTES * self.inverse_depth.size)

    @cached_property
    def forward(self) -> Array:
        """(N,3) world directions that the photos look in."""
        return np.ascontiguousarray(np.linalg.inv(self.pose)[:, :3, 2])

    @cached_property
    def arrays(self) -> Residuals:
        """For the kernels."""
        inverse = np.linalg.inv(self.pose)
        return Residuals(self.residual, self.inverse_depth, self.unit, self.lens,
                         np.ascontiguousarray(self.pose[:, :3]), np.ascontiguousarray(inverse[:, :3, 3]))  # fmt: skip


def residual_picture(photo: Array, depth: Array, drawn: Array, drawn_depth: Array, factor: int) -> tuple[Array, Array]:
    """Residual (h,w,3) int8 and inverse depth (h,w) float64, 0 where nothing is known, of a photo (H,W,3) uint8 against
    the model's picture (H,W,3) linear, both with their depths, ``factor`` times smaller.

    Only pixels count where the depths agree; so a sample is never the difference of two surfaces.
    """
    known = np.isfinite(drawn_depth) & (drawn_depth > 0)
    measured = np.isfinite(depth) & (depth > 0)
    both = known & measured
    agree = np.zeros_like(known)
    agree[both] = np.abs(depth[both] - drawn_depth[both]) < TOLERANCE * drawn_depth[both]
    # Background is no surface; where nothing was measured the photo still has its colours.
    known &= agree | (depth == 0)
    linear = srgb_table(8).numpy()[photo]
    change = np.where(known[..., None], np.sqrt(linear) - np.sqrt(np.clip(drawn, 0, 1)), 0.0)
    size = (-(-depth.shape[1] // factor), -(-depth.shape[0] // factor))
    share = cv2.resize(known.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    mean = (
        cv2.resize(change.astype(np.float32), size, interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)[..., None]
    )
    # Where the photo and the model differ by a line that lies elsewhere, the mean would be a halo: only what is
    # smooth counts.
    squares = cv2.resize(np.square(change).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    spread = np.maximum(squares / np.maximum(share, 1e-6)[..., None] - mean**2, 0.0).max(axis=2, keepdims=True)
    mean = mean / (1.0 + spread / SMOOTH**2)
    q = np.where(known, 1.0 / np.where(known, drawn_depth, 1.0), 0.0)
    inverse = cv2.resize(q.astype(np.float32), size, interpolation=cv2.INTER_AREA) / np.maximum(share, 1e-6)
    good = share > 0.3
    codes = np.clip(np.rint(mean * SCALE), -127, 127).astype(np.int8)
    return np.where(good[..., None], codes, 0).astype(np.int8), np.where(good, inverse, 0.0).astype(np.float64)


def pack(pictures: list[tuple[Array, Array]], lens: Array, pose: Array, size: tuple[int, int]) -> ViewColors:
    """All pictures together. ``lens`` (N,4) is that of photos of ``size`` height and width, ``pose`` (N,4,4)."""
    residual = np.stack([p[0] for p in pictures])
    inverse = np.stack([p[1] for p in pictures])
    unit = np.maximum(inverse.reshape(len(inverse), -1).max(1), 1e-30) / 65535
    codes = np.ceil(inverse / unit[:, None, None] - 0.5).clip(0, 65535)
    scale = np.array([residual.shape[2] / size[1], residual.shape[1] / size[0]])
    return ViewColors(
        residual=residual,
        inverse_depth=codes.astype(np.uint16),
        unit=unit,
        lens=lens * np.tile(scale, 2),
        pose=np.asarray(pose, np.float64),
    )


def nearest_photos(colors: ViewColors, eye: Array, forward: Array, diagonal: float) -> tuple[Array, Array]:
    """(K,) the photos that look from nearest and most alike, and (K,) how much each counts.

    The share falls to 0 towards the first that is not among them: so none appears or goes at once while the camera
    moves.
    """
    gap = np.linalg.norm(colors.arrays.eye - eye, axis=1) / max(diagonal, 1e-12)
    away = 4 * gap + 1.0 - colors.forward @ forward
    order = np.argsort(away, kind="stable")[: PHOTOS + 1]
    chosen, share = order[:PHOTOS], np.ones(min(len(order), PHOTOS))
    if len(order) > PHOTOS:
        share = 1.0 - away[chosen] / max(away[order[PHOTOS]], 1e-12)
        share = share / share.max() if share.max() > 1e-9 else np.ones(PHOTOS)
    by_number = np.argsort(chosen)
    return chosen[by_number], share[by_number]


def apply_view_colors(
    colors: ViewColors, camera: Cameras, image: Array, depth: Array, diagonal: float, workspace: Workspace
) -> None:
    """Add to a picture (H,W,3) linear with its depth (H,W), in place."""
    inverse = camera.world_from_camera[0].numpy()
    rays = np.ascontiguousarray(inverse[:3, :3] @ np.linalg.inv(camera.intrinsics[0].numpy()))
    eye = inverse[:3, 3].copy()
    chosen, share = nearest_photos(colors, eye, inverse[:3, 2], diagonal)
    looks = Looks(chosen, share, rays, eye, TOLERANCE, NEAR, REST)
    shape = ((depth.shape[0] - 1) // STEP + 2, (depth.shape[1] - 1) // STEP + 2)
    grid, known = workspace.floats("change", (*shape, 3)), workspace.floats("inverse", shape)
    add_residuals(colors.arrays, looks, depth, grid, known, image)
