"""What a sequence of RGB-D photos is: poses and intrinsics in memory, pictures read as they are needed."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor

from torchrender.brief import brief
from torchrender.checks import check_tensor
from torchrender.errors import CameraError, ImageFileError, InputError, SceneFileError
from torchrender.images.files import picture_bytes
from torchrender.numerics.color import srgb_from_linear

Array = np.ndarray[Any, Any]

NO_DEPTH_CODES = (0, 65535)
"""Codes of depth images that mean that nothing was measured."""


class CaptureWarning(UserWarning):
    """Something of a capture was left out or looks wrong; says what."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Frame:
    """One photo with depth. Pictures come from files, or are there already.

    Raises:
        CameraError: a pose that is not rigid, or intrinsics without positive focal lengths; names the frame.
    """

    name: str
    world_from_camera: Array  # (4,4) float64, OpenCV axes: x right, y down, z forward
    intrinsics: Array  # (3,3) float64, pixel centres at +0.5
    color: Path | Array  # file, or (H,W,3) uint8 sRGB codes
    depth: Path | Array | None  # file, or (H,W) float32 camera z, 0 unknown, +inf background; None: there is none
    depth_scale: float = 1000.0  # codes of a depth file per scene unit
    time: float | None = None  # seconds

    def __post_init__(self) -> None:
        pose, k = np.asarray(self.world_from_camera, np.float64), np.asarray(self.intrinsics, np.float64)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise CameraError(f"frame {self.name}: the pose must be 4x4 finite numbers")
        turn = pose[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-2 or np.linalg.det(turn) < 0:
            raise CameraError(
                f"frame {self.name}: the pose must be rigid: rotation and translation, no scale or mirror"
            )
        # Poses in text files have few digits: the nearest rotation.
        u, _, vt = np.linalg.svd(turn)
        pose = pose.copy()
        pose[:3, :3] = u @ vt
        pose[3] = (0, 0, 0, 1)
        if k.shape != (3, 3) or not np.isfinite(k).all() or min(k[0, 0], k[1, 1]) <= 0:
            raise CameraError(
                f"frame {self.name}: intrinsics must be 3x3 with positive focal lengths, got {k.tolist()}"
            )
        if abs(k[0, 1]) > 1e-6 * k[0, 0]:
            raise CameraError(f"frame {self.name}: intrinsics with skew are not supported")
        if not (math.isfinite(self.depth_scale) and self.depth_scale > 0):
            raise CameraError(f"frame {self.name}: depth_scale must be > 0, got {self.depth_scale}")
        object.__setattr__(self, "world_from_camera", pose)
        object.__setattr__(self, "intrinsics", k)

    def read_color(self) -> Array:
        """(H,W,3) uint8 sRGB codes.

        Raises:
            ImageFileError: missing, damaged or no picture.
        """
        if not isinstance(self.color, Path):
            return self.color
        codes = _decode(self.color, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        return np.ascontiguousarray(codes[..., ::-1])

    def read_depth(self) -> Array | None:
        """(H,W) float32 camera z in scene units: 0 where nothing is known, +inf where the camera looks past everything.

        Raises:
            ImageFileError: missing, damaged or no depth image.
        """
        if self.depth is None or not isinstance(self.depth, Path):
            return self.depth
        if self.depth.suffix.lower() == ".npy":
            return _read_array(self.depth)
        codes = _decode(self.depth, cv2.IMREAD_UNCHANGED)
        if codes.ndim != 2 or codes.dtype not in (np.uint16, np.uint8):
            raise ImageFileError(
                self.depth, f"a depth image has one channel of 16 bits, got {codes.dtype} {codes.shape}"
            )
        depth = codes.astype(np.float32) / np.float32(self.depth_scale)
        depth[np.isin(codes, NO_DEPTH_CODES)] = 0.0
        return depth

    def depth_size(self) -> tuple[int, int] | None:
        """Height and width of the depth image by its file's beginning alone; None where that does not tell."""
        if self.depth is None or not isinstance(self.depth, Path):
            return None if self.depth is None else (int(self.depth.shape[0]), int(self.depth.shape[1]))
        try:
            if self.depth.suffix.lower() == ".npy":
                shape = np.load(self.depth, mmap_mode="r", allow_pickle=False).shape
                return (int(shape[0]), int(shape[1])) if len(shape) == 2 else None
            with Image.open(self.depth) as picture:
                return picture.height, picture.width
        except (OSError, ValueError, EOFError, Image.DecompressionBombError):
            return None

    def check_size(self, height: int, width: int) -> None:
        """Refuse intrinsics that belong to pictures of another size.

        Raises:
            CameraError: the principal point lies outside the picture, or the opening angle is out of all reason.
        """
        k = self.intrinsics
        inside = 0.1 * width < k[0, 2] < 0.9 * width and 0.1 * height < k[1, 2] < 0.9 * height
        if not inside or not 0.1 < k[0, 0] / width < 20:
            raise CameraError(
                f"frame {self.name}: intrinsics fx={k[0, 0]:g} cx={k[0, 2]:g} cy={k[1, 2]:g} do not belong to a picture"
                f" of {width}x{height}"
            )


@dataclass(frozen=True, eq=False)
class RgbdSequence:
    """Photos of one place, in the order of their names or times.

    Raises:
        InputError: no frames.
    """

    frames: tuple[Frame, ...]
    name: str = "capture"

    __repr__ = brief

    def __post_init__(self) -> None:
        if not self.frames:
            raise InputError("a sequence must have at least one frame")

    def __len__(self) -> int:
        return len(self.frames)

    @classmethod
    def from_tensors(
        cls, images: Tensor, depths: Tensor, intrinsics: Tensor, rotation: Tensor, translation: Tensor
    ) -> RgbdSequence:
        """From photos in memory.

        Args:
            images: (N,3,H,W) linear light in [0,1].
            depths: (N,1,H,W) camera z; +inf where there is nothing, 0 or NaN where nothing is known.
            intrinsics: (N,3,3), pixel centres at +0.5. rotation (N,3,3), translation (N,3): camera from world.

        Raises:
            InputError: shapes that do not fit. CameraError: a pose or intrinsics that are none.
        """
        count, _, height, width = check_tensor("images", images, ("N", 3, "H", "W")).shape
        check_tensor("depths", depths, (count, 1, height, width))
        check_tensor("intrinsics", intrinsics, (count, 3, 3))
        check_tensor("rotation", rotation, (count, 3, 3))
        check_tensor("translation", translation, (count, 3))
        codes = (srgb_from_linear(images.float().clamp(0, 1)) * 255 + 0.5).to(torch.uint8).permute(0, 2, 3, 1)
        depth = depths[:, 0].float().nan_to_num(0.0, posinf=torch.inf, neginf=0.0).clamp_min(0.0)
        frames = []
        for n in range(count):
            pose = np.eye(4)
            turn = rotation[n].double().numpy()
            pose[:3, :3], pose[:3, 3] = turn.T, -turn.T @ translation[n].double().numpy()
            frames.append(
                Frame(
                    name=f"{n:05d}",
                    world_from_camera=pose,
                    intrinsics=intrinsics[n].double().numpy(),
                    color=codes[n].contiguous().numpy(),
                    depth=depth[n].contiguous().numpy(),
                )
            )
        return cls(tuple(frames))

    def split(self, every: int) -> tuple[RgbdSequence, RgbdSequence | None]:
        """The frames to build from, and every ``every``-th one held out (0: none)."""
        if every <= 0 or len(self) < 2:
            return self, None
        held = [f for n, f in enumerate(self.frames) if n % every == every // 2]
        kept = [f for n, f in enumerate(self.frames) if n % every != every // 2]
        return replace(self, frames=tuple(kept)), replace(self, frames=tuple(held)) if held else None


def _decode(path: Path, flags: int) -> Array:
    data = picture_bytes(path)
    try:
        codes = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    except cv2.error as error:
        raise ImageFileError(path, "damaged picture") from error
    if codes is None:
        raise ImageFileError(path, "damaged, cut off or no picture")
    return np.asarray(codes)


def _read_array(path: Path) -> Array:
    try:
        depth = np.load(path, allow_pickle=False)
    except (OSError, ValueError, EOFError) as error:
        raise ImageFileError(path, f"no array of depths ({error})") from error
    if depth.ndim != 2 or not np.issubdtype(depth.dtype, np.floating):
        raise ImageFileError(path, f"depth must be (H, W) floats, got {depth.dtype} {depth.shape}")
    depth = np.nan_to_num(depth.astype(np.float32), nan=0.0, posinf=np.inf, neginf=0.0)
    return np.maximum(depth, 0.0)


__all__ = ["CaptureWarning", "Frame", "RgbdSequence", "SceneFileError"]
