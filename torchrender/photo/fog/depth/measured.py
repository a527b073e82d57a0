"""Depth that was measured: pictures of depth, stereo pairs, LiDAR, RGB-D cameras."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor

from torchrender.checks import check_finite, check_range, check_tensor
from torchrender.errors import ImageFileError, InputError
from torchrender.images.exr import read_exr_depth
from torchrender.images.files import MAX_PIXELS

SUFFIXES = (".png", ".exr", ".npy", ".npz")
LARGEST_DISPARITY = 512


def read_depth(path: str | Path, unit: float | None = None) -> Tensor:
    """(H,W) float32 metres of a depth image; +inf where it knows nothing (0, NaN, infinite).

    Args:
        path: ``.png`` of 16 bits, or of 8 where ``unit`` is given; ``.exr`` (its plane Z, else its only one: Y);
            ``.npy``; ``.npz`` (its array ``depth``, or its only one).
        unit: metres of a value of one; None: a millimetre in PNG, a metre elsewhere.

    Raises:
        ImageFileError: missing, damaged, of another kind, with more than one plane, or with several arrays of which
            none is named ``depth``.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise ImageFileError(path, f"depth is read from {', '.join(SUFFIXES)}")
    if not path.is_file():
        raise ImageFileError(path, "no such file")
    try:
        if suffix in (".npy", ".npz"):
            loaded = np.load(path, allow_pickle=False)
            array = _depth_array(path, loaded) if suffix == ".npz" else loaded
        elif suffix == ".png":
            with Image.open(path) as picture:
                array = np.array(picture)
        else:
            array = read_exr_depth(path, MAX_PIXELS)
    except (OSError, ValueError, IndexError) as error:
        raise ImageFileError(path, f"cannot be read: {error}") from error
    array = np.squeeze(array)
    if array.ndim != 2 or not array.size or array.dtype.kind not in "iuf":
        raise ImageFileError(path, f"depth must have one plane, got shape {array.shape}")
    if unit is None:
        if suffix == ".png" and array.dtype.itemsize == 1:
            raise ImageFileError(
                path, "has 8 bits, too few for millimetres: give the unit of its values (--depth-unit)"
            )
        unit = 1e-3 if suffix == ".png" else 1.0
    check_range("unit", unit, 1e-9, 1e6)
    depth = array.astype(np.float32) * np.float32(unit)
    return torch.from_numpy(np.where(np.isfinite(depth) & (depth > 0), depth, np.inf).astype(np.float32))


def _depth_array(path: Path, loaded: Mapping[str, np.ndarray]) -> np.ndarray:
    names = list(loaded)
    if "depth" not in names and len(names) != 1:
        raise ImageFileError(path, f"needs an array named depth, has {', '.join(names) or 'none'}")
    return loaded["depth" if "depth" in names else names[0]]


def filled(depth: Tensor, sky: Tensor | None = None, farthest: float = 5000.0) -> Tensor:
    """(H,W) float64 depth without gaps: those in the sky (H,W) bool are far away, others take the nearest known value.

    Raises:
        InputError: nothing is known.
    """
    check_tensor("depth", depth, ("H", "W"))
    known = torch.isfinite(depth) & (depth > 0)
    if not bool(known.any()):
        raise InputError("depth knows no pixel: all are 0, NaN or infinite")
    found = depth.double()
    if not bool(known.all()):
        empty = (~known).numpy().astype(np.uint8)
        _, nearest = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
        values = np.zeros(int(nearest.max()) + 1)
        values[nearest[empty == 0]] = depth.numpy()[empty == 0]
        found = torch.where(known, found, torch.from_numpy(values[nearest]))
    if sky is not None:
        found = torch.where(sky, farthest, found)
    return found.clamp(1e-3, farthest)


def depth_from_stereo(
    left: Tensor, right: Tensor, *, focal: float, baseline: float, offset: float = 0.0, disparities: int = 0
) -> Tensor:
    """(H,W) float32 metres of the left picture, +inf where the pair does not tell.

    ``z = focal baseline / (d + offset)``.

    Semi-global matching (Hirschmueller 2008) as OpenCV has it, in rectified pictures.

    Args:
        left, right: (H,W,C) linear light. focal: pixels. baseline: metres.
        offset: disparity of infinitely far things, pixels.
        disparities: range searched; 0: an eighth of the width.

    Raises:
        InputError: pictures of different sizes.
    """
    if left.shape[:2] != right.shape[:2]:
        raise InputError(
            f"stereo pictures must have one size, got {tuple(left.shape[:2])} and {tuple(right.shape[:2])}"
        )
    check_range("focal", focal, 1.0, 1e6)
    check_range("baseline", baseline, 1e-4, 1e3)
    check_range("disparities", disparities, 0, LARGEST_DISPARITY)
    wide = disparities or left.shape[1] // 8
    count = max(16, -(-wide // 16) * 16)
    codes = [
        (p[..., :3].clamp(0.0, 1.0).sqrt() * 255).round().byte().expand(-1, -1, 3).contiguous().numpy()
        for p in (left, right)
    ]
    block = 5
    matcher = cv2.StereoSGBM.create(
        minDisparity=0, numDisparities=count, blockSize=block, P1=8 * 3 * block**2, P2=32 * 3 * block**2,
        disp12MaxDiff=1,
        uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    found = torch.from_numpy(matcher.compute(codes[0], codes[1]).astype(np.float32)) / 16.0
    usable = (found > 0) & (found + offset > 1e-6)
    return torch.where(usable, focal * baseline / (found + offset).clamp_min(1e-6), torch.inf)


def depth_from_points(points: Tensor, projection: Tensor, width: int, height: int) -> Tensor:
    """(H,W) float32 metres of points of a laser scanner, +inf between them; the nearest one counts in each pixel.

    Args:
        points: (N,3), any frame.
        projection: (3,4) pixels times depth from that frame, such as ``P2 R0 Tr`` of KITTI.
    """
    check_tensor("points", points, ("N", 3))
    check_tensor("projection", projection, (3, 4))
    check_finite("projection", projection)
    p = points.double()
    p = p[torch.isfinite(p).all(dim=1)]
    seen = p @ projection[:, :3].double().T + projection[:, 3].double()
    z = seen[:, 2]
    u, v = seen[:, 0] / z, seen[:, 1] / z
    kept = (z > 0.1) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
    index = v[kept].long() * width + u[kept].long()
    out = torch.full((height * width,), torch.inf, dtype=torch.float64)
    return out.scatter_reduce(0, index, z[kept], "amin").reshape(height, width).float()


def dense_from_points(sparse: Tensor, radius: int = 9) -> Tensor:
    """(H,W) float32 depth between the rows of a laser scanner; +inf where none is near, above all its rows.

    Between returns 1/z is an average of the nearer ones: what lies behind shines through the gaps otherwise.
    """
    known = torch.isfinite(sparse)
    inverse = torch.where(known, 1.0 / sparse, 0.0).numpy()
    size = 2 * radius + 1
    nearest = cv2.dilate(inverse, np.ones((size, 5), np.uint8))
    kept = np.where(inverse >= 0.6 * nearest, inverse, 0.0)
    weight = cv2.GaussianBlur((kept > 0).astype(np.float32), (0, 0), radius / 3)
    mean = cv2.GaussianBlur(kept.astype(np.float32), (0, 0), radius / 3) / np.maximum(weight, 1e-6)
    return torch.from_numpy(np.where(weight > 1e-3, 1.0 / np.maximum(mean, 1e-6), np.inf).astype(np.float32))


def read_lidar(points: str | Path, calibration: str | Path, camera: str = "P2") -> tuple[Tensor, Tensor]:
    """Points (N,3) and projection (3,4) float64 of files of the KITTI object benchmark.

    Raises:
        ImageFileError: missing or damaged files; names the file.
    """
    path = Path(points)
    try:
        raw = np.fromfile(path, dtype=np.float32)
    except OSError as error:
        raise ImageFileError(path, "no such file" if isinstance(error, FileNotFoundError) else str(error)) from error
    if raw.size % 4 or not raw.size:
        raise ImageFileError(path, f"points must be four float32 each, got {raw.size} numbers")
    path = Path(calibration)
    try:
        lines = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
        matrices = {k: np.array([float(v) for v in text.split()]) for k, text in lines.items()}
        p, r, t = matrices[camera].reshape(3, 4), matrices["R0_rect"].reshape(3, 3), matrices["Tr_velo_to_cam"]
        velo = np.vstack([t.reshape(3, 4), [0, 0, 0, 1]])
    except OSError as error:
        raise ImageFileError(path, "no such file" if isinstance(error, FileNotFoundError) else str(error)) from error
    except (KeyError, ValueError) as error:
        raise ImageFileError(path, f"is no calibration with {camera}, R0_rect and Tr_velo_to_cam: {error}") from error
    rect = np.eye(4)
    rect[:3, :3] = r
    return torch.from_numpy(raw.reshape(-1, 4)[:, :3].copy()), torch.from_numpy(p @ rect @ velo)
