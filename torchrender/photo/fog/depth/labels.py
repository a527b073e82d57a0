"""Depth of an outdoor photo from labels: ground, vertical things, sky.

Source: specification 12, section 5: on flat ground 1/z is linear in the row, a vertical thing stands at one depth.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from PIL import Image
from torch import Tensor

from torchrender.errors import ImageFileError, InputError
from torchrender.photo.fog.marks.records import LABELS, Marks
from torchrender.photo.fog.options import FogWarning
from torchrender.photo.fog.picture import polygon_mask
from torchrender.scene.camera import Cameras

GROUND, VERTICAL, SKY = range(3)
SMALLEST_PART = 16  # pixels


@dataclass(frozen=True, eq=False)
class Labelled:
    """Labels and depth of a photo."""

    label: Tensor  # (H,W) int64: 0 ground, 1 vertical, 2 sky
    depth: Tensor  # (H,W) float64 camera z, metres


def outdoor_camera(marks: Marks, width: int, height: int) -> Cameras:
    """A camera over level ground, tilted so that the marked horizon lies where it does."""
    mark = marks.camera
    focal = mark.focal or float(max(width, height))
    cx, cy = mark.center or (width / 2, height / 2)
    tilt = 0.0 if mark.horizon is None else math.atan2(mark.horizon - cy, focal)
    if abs(tilt) > math.radians(80.0):
        raise InputError(f"the horizon at row {mark.horizon} tilts the camera by more than 80 degrees")
    # Down the image by so much is up the slope of the camera.
    turn = np.array([[1, 0, 0], [0, -math.cos(tilt), -math.sin(tilt)], [0, math.sin(tilt), -math.cos(tilt)]])
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ np.array([0.0, mark.height, 0.0])
    k = torch.tensor([[focal, 0, cx], [0, focal, cy], [0, 0, 1]], dtype=torch.float64)
    near, far = torch.tensor(1e-3, dtype=torch.float64), torch.tensor(math.inf, dtype=torch.float64)
    return Cameras(torch.from_numpy(matrix)[None], k[None], width, height, near, far)


def label_map(marks: Marks, width: int, height: int, given: Tensor | None = None) -> Tensor:
    """(H,W) int64 labels: a given map with the marked regions painted over it.

    Raises:
        InputError: a map of another size, or with other values than 0, 1 and 2; nothing that tells labels.
    """
    if given is None and not marks.regions:
        raise InputError("an outdoor photo needs labels or regions, or a depth image")
    if given is None:
        label = torch.zeros(height, width, dtype=torch.int64)
    else:
        if given.dim() != 2:
            raise InputError(f"labels must have shape (H, W), got {tuple(given.shape)}")
        if not bool(((given >= 0) & (given <= 2)).all()):
            raise InputError(f"labels must be 0, 1 or 2, got values up to {int(given.max())}")
        label = given.long()
        if label.shape != (height, width):
            if abs(label.shape[1] / label.shape[0] - width / height) > 0.02:
                raise InputError(
                    f"labels must have the photo's size {width}x{height}, got {label.shape[1]}x{label.shape[0]}"
                )
            grown = cv2.resize(label.numpy().astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
            label = torch.from_numpy(grown).long()
    label = label.clone()
    for number, region in enumerate(marks.regions):
        mask = polygon_mask(region.polygon, height, width)
        if not bool(mask.any()):
            warnings.warn(f"region[{number}] lies outside the photo", FogWarning, stacklevel=3)
        label[mask] = LABELS.index(region.label)
    return label


def inverse_depth_of_rows(label: Tensor, marks: Marks, camera: Cameras) -> Tensor:
    """(H,) float64 1/z of the ground at every row: linear between the marked depths, or of level ground."""
    h = label.shape[0]
    outdoor = marks.outdoor
    rows = (label == GROUND).any(dim=1).nonzero()[:, 0]
    first, last = (int(rows.min()), int(rows.max())) if len(rows) else (h // 2, h - 1)
    focal, cy = float(camera.intrinsics[0, 1, 1]), float(camera.intrinsics[0, 1, 2])
    turn = camera.rotation[0]
    row = torch.arange(h, dtype=torch.float64) + 0.5
    # World height lost per unit of camera z along a row's middle ray.
    fall = -(turn[1, 1] * (row - cy) / focal + turn[2, 1])
    level = (fall / camera.eye[0, 1]).clamp_min(1.0 / outdoor.sky)
    near = 1.0 / outdoor.near if outdoor.near is not None else float(level[last])
    far = 1.0 / outdoor.far if outdoor.far is not None else min(float(level[first]), near)
    if outdoor.near is None and outdoor.far is None:
        return level
    if last == first:
        return torch.full((h,), near, dtype=torch.float64)
    share = ((torch.arange(h, dtype=torch.float64) - first) / (last - first)).clamp(0.0, 1.0)
    return far + (near - far) * share


def depth_from_labels(label: Tensor, marks: Marks, camera: Cameras) -> Labelled:
    """Depth of a label map (H,W)."""
    h, w = label.shape
    inverse = inverse_depth_of_rows(label, marks, camera)
    depth = (1.0 / inverse)[:, None].expand(h, w).clone()
    standing = (label == VERTICAL).numpy().astype(np.uint8)
    owned = np.zeros((h, w), bool)
    for region in reversed(marks.regions):
        if region.label != "vertical":
            continue
        mask = polygon_mask(region.polygon, h, w).numpy() & (standing > 0) & ~owned
        owned |= mask
        if mask.any():
            lowest = int(np.flatnonzero(mask.any(axis=1)).max())
            depth[torch.from_numpy(mask)] = region.depth or float(1.0 / inverse[lowest])
    count, parts = cv2.connectedComponents(standing * (~owned).astype(np.uint8), connectivity=4)
    for part in range(1, count):
        mask = parts == part
        lowest = int(np.flatnonzero(mask.any(axis=1)).max())
        depth[torch.from_numpy(mask)] = float(1.0 / inverse[lowest])
    depth[label == SKY] = marks.outdoor.sky
    return Labelled(label, depth.clamp_max(marks.outdoor.sky))


def soft_sky(photo: Tensor, labelled: Labelled, radius: int) -> Tensor:
    """(H,W) float32 share of sky in each pixel: the sky's outline, softened along the photo's own edges.

    A guided filter: bright rims between sky and what stands before it are those of a hard outline.
    """
    hard = (labelled.label == SKY).float()
    if radius == 0 or not bool((hard > 0).any()) or bool((hard > 0).all()):
        return hard
    guide = photo.clamp(0.0, 1.0).sqrt().numpy()
    size = 2 * radius + 1
    soft = guided(guide.mean(axis=2), hard.numpy(), size)
    near = cv2.dilate(hard.numpy(), np.ones((size, size), np.uint8)) - cv2.erode(
        hard.numpy(), np.ones((size, size), np.uint8)
    )
    found = np.where(near > 0, np.clip(soft, 0.0, 1.0), hard.numpy())
    return torch.from_numpy(found.astype(np.float32))


def guided(guide: np.ndarray, image: np.ndarray, size: int, eps: float = 1e-3) -> np.ndarray:
    """``image`` (H,W) with the edges of ``guide`` (H,W), over windows of ``size`` pixels (He, Sun and Tang 2013).

    kornia's ``guided_blur`` gives the same and takes 15 to 30 times as long (docs/libraries.md).
    """

    def mean(x: np.ndarray) -> np.ndarray:
        return cv2.blur(x, (size, size), borderType=cv2.BORDER_REFLECT)

    m, p = mean(guide), mean(image)
    a = (mean(guide * image) - m * p) / (mean(guide * guide) - m * m + eps)
    out: np.ndarray = mean(a) * guide + mean(p - a * m)
    return out


def read_labels(path: str | Path) -> Tensor:
    """(H,W) int64 labels of a grey or palette picture whose values are the labels.

    Raises:
        ImageFileError: missing, damaged, or with colours; names the file.
    """
    path = Path(path)
    try:
        with Image.open(path) as picture:
            codes = np.array(picture)
    except FileNotFoundError as error:
        raise ImageFileError(path, "no such file") from error
    except (OSError, ValueError) as error:
        raise ImageFileError(path, f"cannot be read: {error}") from error
    if codes.ndim != 2 or codes.dtype.kind not in "iub":
        raise ImageFileError(path, f"labels must be one plane of whole numbers, got shape {codes.shape}")
    return torch.from_numpy(codes.astype(np.int64))
