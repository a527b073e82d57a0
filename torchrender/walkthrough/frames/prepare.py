"""Photos made ready: chosen, read once, depth filtered, normals estimated, edges marked."""

from __future__ import annotations

import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from torchrender.errors import CameraError, ImageFileError, InputError, TorchRenderError
from torchrender.kernels.walkthrough.density import Photos
from torchrender.walkthrough.frames.depth import (
    median_depth,
    noise_of,
    normals,
    one_sided_normals,
    smoothing,
    step_edges,
)
from torchrender.walkthrough.frames.jobs import Jobs
from torchrender.walkthrough.frames.record import Array, CaptureWarning, Frame, RgbdSequence
from torchrender.walkthrough.frames.rim import empty_rim
from torchrender.walkthrough.options import WalkthroughOptions

Progress = Callable[[Iterable[Any], str], Iterable[Any]]

EXACT = 2e-5
"""Noise of depth, share of depth, below which it counts as exact: no filter, narrow tolerances."""


def quiet(items: Iterable[Any], stage: str) -> Iterable[Any]:
    """No progress to show."""
    del stage
    return items


@dataclass(eq=False, kw_only=True)
class Capture:
    """N photos of H x W pixels, as every stage of a build reads them."""

    names: tuple[str, ...]
    pose: Array  # (N,4,4) float64 world from camera
    lens: Array  # (N,4) float64 fx, fy, cx, cy
    color: Array  # (N,H,W,3) uint8
    depth: Array  # (N,H,W) float32; 0 unknown, +inf background
    normal: Array  # (N,H,W,3) int16, 32767 times the unit normal, camera frame
    plane: Array  # (N,H,W) int32
    guard: Array  # (N,H,W) uint8
    feather: Array  # (N,H,W) uint8
    noise: Array  # (N,) float64 standard deviation of inverse depth
    log_quality: Array  # (N,) float64 added to log density: less for blurred photos
    gain: Array  # (N,) float64 factor of linear light that was applied
    left_out: dict[str, str] = field(default_factory=dict)  # reason by name of the frame
    color_shift: Array = field(default_factory=lambda: np.eye(2, 3))  # (2,3) colour pixel of a depth pixel
    folder: Any = None  # keeps a temporary folder alive

    def __len__(self) -> int:
        return len(self.names)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        return int(self.depth.shape[1]), int(self.depth.shape[2])

    @property
    def camera_from_world(self) -> Array:
        """(N,4,4)."""
        return np.linalg.inv(self.pose)

    @property
    def photos(self) -> Photos:
        """For kernels."""
        return Photos(self.color, self.depth, self.normal, self.plane, self.guard, self.feather, self.lens,
                      self.log_quality, self.noise)  # fmt: skip

    @cached_property
    def relative_noise(self) -> float:
        """Noise of depth as a share of depth, in the middle of what was measured."""
        sample = self.depth[:: max(len(self) // 8, 1), ::7, ::7]
        known = sample[(sample > 0) & np.isfinite(sample)]
        return float(np.median(self.noise) * np.median(known)) if known.size else 0.0

    @property
    def exact(self) -> bool:
        """Depth without noise, as from a renderer."""
        return self.relative_noise < EXACT

    def points(self, i: int, rows: Array, columns: Array) -> Array:
        """(K,3) float64 camera-space points of pixels."""
        z = self.depth[i, rows, columns].astype(np.float64)
        fx, fy, cx, cy = self.lens[i]
        return np.stack([(columns + 0.5 - cx) / fx * z, (rows + 0.5 - cy) / fy * z, z], axis=1)

    def diagonal(self) -> float:
        """Length of the box around what was measured (its middle 98 %), scene units."""
        parts = []
        for i in range(len(self)):
            rows, columns = np.mgrid[4 : self.size[0] : 16, 4 : self.size[1] : 16].reshape(2, -1)
            known = np.isfinite(self.depth[i, rows, columns]) & (self.depth[i, rows, columns] > 0)
            p = self.points(i, rows[known], columns[known])
            parts.append(p @ self.pose[i, :3, :3].T + self.pose[i, :3, 3])
        cloud = np.concatenate(parts) if parts else np.zeros((0, 3))
        if not len(cloud):
            return 1.0
        low, high = np.percentile(cloud, (1, 99), axis=0)
        return max(float(np.linalg.norm(high - low)), 1e-9)


def choose_frames(
    sequence: RgbdSequence, options: WalkthroughOptions, progress: Progress = quiet
) -> tuple[list[Frame], dict[str, str]]:
    """The frames to build from, and why others are not: no depth, or more of them than ``max_frames``.

    Of longer sequences equal parts are made and the sharpest frame of each is taken.
    """
    left_out = {f.name: "no depth" for f in sequence.frames if f.depth is None}
    with_depth = [f for f in sequence.frames if f.depth is not None]
    if not with_depth:
        raise InputError(f"{sequence.name}: no frame has depth")
    if len(with_depth) <= options.max_frames:
        return with_depth, left_out
    sharp = [_sharpness(f) for f in progress(with_depth, "choose frames")]
    chosen = []
    for part in np.array_split(np.arange(len(with_depth)), options.max_frames):
        best = part[int(np.argmax([sharp[n] for n in part]))]
        chosen.append(with_depth[best])
        left_out |= {with_depth[n].name: f"one of {len(part)} neighbours was sharper" for n in part if n != best}
    return chosen, left_out


def _sharpness(frame: Frame) -> float:
    """Mean square of the Laplacian at half size; -1 for a picture that cannot be read."""
    try:
        grey = cv2.cvtColor(frame.read_color(), cv2.COLOR_RGB2GRAY)
    except ImageFileError:
        return -1.0
    small = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return float(np.square(cv2.Laplacian(small, cv2.CV_32F)).mean())


def read_frame(frame: Frame) -> tuple[Array, Array, Array]:
    """Colour (H,W,3) uint8, depth (H,W) float32 and lens (4,), all of the depth's size.

    Raises:
        ImageFileError: a file that cannot be used. CameraError: intrinsics of another size.
    """
    color, depth = frame.read_color(), frame.read_depth()
    if depth is None:
        raise InputError(f"frame {frame.name} has no depth")
    height, width = color.shape[:2]
    frame.check_size(height, width)
    k = frame.intrinsics
    lens = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    if depth.shape != (height, width):
        scale = np.array([depth.shape[1] / width, depth.shape[0] / height])
        if abs(scale[0] / scale[1] - 1) > 0.01:
            raise ImageFileError(
                frame.name, f"colour is {width}x{height}, depth {depth.shape[1]}x{depth.shape[0]}: another shape"
            )
        color = cv2.resize(color, (depth.shape[1], depth.shape[0]), interpolation=cv2.INTER_AREA)
        lens = lens * np.tile(scale, 2)
    return color, np.asarray(depth, np.float32), lens


def prepare(sequence: RgbdSequence, options: WalkthroughOptions, progress: Progress = quiet) -> Capture:
    """Read and prepare the frames of a sequence. Frames that cannot be used are left out, with a warning that names
    them.

    Raises:
        InputError: no frame is usable.
    """
    frames, left_out = choose_frames(sequence, options, progress)
    size = _usual_size(frames)
    capture: Capture | None = None
    used: list[Frame] = []
    seen: set[tuple[bytes, int]] = set()
    jobs = Jobs()
    for frame, read in progress(jobs.ordered(_read_or_error, frames), "read photos"):
        if isinstance(read, TorchRenderError):
            left_out[frame.name] = str(read)
            continue
        color, depth, lens = read
        print_ = (np.round(frame.world_from_camera, 9).tobytes(), hash(color.tobytes()))
        if capture is None:
            capture = _allocate(len(frames), size or depth.shape, options)
        if depth.shape != capture.size:
            left_out[frame.name] = (
                f"depth is {depth.shape[1]}x{depth.shape[0]}, that of most is {capture.size[1]}x{capture.size[0]}"
            )
        elif print_ in seen:
            left_out[frame.name] = "a duplicate"
        elif not ((depth > 0) & np.isfinite(depth)).any():
            left_out[frame.name] = "its depth is empty"
        else:
            seen.add(print_)
            quantum = 1.0 / frame.depth_scale if isinstance(frame.depth, Path) and frame.depth.suffix != ".npy" else 0.0
            capture.pose[len(used)] = frame.world_from_camera
            jobs.start(_fill, capture, len(used), (color, depth, lens), quantum)
            used.append(frame)
    jobs.finish()
    _say(sequence.name, left_out)
    if capture is None or not used:
        first = next(iter(left_out.items()), ("", "no frames"))
        raise InputError(f"{sequence.name}: no frame can be used; {first[0]}: {first[1]}")
    return _cut(capture, tuple(f.name for f in used), left_out)


def _usual_size(frames: Sequence[Frame]) -> tuple[int, int] | None:
    """Height and width that most depth images have: one of another size must not decide for all."""
    sizes = Counter(size for size in (frame.depth_size() for frame in frames) if size is not None)
    return sizes.most_common(1)[0][0] if sizes else None


def _read_or_error(frame: Frame) -> tuple[Array, Array, Array] | TorchRenderError:
    try:
        return read_frame(frame)
    except (ImageFileError, CameraError) as error:
        return error


def _say(name: str, left_out: dict[str, str]) -> None:
    reasons: dict[str, list[str]] = {}
    for frame, reason in left_out.items():
        reasons.setdefault("fewer are enough" if "neighbours" in reason else reason, []).append(frame)
    for reason, frames in reasons.items():
        shown = ", ".join(frames[:5]) + (", ..." if len(frames) > 5 else "")
        warnings.warn(f"{name}: {len(frames)} frames left out, {reason}: {shown}", CaptureWarning, stacklevel=3)


def _allocate(count: int, size: Sequence[int], options: WalkthroughOptions) -> Capture:
    shape = (count, *size)
    kinds: dict[str, tuple[tuple[int, ...], type]] = {
        "color": ((*shape, 3), np.uint8),
        "depth": (shape, np.float32),
        "normal": ((*shape, 3), np.int16),
        "plane": (shape, np.int32),
        "guard": (shape, np.uint8),
        "feather": (shape, np.uint8),
    }
    total = sum(int(np.prod(s)) * np.dtype(d).itemsize for s, d in kinds.values())
    folder = None
    if total > options.memory_mb * 2**20:
        folder = tempfile.TemporaryDirectory(prefix="walkthrough-")
        home = Path(folder.name)
        arrays: dict[str, Any] = {
            name: np.memmap(home / name, dtype=d, mode="w+", shape=s) for name, (s, d) in kinds.items()
        }
    else:
        arrays = {name: np.zeros(s, d) for name, (s, d) in kinds.items()}
    return Capture(
        names=(),
        pose=np.zeros((count, 4, 4)),
        lens=np.zeros((count, 4)),
        noise=np.zeros(count),
        log_quality=np.zeros(count),
        gain=np.ones(count),
        folder=folder,
        **arrays,
    )


def _cut(capture: Capture, names: tuple[str, ...], left_out: dict[str, str]) -> Capture:
    n = len(names)
    fields = ("pose", "lens", "color", "depth", "normal", "plane", "guard", "feather", "noise", "log_quality", "gain")
    return replace(capture, names=names, left_out=left_out, **{name: getattr(capture, name)[:n] for name in fields})


def _fill(capture: Capture, n: int, read: tuple[Array, Array, Array], quantum: float) -> None:
    color, depth, lens = read
    rim = empty_rim(color)
    if rim.any() and (np.where(rim, 0.0, depth) > 0).any():
        depth = np.where(rim, np.float32(0.0), depth)
    known = (depth > 0) & np.isfinite(depth)
    middle = float(np.median(depth[known]))
    # Whole codes have an error of their own, which vanishes from most differences but not from slopes.
    noise = max(noise_of(depth), quantum / 12**0.5 / middle**2)
    if noise * middle >= EXACT:
        # Sensors step: neighbours are often alike, and only samples farther apart tell how far they are off.
        noise = max(noise, *(noise_of(depth, lag) for lag in (2, 4)))
    if noise * middle >= EXACT:
        depth = median_depth(depth, known)
    capture.color[n], capture.depth[n], capture.lens[n] = color, depth, lens
    capture.noise[n], capture.plane[n] = noise, -1
    smooth = smoothing(noise, middle, float(lens[0]), 0.08)
    edges = step_edges(depth, 0.03)
    near = cv2.dilate(edges.astype(np.uint8), np.ones((2 * smooth + 3, 2 * smooth + 3), np.uint8)) > 0
    found = np.where(near[..., None], one_sided_normals(depth, lens, smooth), normals(depth, lens, smooth))
    capture.normal[n] = np.rint(found * 32767)
    edges[0] = edges[-1] = True
    edges[:, 0] = edges[:, -1] = True
    capture.guard[n] = cv2.dilate(edges.astype(np.uint8), np.ones((3, 3), np.uint8))
    capture.feather[n] = np.minimum(cv2.distanceTransform((~edges).astype(np.uint8), cv2.DIST_L2, 3), 255)
